"""A recorded run in numbers: tracking, timing, modes, faults, what was lost."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from wakedeploy.core.runlog import RunLog
from wakedeploy.core.runlog_columns import FLYING, MODES, STAGES

FloatArray = npt.NDArray[np.float64]

_JUMP_S = 1.0  # beyond what the ticks' numbers explain; a tick that began late is off by less


@dataclass(frozen=True)
class Spread:
    """Median, 99th percentile and maximum of a series; NaN where nothing was recorded."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True)
class RunSummary:
    """What `log show` prints. Times in s, lengths in m, counts of ticks.

    `is_virtual`: flown on a virtual gantry, which has no cables. `tracking_rmse_m` is reference
    minus estimated height while flying, `true_tracking_rmse_m` the same for the true height of a
    simulation. `overruns`: ticks that took longer than their period,
    and ticks that could not begin: numbers on the loop's grid that neither the log nor the
    recorder's count of losses has. `dropped`: ticks that happened and could not be recorded.
    `failsafe_s` is when a failsafe began, NaN without one, and `failsafe_cause` the fault that
    explains the others, by its name in `wakedeploy.core.failsafes`, "" where none was recorded.
    `ended` is how the run ended by its own words, "" where that was not recorded.
    """

    is_virtual: bool
    ended: str
    ticks: int
    duration_s: float
    rate_hz: float
    flying_s: float
    tracking_rmse_m: float
    tracking_max_m: float
    true_tracking_rmse_m: float
    overruns: int
    dropped: int
    round_trip_s: Spread
    computing_s: Spread
    stages_s: dict[str, Spread]
    seconds_in_mode: dict[str, float]
    faults: dict[str, int]
    failsafe_s: float
    failsafe_cause: str
    range_missing: int
    range_repeated: int
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """The numbers as plain dictionaries."""
        spread = {name: vars(value) for name, value in self.stages_s.items()}
        numbers = vars(self) | {"notes": list(self.notes), "stages_s": spread}
        return numbers | {
            "round_trip_s": vars(self.round_trip_s),
            "computing_s": vars(self.computing_s),
        }


def summarise(log: RunLog) -> RunSummary:
    """Sum up a run; a log without ticks gives zeros and NaN."""
    period_s = 1.0 / log.rate_hz if len(log) > 1 or "rate_hz" in log.metadata else 0.0
    error_m = (log["z_ref_m"] - log["z_est_m"])[log.flying]
    simulated = "true_z_m" in log
    modes = Counter(log["mode"])
    stages = {stage: log[stage] for stage in STAGES}
    computing_s = np.sum(list(stages.values()), axis=0)
    dropped = int(log.metadata.get("dropped", 0))
    failsafe_s, cause = _failsafe(log)
    return RunSummary(
        is_virtual=log.metadata.get("simulated") == "true",
        ended=log.metadata.get("ended", ""),
        ticks=len(log),
        duration_s=float(np.ptp(log["t_s"])) + period_s if len(log) else 0.0,
        rate_hz=float(np.ptp(log["tick"]) / np.ptp(log["t_s"])) if len(log) > 1 else float("nan"),
        flying_s=sum(modes[mode] for mode in FLYING) * period_s,
        tracking_rmse_m=log.tracking_rmse_m(),
        tracking_max_m=_spread(np.abs(error_m)).max,
        true_tracking_rmse_m=log.tracking_rmse_m("true_z_m") if simulated else float("nan"),
        overruns=_overruns(log, computing_s, period_s, dropped),
        dropped=dropped,
        round_trip_s=_spread(log["round_trip_s"]),
        computing_s=_spread(computing_s),
        stages_s={name: _spread(values) for name, values in stages.items()},
        seconds_in_mode={mode: modes[mode] * period_s for mode in MODES if modes[mode]},
        faults=_faults(log),
        failsafe_s=failsafe_s,
        failsafe_cause=cause,
        range_missing=int(np.isnan(log["range_m"]).sum()),
        range_repeated=int((log["range_repeats"] > 0).sum()),
        notes=_notes(log, period_s),
    )


def _overruns(log: RunLog, computing_s: FloatArray, period_s: float, dropped: int) -> int:
    """Ticks slower than a period, and gaps on the grid that are not the recorder's own losses.

    The run itself counts the same two (`runtime.loop.tally`); time would not show them: a tick that
    began late is followed by one that did not.
    """
    slow = computing_s > period_s
    slow |= np.array(["overrun" in faults for faults in log["faults"]], dtype=bool)
    skipped = int(np.sum(np.maximum(np.diff(log["tick"]) - 1.0, 0.0)))
    return int(slow.sum()) + max(0, skipped - dropped)


def _faults(log: RunLog) -> dict[str, int]:
    named = Counter(name for faults in log["faults"] for name in faults.split("+") if name)
    return dict(named.most_common())


def _failsafe(log: RunLog) -> tuple[float, str]:
    """When the failsafe began, and the first fault of its first tick that names one."""
    down = np.flatnonzero(log["mode"] == "FAILSAFE")
    if not len(down):
        return float("nan"), ""
    faults = [name for tick in down for name in str(log["faults"][tick]).split("+") if name]
    return float(log["t_s"][down[0]]), faults[0] if faults else ""


def _notes(log: RunLog, period_s: float) -> tuple[str, ...]:
    notes = [*_time_jumps(log, period_s)]
    if "unfinished" in log.metadata:
        notes.append(log.metadata["unfinished"])
    if "ignored_columns" in log.metadata:
        notes.append(f"columns left out: {log.metadata['ignored_columns']}")
    return tuple(notes)


def _time_jumps(log: RunLog, period_s: float) -> list[str]:
    """A clause on the first step in time that the numbers of its ticks do not explain, if any."""
    t_s, tick = log["t_s"], log["tick"]
    beyond_s = np.diff(t_s) - np.maximum(np.diff(tick), 1.0) * period_s
    jumps = np.flatnonzero(beyond_s > _JUMP_S)
    if not len(jumps):
        return []
    at = jumps[0]
    others = f", the first of {len(jumps)} jumps" if len(jumps) > 1 else ""
    return [
        f"t_s jumps by {beyond_s[at]:.6g} s after tick {tick[at]:.0f} ({t_s[at]:.6g} s, then "
        f"{t_s[at + 1]:.6g} s){others}, so duration and rate do not count; mend t_s from there on"
    ]


def _spread(values: FloatArray) -> Spread:
    known = values[np.isfinite(values)]
    if not len(known):
        return Spread(float("nan"), float("nan"), float("nan"))
    return Spread(*(float(v) for v in np.percentile(known, (50, 99, 100))))
