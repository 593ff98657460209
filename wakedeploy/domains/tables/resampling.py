"""Samples at stamps as samples at even ticks: held or filtered, and never of the future.

`interpolated` and `averaged` alone know later samples: for a force, which no predictor sees. Pure
functions of arrays: stamps (n,) [s] that rise, values (n,), ticks (m,) [s] that rise evenly.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

_SLOWER = 1.25  # times the ticks' step, from which on a clock has fewer stamps than ticks
_NEAR = 0.25  # of a step, by which stamps may lie off ticks that are more than they
_OWN = 0.45  # the same where each tick has a stamp of its own, but for a few that were lost
_FEW_LOST = 0.1  # share of a log's samples that may be lost while the others have a tick each
_STALE_STEPS = 3.0  # usual ones, after which a sensor's last sample says nothing of now
_FINER = 10.0  # times the cut-off, at which the filter runs at least
_MOST_FINE = 64 << 20  # steps of the filter


def even_ticks(clocks_s: Sequence[Vector], start_s: float, end_s: float, rate_hz: float) -> Vector:
    """Ticks at `rate_hz` within a piece, so late that stamps that jitter have a tick each.

    Where a clock's stamps lie nearer to their ticks than to others, ticks begin later by the most
    that a stamp lies behind its tick. A sample is then never one tick late in one place and in time
    in the next.
    """
    ticks_s = start_s + np.arange(_count(start_s, end_s, rate_hz)) / rate_hz
    if not len(ticks_s):
        return ticks_s
    late_s = max((_lateness_s(stamps_s, ticks_s, rate_hz) for stamps_s in clocks_s), default=0.0)
    late_s += 4.0 * float(np.spacing(np.abs(ticks_s).max()))
    inside: Vector = (ticks_s + late_s)[: _count(start_s + late_s, end_s + late_s, rate_hz)]
    return inside


def _lateness_s(stamps_s: Vector, ticks_s: Vector, rate_hz: float) -> float:
    """The most that a clock's stamps lie behind their ticks; 0 for one that has ticks of its own.

    A slower clock has a tick for each stamp, a faster one a stamp for each tick, but for a few that
    were lost.
    """
    if len(stamps_s) < 2:
        return 0.0
    step_s = float(np.median(np.diff(stamps_s)))
    if step_s * rate_hz > _SLOWER:
        off_s, near_s = stamps_s - _nearest(ticks_s, stamps_s), _NEAR / rate_hz
    else:
        near_s = _OWN * step_s
        off_s = _nearest(stamps_s, ticks_s) - ticks_s
        is_lost = np.abs(off_s) > 0.5 * step_s
        if is_lost.mean() <= _FEW_LOST:
            off_s = off_s[~is_lost]
    is_near = np.abs(off_s).max(initial=0.0) <= near_s
    return max(float(off_s.max(initial=0.0)), 0.0) if is_near else 0.0


def held(stamps_s: Vector, values: Vector, ticks_s: Vector) -> Vector:
    """The newest value at or before each tick; NaN before the first."""
    newest = np.searchsorted(stamps_s, ticks_s, side="right") - 1
    return np.where(newest >= 0, values[np.maximum(newest, 0)], np.nan)


def refreshed(stamps_s: Vector, ticks_s: Vector) -> NDArray[np.bool_]:
    """Ticks (m,) since whose forerunner a sample has come."""
    step_s = (ticks_s[-1] - ticks_s[0]) / (len(ticks_s) - 1)
    edges_s = np.insert(ticks_s, 0, ticks_s[0] - step_s)
    return np.diff(np.searchsorted(stamps_s, edges_s, side="right")) > 0


def stale(stamps_s: Vector, ticks_s: Vector) -> NDArray[np.bool_]:
    """Ticks (m,) whose newest sample is older than some of the log's usual steps."""
    newest = np.searchsorted(stamps_s, ticks_s, side="right") - 1
    bound_s = _STALE_STEPS * usual_step_s(np.diff(stamps_s))
    return np.asarray((newest >= 0) & (ticks_s - stamps_s[np.maximum(newest, 0)] > bound_s))


def is_long(steps_s: Vector) -> NDArray[np.bool_]:
    """Steps (n,) after which the sample before says nothing of now: holes in a log."""
    return np.asarray(steps_s > _STALE_STEPS * usual_step_s(steps_s))


