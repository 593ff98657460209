"""A module of this project in a process of its own: bytes go in, bytes come out.

What it loads, takes or dies of is not the caller's, and Ctrl-C ends it at once.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO

_LOOK_S = 0.1  # how often who waits is heard


@dataclass(frozen=True)
class Ended:
    """How it ended: exit status (negative: by that signal), and what it wrote."""

    status: int
    out: bytes
    err: bytes

    @property
    def why(self) -> str:
        """How it ended where it should not have, from the signal or from its last words."""
        lines = self.err.decode(errors="replace").split("\n")
        last = next((line.strip() for line in reversed(lines) if line.strip()), "no word")
        said = last[:200] if last.isprintable() else repr(last)[:200]
        if self.status >= 0:
            return f"ended with exit status {self.status} ({said})"
        return f"was ended by {signal.Signals(-self.status).name} ({said})"


def run_apart(
    module: str, argument: str, given: bytes, *, seconds: float, waiting: Callable[[], None]
) -> Ended:
    """Run a module with one argument and `given` as its standard input, until it ends by itself.

    `waiting` is called again and again meanwhile. Raises TimeoutError after `seconds`; the process
    is then killed with those that it started, as after whatever `waiting` raises.
    """
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = _started(module, argument, given, out, err)
        try:
            status = _status(process, seconds, waiting)
        except BaseException:  # Ctrl-C as well
            os.killpg(process.pid, signal.SIGKILL)  # with the compiler that it may have started
            process.wait()
            raise
        return Ended(status, _written(out), _written(err))


def _written(file: IO[bytes]) -> bytes:
    """What was written to a file, whose place is shared with who wrote."""
    file.seek(0)
    return file.read()


def _started(
    module: str, argument: str, given: bytes, out: IO[bytes], err: IO[bytes]
) -> "subprocess.Popen[bytes]":
    """The process; it writes to files, as their size has a limit and what is in a pipe has none."""
    paths = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
    with tempfile.TemporaryFile() as file:
        file.write(given)
        file.seek(0)
        return subprocess.Popen(  # noqa: S603
            [sys.executable, "-P", "-m", module, argument],
            stdin=file,
            stdout=out,
            stderr=err,
            start_new_session=True,  # a terminal's Ctrl-C is for the parent, which ends it
            env=os.environ
            | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": paths},
        )


def _status(process: "subprocess.Popen[bytes]", seconds: float, waiting: Callable[[], None]) -> int:
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        try:
            return process.wait(timeout=_LOOK_S)
        except subprocess.TimeoutExpired:
            waiting()
    raise TimeoutError
