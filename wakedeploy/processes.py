"""Processes that this one starts: how many, and none outlives it."""

import multiprocessing
import multiprocessing.connection
import os
import threading

MOST_WORKERS = 16  # by default: each holds some 400 MB


def default_workers() -> int:
    """How many processes share work unless told: one for each core that this one may use."""
    if hasattr(os, "sched_getaffinity"):
        return min(len(os.sched_getaffinity(0)), MOST_WORKERS)
    return min(os.cpu_count() or 1, MOST_WORKERS)


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
