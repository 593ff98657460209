"""The wake between two flights of the same reference: the measured force with it, less without.

In: pairs of run logs. Out: what the source put on the sufferer, with its error. Both forces are
smoothed out of the range data (`runtime.measured_force`), so what both flights have, a wrong thrust
curve, the cables' pull, ground effect, cancels; what changes between them does not.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from runtime.measured_force import MeasuredForce, measure
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog

FloatArray = npt.NDArray[np.float64]
_LEAST_TICKS = 16


@dataclass(frozen=True)
class PairWake:
    """One pair in numbers: heights in m, forces in N, up positive; NaN where nothing was measured.

    `mean_n` and its error `mean_sd_n` are over the ticks that were airborne in both flights;
    `mean_abs_n` and `max_abs_n` of the same difference's size, `noise_abs_n` what errors alone
    would make of `mean_abs_n`. `thrust_n` is how much more thrust the flight with the wake needed.
    """

    rmse_off_m: float
    rmse_on_m: float
    airborne_s: float = 0.0
    mean_n: float = math.nan
    mean_sd_n: float = math.nan
    mean_abs_n: float = math.nan
    noise_abs_n: float = math.nan
    max_abs_n: float = math.nan
    max_abs_sd_n: float = math.nan
    max_at_s: float = math.nan
    thrust_n: float = math.nan

    @property
    def is_measured(self) -> bool:
        """Whether enough was airborne in both flights."""
        return self.airborne_s > 0.0

    def as_json(self) -> dict[str, Any]:
        """The numbers as a plain dictionary."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class _Series:
    """A flight's force, its sd and its thrust by tick, (T,) each, NaN where it was not measured."""

    force_n: FloatArray
    sd_n: FloatArray
    thrust_n: FloatArray


def compare(pairs: Sequence[tuple[RunLog, RunLog]], rig: Rig) -> list[PairWake]:
    """Each pair (wake off, wake on) in numbers; simulated truth is not looked at."""
    off = [log.without_truth() for log, _ in pairs]
    on = [log.without_truth() for _, log in pairs]
    try:
        # Apart: how lively a force is belongs to the wake, and the flights without have none.
        smoothed = [measure(logs, rig) for logs in (off, on)]
    except UnusableInput:  # too little in the air
        return [PairWake(a.tracking_rmse_m(), b.tracking_rmse_m()) for a, b in pairs]
    memory_s = smoothed[1][0].time_s
    return [
        _compared(a, b, _series(a, of_a), _series(b, of_b), memory_s)
        for a, b, of_a, of_b in zip(off, on, smoothed[0][1], smoothed[1][1], strict=True)
    ]


def combined(wakes: Sequence[PairWake]) -> tuple[float, float]:
    """The mean wake force of several pairs and its error [N], NaN without any.

    The error is the wider of what each pair's own says and of the spread between pairs, which also
    knows of a battery that drains.
    """
    known = [wake for wake in wakes if wake.is_measured]
    if not known:
        return math.nan, math.nan
    count = len(known)
    own_n = math.sqrt(sum(wake.mean_sd_n**2 for wake in known)) / count
    means = [wake.mean_n for wake in known]
    spread_n = float(np.std(means, ddof=1)) / math.sqrt(count) if count > 1 else 0.0
    return float(np.mean(means)), max(own_n, spread_n)


def _series(log: RunLog, stretches: Sequence[MeasuredForce]) -> _Series:
    """By the loop's own tick, which is the same place of the reference in both flights."""
    length = int(log["tick"][-1]) + 1 if len(log) else 0
    force_n, sd_n, thrust_n = (np.full(length, np.nan) for _ in range(3))
    for stretch in stretches:
        at = log["tick"][stretch.ticks].astype(np.intp)
        force_n[at], sd_n[at], thrust_n[at] = stretch.force_n, stretch.force_sd_n, stretch.thrust_n
    return _Series(force_n, sd_n, thrust_n)


def _compared(
    off_log: RunLog, on_log: RunLog, off: _Series, on: _Series, memory_s: float
) -> PairWake:
    rmse = (off_log.tracking_rmse_m(), on_log.tracking_rmse_m())
    length = min(len(off.force_n), len(on.force_n))
    force_n = on.force_n[:length] - off.force_n[:length]
    sd_n = np.hypot(on.sd_n[:length], off.sd_n[:length])
    both = np.flatnonzero(np.isfinite(force_n) & np.isfinite(sd_n))
    if len(both) < _LEAST_TICKS:
        return PairWake(*rmse)
    airborne_s = len(both) / on_log.rate_hz
    size_n = np.abs(force_n[both])
    largest = both[int(np.argmax(size_n))]
    # The smoother's errors last for about the force's own time, to both sides.
    independent = max(1.0, airborne_s / (2.0 * memory_s))
    return PairWake(
        *rmse,
        airborne_s=airborne_s,
        mean_n=float(np.mean(force_n[both])),
        mean_sd_n=float(np.sqrt(np.mean(sd_n[both] ** 2) / independent)),
        mean_abs_n=float(np.mean(size_n)),
        noise_abs_n=float(np.mean(sd_n[both]) * math.sqrt(2.0 / math.pi)),
        max_abs_n=float(np.max(size_n)),
        max_abs_sd_n=float(sd_n[largest]),
        max_at_s=float(largest / on_log.rate_hz),
        thrust_n=float(np.mean(on.thrust_n[both] - off.thrust_n[both])),
    )
