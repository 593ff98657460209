"""`run-gantry --watch-gap`: does the rig file still explain what this rig does?

In: one row of the run log per tick. Out: a running score, 1 at the limit of what the rig file
explains with its calibration spreads and disturbances, and a sentence when the score passes that
limit or comes back.
"""

import math
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from runtime.io.realtime import yield_to_the_loop
from runtime.loop.watch_filter import WatchFilter
from wakedeploy.core.errors import one_line
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog_columns import Value

Tell = Callable[[str], None]

WINDOW_S = 10.0
LEAST_S = 5.0  # of new readings
BACK_BELOW = 0.8  # of the limit: keeps a score near the limit from coming and going
_CLIP_SD = 3.0  # outliers of the range sensor count as this at most
_MEMORY_SAMPLES = 16.0  # of the slow statistic, half a second

# Largest values in simulated flights of the default rig without any effect, each with a calibration
# drawn from the rig file's spreads; 2 % of these flights pass one of them (benchmarks/watch.py).
SIZE_LIMIT = 4.2  # standard deviations of the mean squared innovation
SLOW_LIMIT = 4.6  # the same of innovations that keep their sign for half a second
CALIBRATION_LIMIT = 4.8  # standard deviations of one calibrated constant


@dataclass
class GapReport:
    """What became of the watch over a run; `worst` is the largest score, NaN without any."""

    worst: float = math.nan
    first_left_s: float | None = None
    why: str = ""
    failed: str = ""  # why it stopped, if it did

    def sentence(self) -> str:
        """The sentence for the run's summary."""
        if self.failed:
            return f"stopped ({self.failed})"
        if math.isnan(self.worst):
            return "too little flight to judge"
        if self.first_left_s is None:
            return f"explained by the rig file, score at most {self.worst:.2f} of 1"
        return (
            f"not explained by the rig file from {self.first_left_s:.1f} s on, score up to "
            f"{self.worst:.1f} of 1 ({self.why})"
        )


class GapWatch:
    """The score of one run; `tell` gets a sentence each time the score crosses its limit."""

    def __init__(self, rig: Rig, tell: Tell | None = None) -> None:
        self._filter = WatchFilter(rig)
        self._tell = tell
        self._window: deque[tuple[float, float, float]] = deque()  # when, squared, slow squared
        self._squares = self._slow_squares = self._slow = 0.0
        self._keep = math.exp(-1.0 / _MEMORY_SAMPLES)
        self._is_out = False
        self.report = GapReport()

    def step(self, row: Mapping[str, Value]) -> float | None:
        """The score after one tick; None at rest, and until there is enough flight to judge.

        A tick without a usable sample has no score and changes none. It never raises: if it fails,
        the flight goes on without a score, and `report` says why.
        """
        if self.report.failed:
            return None
        try:
            return self._scored(row)
        except Exception as error:
            self.report.failed = one_line(error)
            self._say(f"The gap watch stopped: {self.report.failed}")
            return None

    def _scored(self, row: Mapping[str, Value]) -> float | None:
        seen = self._filter.step(row)
        if seen is None:
            return None
        self._count(seen.sample_s, seen.whitened)
        if len(self._window) < 0.9 * LEAST_S * self._filter.readings_hz:
            return None
        score, why = self._judged()
        self._note(score, why, seen.sample_s)
        return score

    def _count(self, when_s: float, whitened: float) -> None:
        clipped = min(max(whitened, -_CLIP_SD), _CLIP_SD)
        self._slow = self._keep * self._slow + math.sqrt(1.0 - self._keep**2) * clipped
        self._window.append((when_s, clipped**2, self._slow**2))
        self._squares += clipped**2
        self._slow_squares += self._slow**2
        while self._window[0][0] < when_s - WINDOW_S:
            _, squared, slow = self._window.popleft()
            self._squares -= squared
            self._slow_squares -= slow

    def _judged(self) -> tuple[float, str]:
        """The largest of the three statistics over its limit, and its meaning in words."""
        count = len(self._window)
        size = (self._squares / count - 1.0) * math.sqrt(count / 2.0)
        slow = (self._slow_squares / count - 1.0) * math.sqrt(count / (2.0 * _MEMORY_SAMPLES))
        departures = np.abs(self._filter.departures())
        farthest = int(np.argmax(departures))
        name = self._filter.names[farthest]
        return max(
            (size / SIZE_LIMIT, "samples scatter more than the model says"),
            (slow / SLOW_LIMIT, "forecasts err to one side for half a second and longer"),
            (
                float(departures[farthest]) / CALIBRATION_LIMIT,
                f"as if {name} were not as calibrated",
            ),
        )

    def _note(self, score: float, why: str, when_s: float) -> None:
        report = self.report
        if not score <= report.worst:
            report.worst = score
        if score > 1.0 and not self._is_out:
            self._is_out = True
            if report.first_left_s is None:
                report.first_left_s, report.why = when_s, why
            self._say(
                f"{when_s:.1f} s: the rig file no longer explains this flight: {why} (score "
                f"{score:.1f}, limit 1); record it and run `wakedeploy gap close` on it."
            )
        elif score < BACK_BELOW and self._is_out:
            self._is_out = False
            self._say(f"{when_s:.1f} s: the rig file explains the flight again.")

    def _say(self, sentence: str) -> None:
        """Report from a thread of its own: a terminal may be held for as long as someone likes."""
        if self._tell is not None:
            threading.Thread(
                target=_yield_and_tell, args=(self._tell, sentence), daemon=True
            ).start()


def _yield_and_tell(tell: Callable[[str], None], sentence: str) -> None:
    yield_to_the_loop()
    tell(sentence)
