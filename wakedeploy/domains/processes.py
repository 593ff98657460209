"""Episodes on several processes, or all in this one."""

import contextlib
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import Any

Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]


@contextlib.contextmanager
def processes(workers: int) -> Iterator[Map]:
    """A `map` over that many processes; results come in order.

    With one worker everything happens in this process, which may be one that must not start others
    (a worker of a sweep).
    """
    if workers <= 1:
        yield map
        return
    # Workers end at once when interrupted; the parent says so.
    defaults = (signal.SIGINT, signal.SIG_DFL)
    with ProcessPoolExecutor(workers, initializer=signal.signal, initargs=defaults) as pool:
        try:
            yield pool.map
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
