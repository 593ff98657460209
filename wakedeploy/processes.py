"""Processes that this one starts: how many, and none outlives it."""

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import resource_tracker
from typing import Any

MOST_WORKERS = 16  # by default: each holds some 400 MB

Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]


def default_workers() -> int:
    """How many processes share work unless told: one for each core that this one may use."""
    if hasattr(os, "sched_getaffinity"):
        return min(len(os.sched_getaffinity(0)), MOST_WORKERS)
    return min(os.cpu_count() or 1, MOST_WORKERS)


@contextlib.contextmanager
def deaf_to_ctrl_c() -> Iterator[None]:
    """Processes spawned in the block never hear Ctrl-C, which a terminal sends to all of a group.

    The parent decides what becomes of them: one that is still starting would print a traceback, one
    that is told by the parent as well would be interrupted twice.
    """
    resource_tracker.ensure_running()  # starting it lets Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_with_parent() -> None:
    """End this process at once when its parent is gone, even one that was killed.

    It would wait for its next job for ever. Does nothing in a process without a parent of its own.
    """
    threading.Thread(target=_wait_for_its_end, daemon=True).start()


def _wait_for_its_end() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


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
