"""Real time on Linux: priority, locked memory, a core of one's own, ticks at absolute times."""

import ctypes
import gc
import math
import os
import sys
import time
from dataclasses import dataclass
from typing import Protocol

from wakedeploy.core.errors import UnusableInput

FIFO_PRIORITY = 50
SWITCH_INTERVAL_S = 0.0005
_LOCK_CURRENT_FUTURE_ON_FAULT = 1 | 2 | 4
# ON_FAULT locks pages as they are touched: without it every library is pulled in whole.


class Clock(Protocol):
    """Where time comes from; the module `time` is one."""

    def monotonic(self) -> float:
        """The present [s]."""

    def sleep(self, seconds: float, /) -> None:
        """Let time pass."""


def loop_core() -> int:
    """The core that the loop takes: the last one it may run on."""
    return max(os.sched_getaffinity(0))


def become_realtime() -> None:
    """Give this thread and those it starts SCHED_FIFO, locked memory and one core.

    Raises UnusableInput with the setting to change when the machine does not allow it.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
    except PermissionError as error:
        raise UnusableInput(
            "--realtime: this user may not use SCHED_FIFO; add '@realtime - rtprio 90' and "
            "'@realtime - memlock unlimited' to /etc/security/limits.conf, join the group "
            "'realtime' and log in again, or fly with --no-realtime."
        ) from error
    except (AttributeError, OSError) as error:
        raise UnusableInput(
            f"--realtime: this system offers no SCHED_FIFO ({error}); fly with --no-realtime."
        ) from error
    _lock_memory()
    os.sched_setaffinity(0, {loop_core()})


@dataclass(frozen=True, slots=True)
class Priority:
    """Whether the loop has real-time priority, and a line that says so."""

    is_realtime: bool
    sentence: str


def take_priority(asked: bool | None) -> Priority:
    """Become real-time where that is asked for, or, with None, where the computer permits it.

    Raises UnusableInput where it is asked for and not permitted.
    """
    if asked is False:
        return Priority(False, "Real time: none taken; other programs can hold up the loop.")
    try:
        become_realtime()
    except UnusableInput:
        if asked:
            raise
        return Priority(
            False,
            "Real time: not permitted here, so that other programs can hold up the loop; "
            "`wakedeploy doctor` says how to permit it.",
        )
    taken = f"SCHED_FIFO, locked memory, core {loop_core()}"
    return Priority(True, f"Real time: {taken}; --no-realtime does without.")


def yield_to_the_loop() -> None:
    """Take the lowest real-time priority where this thread has inherited the loop's.

    The ordinary class would be worse than none: another program could push the thread aside while
    it holds the interpreter's lock, and the loop would wait for both.
    """
    if hasattr(os, "SCHED_FIFO") and os.sched_getscheduler(0) == os.SCHED_FIFO:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))


def become_ordinary() -> None:
    """Take this thread back to the ordinary scheduler and to every core."""
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.sched_setaffinity(0, range(os.cpu_count() or 1))


def _lock_memory() -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_LOCK_CURRENT_FUTURE_ON_FAULT) != 0:
        raise UnusableInput(
            f"--realtime: memory cannot be locked ({os.strerror(ctypes.get_errno())}); raise the "
            "memlock limit ('ulimit -l unlimited') or fly with --no-realtime."
        )


def quieten_interpreter() -> None:
    """Keep what lives now out of garbage collection, and let no thread hold the lock for 5 ms.

    What imports and model loading left behind goes back to the system where its C library can.
    """
    gc.collect()
    gc.freeze()
    give_back = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if give_back is not None:
        give_back(0)
    sys.setswitchinterval(SWITCH_INTERVAL_S)


@dataclass(frozen=True, slots=True)
class Tick:
    """One period: its number on the grid, when it should start [s], by how much it was late [s]."""

    index: int
    start_s: float
    late_s: float
    skipped: int


LATEST_START = 0.25  # of a period; a tick that would begin later is skipped


class Pacer:
    """Ticks on a fixed grid of absolute times; a slow tick is not repaid by fast ones.

    A tick that could only begin later than a quarter of its period is skipped and counted. After a
    pause of more than a period the newest of them begins at once all the same: the board has been
    without commands for long, and its patience ends at four periods.
    """

    def __init__(
        self,
        period_s: float,
        clock: Clock = time,
    ) -> None:
        self.period_s = period_s
        self._clock = clock
        self._origin_s = clock.monotonic()
        self._next = 0

    def wait(self) -> Tick:
        """Sleep until the next tick that still lies ahead, or just began."""
        now_s = self._clock.monotonic()
        behind = (now_s - self._origin_s) / self.period_s - self._next
        skipped = max(0, math.ceil(behind - LATEST_START))
        if behind >= 1.0:
            skipped = math.floor(behind)
        index = self._next + skipped
        start_s = self._origin_s + index * self.period_s
        if start_s > now_s:
            self._clock.sleep(start_s - now_s)
        self._next = index + 1
        return Tick(index, start_s, max(0.0, self._clock.monotonic() - start_s), skipped)


class Laps:
    """Times between marks, on the monotonic clock."""

    def __init__(self, clock: Clock) -> None:
        self.times_s: dict[str, float] = {}
        self._clock, self._last_s = clock, clock.monotonic()

    def mark(self, stage: str) -> None:
        """The stage that ends here."""
        now_s = self._clock.monotonic()
        self.times_s[stage] = now_s - self._last_s
        self._last_s = now_s
