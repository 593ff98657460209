"""Locks between the processes of one machine, which end with what holds them."""

import contextlib
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from wakedeploy.core.errors import UnusableInput

_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
_JUST_MADE_S = 60.0  # a folder that is younger may be about to be locked


@contextlib.contextmanager
def one_at_a_time(
    folder: Path, what: str = "turn", *, traceless: bool = False
) -> Iterator[Callable[[], None]]:
    """One process of this machine at a time in here, until it leaves or calls what it was given.

    The folder is made. Different things to do there (`what`) do not wait for each other. With
    `traceless` no lock file stays, unless the process is killed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f".{what}.lock"
    held = [_locked(path)]

    def leave() -> None:
        if held and traceless:
            path.unlink(missing_ok=True)
        if held:
            os.close(held.pop())

    try:
        yield leave
    finally:
        leave()


@contextlib.contextmanager
def alone(folder: Path, who: str, what: str) -> Iterator[None]:
    """Nobody else of this machine does the same (`what`) in this folder, which is made.

    Raises UnusableInput, which begins with `who` is at work there, instead of waiting.
    """
    folder.mkdir(parents=True, exist_ok=True)
    try:
        descriptor = _locked(folder / f".{what}.lock", fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise UnusableInput(
            f"{who} is at work in {folder}; wait for it, or give another --out."
        ) from error
    try:
        yield
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def scratch_folder(prefix: str) -> Iterator[Path]:
    """A new folder among the system's temporary ones, gone with the block.

    A process that is killed in the block leaves it there; it goes when another one begins.
    """
    _remove_left(Path(tempfile.gettempdir()), prefix)
    with tempfile.TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=True) as name:
        descriptor = os.open(name, _FOLDER)
        try:
            with contextlib.suppress(OSError):  # where folders have no locks, none is removed
                fcntl.flock(descriptor, fcntl.LOCK_EX)
            yield Path(name)
        finally:
            os.close(descriptor)


def _remove_left(place: Path, prefix: str) -> None:
    """Remove our folders of that kind that nobody holds any more."""
    for folder in place.glob(f"{prefix}*"):
        with contextlib.suppress(OSError):  # held, somebody else's, or gone meanwhile
            descriptor = os.open(folder, _FOLDER)
            try:
                found = os.fstat(descriptor)
                if found.st_uid != os.geteuid() or time.time() < found.st_mtime + _JUST_MADE_S:
                    continue
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(descriptor)


def _locked(path: Path, how: int = fcntl.LOCK_EX) -> int:
    """A descriptor that holds the lock until it is closed, by us or by the process' end."""
    while True:
        descriptor = os.open(path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(descriptor, how)
            if _is(descriptor, path):  # its former holder may have removed it meanwhile
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _is(descriptor: int, path: Path) -> bool:
    """Whether an open file still has this name."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False
