"""Processes that this one starts: none outlives it."""

import multiprocessing
import multiprocessing.connection
import os
import threading


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
