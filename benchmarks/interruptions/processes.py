"""A command as a process of its own: started, struck at a moment, watched until no child is left.

In: arguments, a folder, a stroke. Out: how it ended, and how long after that its last child did.
"""

import contextlib
import os
import secrets
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

HOOK = Path(__file__).with_name("hook")
CHILDREN_LIMIT_S = 60.0  # after which a child counts as left behind
IDLE_LIMIT_S = 90.0  # in which a command that does not hang computes, however busy the machine
_MARK = "STROKE_MARK"
_LOOK_S = 0.02
_LOOK_AT_WORK_S = 2.0


@dataclass(frozen=True)
class Stroke:
    """A signal to a command, or to all of its processes (`group`), at one moment of the two."""

    number: signal.Signals
    group: bool = False
    after_s: float | None = None
    at_file: int | None = None

    @property
    def words(self) -> str:
        """For the account of what went wrong."""
        to = " to all processes" if self.group else ""
        when = f"after {self.after_s:.3f} s" if self.after_s else f"at file {self.at_file}"
        return f"{self.number.name}{to} {when}"


@dataclass(frozen=True)
class Ended:
    """How a command ended; `children_s` later the last child had ended, None: it had to be killed.

    `status` is negative after a signal, as in `subprocess`. `files` counts what it did to files.
    """

    status: int
    stdout: str
    stderr: str
    seconds: float
    children_s: float | None
    struck: bool
    hung: bool
    files: int


class Command:
    """A started command in a folder; its temporary files lie in `tmp` beside that."""

    def __init__(self, words: list[str], folder: Path, stroke: Stroke | None = None) -> None:
        self._stroke, self._mark = stroke, secrets.token_hex(8)
        self._beside = folder.with_name(f"{folder.name}-beside")
        (self._beside / "tmp").mkdir(parents=True, exist_ok=True)
        self._counts, self._out, self._err = (
            self._beside / f"{self._mark}-{name}" for name in ("counts", "out", "err")
        )
        self._counts.touch()
        self._began_s = time.monotonic()
        with self._out.open("w") as out, self._err.open("w") as err:
            self._process = subprocess.Popen(
                words,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                start_new_session=True,
                env=os.environ | self._environment(folder),
            )

    def ended(self) -> Ended:
        """Strike, wait for the end, and for that of every child."""
        try:
            struck = self._struck_in_time()
            hung = self._hangs()
        finally:
            if self._process.poll() is None:
                os.killpg(self._process.pid, signal.SIGKILL)
                self._process.wait()
        seconds = time.monotonic() - self._began_s
        children_s = self._children_s()
        files = self._counts.stat().st_size
        at = self._stroke.at_file if self._stroke else None
        outputs = [path.read_text(errors="replace") for path in (self._out, self._err)]
        for path in (self._counts, self._out, self._err):
            path.unlink()
        struck = struck or (at is not None and files >= at)
        return Ended(self._process.returncode, *outputs, seconds, children_s, struck, hung, files)

    def _struck_in_time(self) -> bool:
        if self._stroke is None or self._stroke.after_s is None:
            return False
        try:
            self._process.wait(self._stroke.after_s)
        except subprocess.TimeoutExpired:
            send = os.killpg if self._stroke.group else os.kill
            send(self._process.pid, self._stroke.number)
            return True
        return False

    def _hangs(self) -> bool:
        """Wait for the end; whether it does not come, for nothing is computed any more."""
        computed_s, since_s = -1.0, time.monotonic()
        while time.monotonic() - since_s < IDLE_LIMIT_S:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_LOOK_AT_WORK_S)
                return False
            now_s = sum(map(_computed_s, self._marked_pids()))
            if now_s != computed_s:
                computed_s, since_s = now_s, time.monotonic()
        return True

    def _children_s(self) -> float | None:
        began_s = time.monotonic()
        while pids := self._marked_pids():
            if time.monotonic() - began_s > CHILDREN_LIMIT_S:
                for pid in pids:
                    os.kill(pid, signal.SIGKILL)
                return None
            time.sleep(_LOOK_S)
        return time.monotonic() - began_s

    def _marked_pids(self) -> list[int]:
        """Processes that carry this command's mark."""
        mark = f"{_MARK}={self._mark}".encode()
        return [int(p.name) for p in Path("/proc").glob("[0-9]*") if mark in _environ(p)]

    def _environment(self, folder: Path) -> dict[str, str]:
        stroke = self._stroke or Stroke(signal.SIGKILL)
        return {
            _MARK: self._mark,
            "STROKE_FOLDER": str(folder),
            "STROKE_COUNTS": str(self._counts),
            "STROKE_AT": str(stroke.at_file or 0),
            "STROKE_SIGNAL": str(int(stroke.number)),
            "STROKE_GROUP": str(int(stroke.group)),
            "PYTHONPATH": str(HOOK),
            "OMP_NUM_THREADS": "1",
            "TMPDIR": str(self._beside / "tmp"),
            "XDG_CACHE_HOME": str(self._beside / "cache"),
            "MPLCONFIGDIR": str(Path.home() / ".cache" / "matplotlib"),
        }


def wakedeploy(*arguments: str | Path) -> list[str]:
    """The words of a `wakedeploy` command of this environment."""
    return [str(Path(sys.executable).with_name("wakedeploy")), *map(str, arguments)]


def _computed_s(pid: int) -> float:
    """Processor time of a process so far; 0 for one that is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _environ(process: Path) -> bytes:
    try:
        return (process / "environ").read_bytes()
    except OSError:  # gone meanwhile
        return b""
