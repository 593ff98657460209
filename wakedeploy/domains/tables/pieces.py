"""Which stretches of time all columns of a log cover."""

import math

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Stretch = tuple[float, float]

_SILENT_STEPS = 10.0  # the longest silence that is no gap, in steps of the log's own
_SILENT_S = 1.0  # and at least this


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


def longest_silence(stamps_s: Vector) -> int | None:
    """The sample after a silence that looks like a gap; None where there is none."""
    steps_s = np.diff(stamps_s)
    if not len(steps_s):
        return None
    bound_s = max(_SILENT_S, _SILENT_STEPS * float(np.median(steps_s)))
    at = int(np.argmax(steps_s))
    return at + 1 if steps_s[at] > bound_s else None
