"""Readings that are far from all around them: a tracker that jumps, a range that misses.

In: a log of a system that states an `outlier_share`. Out: the log with them unmeasured. First
guesses of states and forecasts are then of what was measured; strays that are not so far off are
left to the likelihood, which weighs each reading.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter

from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.likelihood.blocks import Log

_NEIGHBOURS = 9  # readings; a jump that stays for more than half of them is none of one reading
_FAR = 30.0  # usual distances from the neighbours' median
_USUAL = 0.9  # quantile of the distances


def without_strays(log: Log) -> Log:
    """The log, readings unmeasured (NaN) that are far from the median of those around them."""
    return replace(log, outputs=np.array([_without(row) for row in log.outputs]))


def _without(row: FloatArray) -> FloatArray:
    measured = np.flatnonzero(np.isfinite(row))
    off = np.abs(row[measured] - median_filter(row[measured], _NEIGHBOURS, mode="nearest"))
    usual = np.quantile(off, _USUAL)
    kept = row.copy()
    if usual > 0.0:
        kept[measured[off > _FAR * usual]] = np.nan
    return kept
