"""Which stretches of time all columns of a log cover."""

import math

import numpy as np
from numpy.typing import NDArray

from wakedeploy.domains.tables.resampling import usual_step_s

Vector = NDArray[np.float64]
Stretch = tuple[float, float]

_SILENT_STEPS = 10.0  # the longest silence that is no gap, in steps of the log's own
_SILENT_S = 1.0  # and at least this, unless an input has changed in it


def covered(stamps_s: Vector, is_good: NDArray[np.bool_], gap_s: float | None) -> list[Stretch]:
    """Stretches from good sample to good sample, without a bad one or a gap between."""
    if not is_good.any():
        return []
    joined = is_good[:-1] & is_good[1:]
    if gap_s is not None:
        joined &= np.diff(stamps_s) <= gap_s
    ends = np.append(~joined, True) & is_good
    begins = np.insert(~joined, 0, True) & is_good
    return list(zip(stamps_s[begins].tolist(), stamps_s[ends].tolist(), strict=True))


def from_first(stamps_s: Vector, is_good: NDArray[np.bool_]) -> list[Stretch]:
    """What a column covers whose last sample holds for ever."""
    return [(float(stamps_s[is_good][0]), math.inf)] if is_good.any() else []


def common(first: list[Stretch], other: list[Stretch]) -> list[Stretch]:
    """The stretches that lie in both lists; either is in order and without overlap."""
    found: list[Stretch] = []
    i = j = 0
    while i < len(first) and j < len(other):
        start, end = max(first[i][0], other[j][0]), min(first[i][1], other[j][1])
        if start <= end:
            found.append((start, end))
        if first[i][1] < other[j][1]:
            i += 1
        else:
            j += 1
    return found


def gap_between(usual_s: float, silent_s: float) -> str:
    """A `gap_s` that usual steps do not reach and a silence exceeds."""
    return f"{min(10.0 * usual_s, 0.5 * (usual_s + silent_s)):.2g}"


def longest_silence(
    stamps_s: Vector, is_number: NDArray[np.bool_], drive: Vector | None = None
) -> int | None:
    """The sample after a silence that looks like a gap; None where there is none.

    Rows before a column's first number and after its last are of other columns, and show no gap.
    What drives a system must be known: where the values of a `drive` are others after a silence,
    it is a gap however short it is in seconds.
    """
    steps_s = np.diff(stamps_s)
    if not len(steps_s) or not is_number.any():
        return None
    bound_s = max(_SILENT_S, _SILENT_STEPS * float(np.median(steps_s)))
    gaps_s = np.where(steps_s > bound_s, steps_s, 0.0)
    if drive is not None:
        is_long = steps_s > _SILENT_STEPS * usual_step_s(steps_s)
        gaps_s = np.where(is_long & (np.diff(drive) != 0.0), steps_s, gaps_s)
    first, last = np.flatnonzero(is_number)[[0, -1]]
    gaps_s[:first], gaps_s[last:] = 0.0, 0.0
    at = int(np.argmax(gaps_s))
    return at + 1 if gaps_s[at] > 0.0 else None