def usual_step_s(steps_s: Vector) -> float:
    """The step [s] in which half of the time lies, or in shorter ones: that between bursts, too."""
    in_order = np.sort(steps_s)
    passed_s = np.cumsum(in_order)
    if not len(steps_s):
        return np.inf
    return float(in_order[np.searchsorted(passed_s, 0.5 * passed_s[-1])])


def low_passed(stamps_s: Vector, values: Vector, ticks_s: Vector, cutoff_hz: float) -> Vector:
    """The values through a second-order Butterworth filter that begins at rest at the first.

    What is held between samples runs through the filter in steps that are as fine as the log's own,
    or a tenth of the cut-off's period. Raises ValueError for a log that would take too many.
    """
    from scipy.signal import butter, lfilter, lfilter_zi

    rate_hz = (len(ticks_s) - 1) / (ticks_s[-1] - ticks_s[0])
    own_hz = 1.0 / float(np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else rate_hz
    finer = int(np.ceil(max(own_hz, _FINER * cutoff_hz) / rate_hz - 1e-6))
    steps = (len(ticks_s) - 1) * max(finer, 1) + 1
    if steps > _MOST_FINE:
        raise ValueError(f"the filter would take {steps} steps, and {_MOST_FINE} are the most")
    through = held(stamps_s, values, _fine(stamps_s, ticks_s, max(finer, 1)))
    b, a = butter(2, cutoff_hz, fs=rate_hz * max(finer, 1))
    filtered, _ = lfilter(b, a, through, zi=lfilter_zi(b, a) * through[0])
    return np.asarray(filtered[:: max(finer, 1)], dtype=np.float64)


def _fine(stamps_s: Vector, ticks_s: Vector, finer: int) -> Vector:
    """Ticks and, between two of them, steps that come late enough for stamps that jitter.

    Late by less than a step: what a tick gives is of its past alone.
    """
    count = (len(ticks_s) - 1) * finer + 1
    fine_s = np.interp(np.arange(count) / finer, np.arange(len(ticks_s)), ticks_s)
    step_s = (ticks_s[-1] - ticks_s[0]) / (count - 1)
    off_s = _nearest(stamps_s, fine_s) - fine_s
    is_near = np.abs(off_s).max(initial=0.0) <= _NEAR * step_s
    fine_s += max(float(off_s.max(initial=0.0)), 0.0) if is_near else 0.0
    fine_s += 1e-6 * step_s
    fine_s[::finer] = ticks_s
    return fine_s


def interpolated(stamps_s: Vector, values: Vector, ticks_s: Vector) -> Vector:
    """The values (m,) on straight lines between samples; beyond the outer ones, those."""
    return np.asarray(np.interp(ticks_s, stamps_s, values), dtype=np.float64)


def averaged(stamps_s: Vector, values: Vector, ticks_s: Vector) -> Vector:
    """The mean (m,) of those lines from half a step before each tick to half a step after it.

    At either end of the log, over the part of that which the log covers.
    """
    half_s = 0.5 * (ticks_s[-1] - ticks_s[0]) / (len(ticks_s) - 1)
    edges_s = np.append(ticks_s - half_s, ticks_s[-1] + half_s)
    edges_s = np.clip(edges_s, stamps_s[0], stamps_s[-1])
    all_s = np.union1d(stamps_s, edges_s)
    through = np.interp(all_s, stamps_s, values)
    areas = 0.5 * (through[1:] + through[:-1]) * np.diff(all_s)
    area = np.diff(np.insert(np.cumsum(areas), 0, 0.0)[np.searchsorted(all_s, edges_s)])
    widths_s = np.diff(edges_s)
    is_covered = widths_s > 1e-3 * half_s
    mean = area / np.where(is_covered, widths_s, 1.0)
    return np.where(is_covered, mean, interpolated(stamps_s, values, ticks_s))


def _count(start_s: float, end_s: float, rate_hz: float) -> int:
    """How many ticks lie within a piece, forgiving a millionth of a step."""
    return max(0, int(np.floor((end_s - start_s) * rate_hz + 1e-6)) + 1)


def _nearest(stamps_s: Vector, ticks_s: Vector) -> Vector:
    after = np.clip(np.searchsorted(stamps_s, ticks_s), 1, max(len(stamps_s) - 1, 1))
    after = np.minimum(after, len(stamps_s) - 1)
    before = np.maximum(after - 1, 0)
    is_after = np.abs(stamps_s[after] - ticks_s) <= np.abs(stamps_s[before] - ticks_s)
    return np.where(is_after, stamps_s[after], stamps_s[before])
