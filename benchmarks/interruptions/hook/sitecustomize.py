"""Loaded by every Python process of a disturbed command: ends the command at its n-th file.

Counts what the command's processes open for writing, rename, remove or make in the current folder.
The number of bytes in the file of counts is how often it has happened.
"""

import os
import signal
import sys

_COUNTED = ("os.rename", "os.remove", "os.mkdir", "os.link", "os.truncate")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT


def _begin() -> None:
    folder, at = os.environ["STROKE_FOLDER"], int(os.environ["STROKE_AT"])
    number, group = int(os.environ["STROKE_SIGNAL"]), os.environ["STROKE_GROUP"] == "1"
    counts = os.open(os.environ["STROKE_COUNTS"], os.O_WRONLY | os.O_APPEND)

    def look(event: str, args: tuple[object, ...]) -> None:
        if event not in _COUNTED and not (event == "open" and _writes(args)):
            return
        if not _is_inside(args[0], folder):
            return
        os.write(counts, b".")
        if at and os.fstat(counts).st_size == at:
            leader = os.getsid(0)
            (os.killpg if group else os.kill)(leader, signal.Signals(number))

    sys.addaudithook(look)


def _writes(args: tuple[object, ...]) -> bool:
    return len(args) > 2 and isinstance(args[2], int) and bool(args[2] & _WRITING)


def _is_inside(path: object, folder: str) -> bool:
    if not isinstance(path, str | bytes | os.PathLike):
        return False
    return os.fsdecode(os.path.abspath(path)).startswith(folder + os.sep)


if "STROKE_COUNTS" in os.environ:
    _begin()
