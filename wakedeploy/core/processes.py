"""Processes that this one starts: how many, and none outlives it."""

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import resource_tracker
from typing import Any, TypeVar

MOST_WORKERS = 16  # by default: each holds some 400 MB

_STOPPING = {signal.SIGINT, signal.SIGTERM}

Result = TypeVar("Result")
Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterator[Any]]


def default_workers() -> int:
    """How many processes share work by default: one for each core that this one may use."""
    if hasattr(os, "sched_getaffinity"):
        return min(len(os.sched_getaffinity(0)), MOST_WORKERS)
    return min(os.cpu_count() or 1, MOST_WORKERS)


def may_start_others() -> bool:
    """Whether this process may start others: Python lets no worker of a `multiprocessing.Pool`."""
    return not multiprocessing.current_process().daemon


@contextlib.contextmanager
def deaf_to_ctrl_c() -> Iterator[None]:
    """Processes spawned in the block never hear Ctrl-C, which a terminal sends to all of a group.

    The parent decides what becomes of them: one that is still starting would print a traceback, one
    that the parent interrupts as well would be interrupted twice.
    """
    resource_tracker.ensure_running()  # starting it lets Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def one_thread() -> None:
    """One thread for this process, which libraries read when they are imported."""
    os.environ["OMP_NUM_THREADS"] = "1"


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


class Pool:
    """Processes that take on work; they never hear Ctrl-C, the parent decides what becomes of them.

    They end with the parent, even one that was killed: `pool` sees to it.
    """

    def __init__(self, executor: ProcessPoolExecutor) -> None:
        self._executor = executor

    def submit(self, work: Callable[..., Result], *arguments: Any) -> "Future[Result]":
        """Hand over one call."""
        with unheard():  # processes start when there is work
            return self._executor.submit(work, *arguments)

    def map(self, work: Callable[..., Result], *arguments: Iterable[Any]) -> Iterator[Result]:
        """Hand over many calls at once; their results in order."""
        with unheard():
            return self._executor.map(work, *arguments)


@contextlib.contextmanager
def pool(
    workers: int, *, fresh: bool = False, begin: Callable[[], None] | None = None
) -> Iterator[Pool]:
    """That many processes, gone when the block is left; at once, whatever they are at, by an error.

    They are copies of this one, or `fresh` ones: torch does not survive a copy once it has
    computed. Each calls `begin` first.
    """
    context = multiprocessing.get_context("spawn") if fresh else None
    if fresh:
        resource_tracker.ensure_running()  # starting it lets Ctrl-C through again
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(
        workers, mp_context=context, initializer=_begin, initargs=(begin,)
    ) as executor:
        try:
            yield Pool(executor)
        except BaseException:
            manager = getattr(executor, "_executor_manager_thread", None)  # `shutdown` forgets it
            executor.shutdown(wait=False, cancel_futures=True)
            for process in set(multiprocessing.active_children()) - others:
                process.kill()
            if manager is not None:
                # Left to the interpreter's end, it closes a pipe that the end still writes to.
                manager.join()
            raise


@contextlib.contextmanager
def processes(workers: int) -> Iterator[Map]:
    """A `map` over that many processes; results come in order.

    With one worker everything happens in this process, and also in one that may start no others (a
    worker of a sweep, or of a `multiprocessing.Pool`).
    """
    if workers <= 1 or not may_start_others():
        yield map
        return
    with pool(workers) as several:
        yield several.map


@contextlib.contextmanager
def unheard() -> Iterator[None]:
    """Both ways to stop this process wait until the block is left; what is started inherits that.

    A copy of this process would take them as this one does before its first line.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _STOPPING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(begin: Callable[[], None] | None) -> None:
    """In each process of a pool: a polite kill ends it at once, and so does the parent's end."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    end_with_parent()
    if begin is not None:
        begin()
