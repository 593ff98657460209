"""Locks between the processes of one machine, which end with what holds them."""

import contextlib
import fcntl
import os
from collections.abc import Callable, Iterator
from pathlib import Path


@contextlib.contextmanager
def one_at_a_time(folder: Path, what: str = "turn") -> Iterator[Callable[[], None]]:
    """One process of this machine at a time in here, until it leaves or calls what it was given.

    The folder is made. Different things to do there (`what`) do not wait for each other.
    """
    folder.mkdir(parents=True, exist_ok=True)
    held = [_locked(folder / f".{what}.lock")]

    def leave() -> None:
        if held:
            os.close(held.pop())

    try:
        yield leave
    finally:
        leave()


def _locked(path: Path) -> int:
    """A descriptor that holds the lock until it is closed, by us or by the process' end."""
    descriptor = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor
