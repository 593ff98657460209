"""Where the fit of a system starts if nobody has measured some of its constants.

In: a `Comparison` and episodes. Out: a start. A constant of unlimited spread says nothing about its
size, and a climb from far away ends on the nearest summit; so points within a decade of the
stated values are tried first, all in one run, and the best of them race.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import qmc

from wakedeploy.gap.evidence.fits import (
    NO_SLOPES,
    Fit,
    FloatArray,
    Free,
    densities,
    neutral,
    scores_of,
)
from wakedeploy.gap.search.climbing import height, raced
from wakedeploy.gap.search.comparison import Comparison

_TRIED, _RACED = 32, 3  # points, and how many of them are climbed
_DECADES = 1.0
_EVERY = 3  # one episode in three is enough to choose points by


def beginning(model: Comparison, episodes: Sequence[int]) -> FloatArray:
    """Parameters (p,) from which to climb, of the system without effects."""
    free = model.free(())
    start, points = neutral(free), points_around(model, ())
    if len(points) == 0:
        return start
    some = tuple(episodes)[:: _EVERY if len(episodes) > _EVERY else 1]
    scores = scores_of(model, (), points, some)
    fits = [
        Fit((), free, some, theta, NO_SLOPES, densities(each))
        for theta, each in zip(points, scores, strict=True)
    ]
    order = sorted(fits, key=lambda f: -height(f))
    better = [f for f in order[:_RACED] if f.objective > fits[0].objective]
    if not better:
        return start
    return max(raced(model, fits[0], [fits[0], *better]), key=lambda f: f.objective).theta


def points_around(model: Comparison, hypothesis: tuple[str, ...]) -> FloatArray:
    """Points (K, p) with unmeasured constants around their values; (0, p) if all are measured."""
    free = model.free(hypothesis)
    unknown = [i for i, f in enumerate(free) if _is_unmeasured(f)]
    if not unknown:
        return np.zeros((0, len(free)))
    return _around(neutral(free), free, unknown)


def _is_unmeasured(free: Free) -> bool:
    return free.name.startswith("constant.") and np.isinf(free.prior_sd) and free.neutral != 0.0


def _around(start: FloatArray, free: Sequence[Free], unknown: Sequence[int]) -> FloatArray:
    """The start, and points evenly spread within a decade of it, (K, p)."""
    spread = qmc.Halton(len(unknown), seed=0).random(_TRIED)
    points = np.tile(start, (_TRIED + 1, 1))
    for column, i in enumerate(unknown):
        drawn = start[i] * 10.0 ** (_DECADES * (2.0 * spread[:, column] - 1.0))
        points[1:, i] = np.clip(drawn, free[i].low, free[i].high)
    return points
