"""What a run amounts to: counted while it lasts, in little memory, reported at its end."""

from __future__ import annotations  # array.array takes no type argument before Python 3.12

from array import array
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from runtime.loop.watch import GapReport
from wakedeploy.core.runlog_columns import FLYING, STAGES

LogValue = float | int | str | None
_SHORTEST_S = 0.1  # a virtual gantry that is less behind flies on as a real one would


@dataclass(frozen=True)
class Pause:
    """A time in which the computer did nothing for the loop: how long, and when it began [s]."""

    length_s: float
    at_s: float

    @property
    def milliseconds(self) -> int:
        """Its length, rounded [ms]."""
        return round(1e3 * self.length_s)


DROPPED = "stopped by hand, and its motors switched off at once"


@dataclass
class Tally:
    """Counts and series over the ticks of one run; times in s, errors in m."""

    period_s: float
    ticks: int = 0
    skipped: int = 0
    overran: int = 0
    ended: str = ""  # "whole", "stopped by hand", `DROPPED`, "failsafe: …" or "broken off"
    gap: GapReport | None = None  # of --watch-gap
    log: Path | None = None  # where the run was recorded
    pause: Pause | None = None  # the longest before a failsafe that skipped a tick
    gantry_pause: Pause | None = None  # the longest of a virtual gantry's process
    modes: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    errors_m: array[float] = field(default_factory=lambda: array("d"))
    true_errors_m: array[float] = field(default_factory=lambda: array("d"))
    round_trips_s: array[float] = field(default_factory=lambda: array("d"))
    wake_ups_s: array[float] = field(default_factory=lambda: array("d"))
    stages_s: dict[str, array[float]] = field(
        default_factory=lambda: {stage: array("d") for stage in STAGES}
    )

    @property
    def overruns(self) -> int:
        """Ticks that ended after their period, and ticks that could not begin at all."""
        return self.overran + self.skipped

    def add(self, row: dict[str, LogValue], late_s: float, skipped: int, *, overran: bool) -> None:
        """Count one tick by its row of the run log."""
        self.ticks += 1
        self.skipped += skipped
        self.overran += int(overran)
        self.modes[str(row["mode"])] += 1
        self.faults.update(name for name in str(row["faults"]).split("+") if name)
        self.wake_ups_s.append(late_s)
        for stage, series in self.stages_s.items():
            if stage in row:
                series.append(_number(row[stage]))
        if row["round_trip_s"] is not None:
            self.round_trips_s.append(_number(row["round_trip_s"]))
        if row["mode"] in FLYING:
            self._add_errors(row)

    def stood_still(self, length_s: float, until_s: float) -> None:
        """Remember the longest time between two ticks in which one was missed."""
        longest_s = self.pause.length_s if self.pause is not None else 1.5 * self.period_s
        if length_s > longest_s:
            self.pause = Pause(length_s, until_s - length_s)

    def gantry_stood_still(self, length_s: float, until_s: float) -> None:
        """Remember the longest time that a virtual gantry in real time was behind."""
        longest_s = _SHORTEST_S if self.gantry_pause is None else self.gantry_pause.length_s
        if length_s > longest_s:
            self.gantry_pause = Pause(length_s, until_s - length_s)

    def _add_errors(self, row: dict[str, LogValue]) -> None:
        self.errors_m.append(_number(row["z_ref_m"]) - _number(row["z_est_m"]))
        if row.get("true_z_m") is not None:
            self.true_errors_m.append(_number(row["z_ref_m"]) - _number(row["true_z_m"]))

    @property
    def rmse_m(self) -> float:
        """Root mean square of reference minus estimated height while flying [m]."""
        return _rms(self.errors_m)

    @property
    def true_rmse_m(self) -> float:
        """The same against the true height, which only a simulation knows [m]."""
        return _rms(self.true_errors_m)

    @property
    def totals_s(self) -> npt.NDArray[np.float64]:
        """Per tick, from measurement received to command written [s], (ticks,); () untimed."""
        return np.asarray(np.sum([np.asarray(s) for s in self.stages_s.values()], axis=0))

    def seconds_in(self, mode: str) -> float:
        """Time spent in a mode [s]."""
        return self.modes[mode] * self.period_s


def _number(value: LogValue) -> float:
    return float("nan") if value is None else float(value)


def _rms(series: array[float]) -> float:
    return float(np.sqrt(np.mean(np.square(series)))) if series else float("nan")
