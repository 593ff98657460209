"""Records a run in a thread of its own, so that a stalling disk never holds up the loop.

Which columns there are says `wakedeploy.core.runlog_columns`.
"""

import contextlib
import errno
import queue
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from runtime.io.realtime import yield_to_the_loop
from wakedeploy.core.errors import UnusableInput, is_full, relief, why
from wakedeploy.core.files import begun
from wakedeploy.core.runlog_columns import Value
from wakedeploy.core.runlog_mcap import RunLogWriter, read_mcap

QUEUE_SIZE = 32 * 60  # a minute of ticks: SD cards stall for hundreds of milliseconds, not minutes
SYNC_S = 1.0
CLOSE_LIMIT_S = 30.0

Row = Mapping[str, Value]


@dataclass(frozen=True)
class RecorderReport:
    """How the recording went: ticks on the disk, ticks that are not, and why it stopped early."""

    written: int
    dropped: int
    error: str | None


class Taken(UnusableInput):
    """The name that a recording was to have is that of another one."""


class Recorder:
    """Takes one row per tick and writes it to an MCAP run log.

    `put` never raises, and blocks in simulated time alone, where a loop that outruns the disk can
    wait for it; there the rows' stamps are `simulated_from_ns` [ns, UTC] and their own `t_s`. When
    the disk fails the recording stops, what was written stays readable, and `error` says what
    happened. Raises UnusableInput when the file cannot be started or would replace an earlier
    recording.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, str],
        queue_size: int = QUEUE_SIZE,
        *,
        simulated_from_ns: int | None = None,
    ) -> None:
        self.path = path
        self._simulated_from_ns = simulated_from_ns
        self._writer = _started(path, metadata)
        self._queue: queue.Queue[tuple[int, Row]] = queue.Queue(queue_size)
        self._closing = threading.Event()
        self._offered = self._taken = 0
        self._error: str | None = None
        self._report: RecorderReport | None = None
        self._ended = ""
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def error(self) -> str | None:
        """Why recording stopped, or None while it works."""
        return self._error

    @property
    def dropped(self) -> int:
        """Ticks offered so far that are not recorded and do not wait for it."""
        if self._error is not None:
            return self._offered - self._writer.flushed
        return max(0, self._offered - self._taken - self._queue.qsize())

    def put(self, row: Row) -> None:
        """Hand over one tick; the row must not be changed afterwards."""
        self._offered += 1
        if self._simulated_from_ns is not None:
            self._put_patiently(self._simulated_from_ns + _nanoseconds(row["t_s"]), row)
        elif self._error is None:
            with contextlib.suppress(queue.Full):  # counted: offered, but never taken
                self._queue.put_nowait((time.time_ns(), row))

    def _put_patiently(self, stamp_ns: int, row: Row) -> None:
        while self._error is None:
            with contextlib.suppress(queue.Full):
                self._queue.put((stamp_ns, row), timeout=SYNC_S)
                return

    def close(self, ended: str = "") -> RecorderReport:
        """Write what still waits and how the run `ended`, and report; a second time, only report.

        Of a recording that failed the ticks are counted that a reader finds in the file.
        """
        if self._report is None:
            self._ended = ended
            self._closing.set()
            self._thread.join(CLOSE_LIMIT_S)
            written = self._writer.flushed
            if self._thread.is_alive():
                self._error = f"{self.path}: the disk has not answered for {CLOSE_LIMIT_S:.0f} s"
            elif self._error is not None:
                written = max(written, _readable(self.path))
            self._report = RecorderReport(written, self._offered - written, self._error)
        return self._report

    def _run(self) -> None:
        yield_to_the_loop()
        try:
            self._record()
            self._finish()
        # Whatever happens here must reach the loop as a message, not end the thread unseen.
        except Exception as error:
            self._error = f"{self.path}: recording stopped: {why(error)}{_room(error)}"
            self._writer.abandon()

    def _record(self) -> None:
        next_sync_s = time.monotonic() + SYNC_S
        while not (self._closing.is_set() and self._queue.empty()):
            try:
                log_time_ns, row = self._queue.get(timeout=0.1)
            except queue.Empty:
                pass
            else:
                self._taken += 1
                self._writer.write(row, log_time_ns)
            if time.monotonic() >= next_sync_s:
                self._sync()
                next_sync_s = time.monotonic() + SYNC_S

    def _sync(self) -> None:
        self._writer.flush()
        try:
            self._writer.sync()
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # a pipe cannot be synced
                raise

    def _finish(self) -> None:
        self._sync()
        dropped = self._offered - self._taken
        ending = {"written": str(self._taken), "dropped": str(dropped)}
        self._writer.close(ending | ({"ended": self._ended} if self._ended else {}))


def _readable(path: Path) -> int:
    """The ticks that a reader finds in a file that was not ended."""
    try:
        return len(read_mcap(path).rows)
    except (UnusableInput, OSError):
        return 0


def _room(error: Exception) -> str:
    """What to do about a full disk."""
    return " (free some space there before the next flight)" if is_full(error) else ""


def _nanoseconds(t_s: Value) -> int:
    assert isinstance(t_s, float)
    return int(1e9 * t_s)


def _started(path: Path, metadata: Mapping[str, str]) -> RunLogWriter:
    if path.suffix == ".csv":
        raise UnusableInput(
            f"{path}: flights are recorded as MCAP; name it {path.with_suffix('.mcap').name}, and "
            "`wakedeploy log export` makes CSV of it."
        )
    taken = Taken(f"{path}: there is already a recording; name another file for --log.")
    if path.is_file() and path.stat().st_size > 0:
        raise taken
    try:
        with begun(path) as file:
            return RunLogWriter(file, metadata)
    except FileExistsError as error:
        if path.parent.is_dir():
            raise taken from error
        raise UnusableInput(
            f"{path}: {path.parent} is no folder; name a file in one for --log."
        ) from error
    except OSError as error:
        helps = relief(error) if is_full(error) else "; name another file for --log"
        raise UnusableInput(
            f"{path}: no run log can be written there ({why(error)}){helps}."
        ) from error
