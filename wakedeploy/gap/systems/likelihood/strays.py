"""Readings that stand alone, far from those around them: a tracker that jumps, a range that misses.

In: a log of a system that states an `outlier_share`. Out: the log with them unmeasured. First
guesses of states and forecasts are then of what was measured; all others are left to the
likelihood, which weighs each reading.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.likelihood.blocks import Log

BoolArray = npt.NDArray[np.bool_]

_BESIDE = 4  # readings on either side that say how much they change from one to the next
_FAR = 10.0  # times the larger of those changes and of what is usual in the log


def without_strays(log: Log, share: float) -> Log:
    """The log, up to a share of an output's readings unmeasured (NaN): those that stand alone."""
    return replace(log, outputs=np.array([_without(row, share) for row in log.outputs]))


def _without(row: FloatArray, share: float) -> FloatArray:
    kept, most = row.copy(), int(np.ceil(share * np.isfinite(row).sum()))
    while most > 0:
        # Without those that were found, others near them stand alone.
        measured = np.flatnonzero(np.isfinite(kept))
        off, is_alone = _alone(kept[measured])
        far = np.flatnonzero(is_alone)
        if not len(far):
            break
        found = measured[far[np.argsort(-off[far])][:most]]
        kept[found], most = np.nan, most - len(found)
    return kept


def _alone(values: FloatArray) -> tuple[FloatArray, BoolArray]:
    """How far readings are from the mean of both their neighbours, and whether they stand alone."""
    if len(values) <= 2 * _BESIDE:
        return np.zeros(len(values)), np.zeros(len(values), bool)
    padded = np.pad(values, _BESIDE, mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _BESIDE + 1)
    others = np.delete(around, _BESIDE, axis=1)
    off = np.abs(values - 0.5 * (others[:, _BESIDE - 1] + others[:, _BESIDE]))
    # Two of the changes around may be those to another stray and back.
    changes = np.sort(np.abs(np.diff(others, axis=1)), axis=1)[:, -3]
    usual = np.maximum(changes, np.median(off))
    sides = np.pad(off, 1)
    is_peak = (off >= sides[:-2]) & (off >= sides[2:])  # its neighbours are far from it, too
    return off, is_peak & (off > _FAR * usual) & (usual > 0.0)
