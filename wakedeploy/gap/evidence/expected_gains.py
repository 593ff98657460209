"""How much effects would gain, from the slopes of a fit, without fitting any of them.

In: a model, a fit, names of effects that are linear in their parameters. Out: nats on the episodes
of the fit with all free parameters readjusted: half the score statistic (Rao 1948).
"""

import math
from collections.abc import Sequence

import numpy as np

from wakedeploy.gap.evidence.fits import (
    Fit,
    FloatArray,
    Free,
    Model,
    Score,
    extended,
    own_parameters,
    own_places,
)
from wakedeploy.gap.evidence.ranking import BENT_NATS, bent_quantities

_NO_SLOPE_NATS = 1e-9


def promises(model: Model, base: Fit, names: Sequence[str]) -> FloatArray:
    """The nats (T,) that each term would gain on the fit's episodes, by its slopes at zero."""
    slopes = base.slopes
    parts = zip(slopes.scores, slopes.innovation, slopes.variance, strict=True)
    shared = np.vstack([_white_slopes(*each) for each in parts])
    prior = np.diag([1.0 / f.prior_sd for f in base.free])
    held, _ = np.linalg.qr(np.vstack([shared, prior]))
    held = held[: len(shared)]
    rest = np.concatenate([_white_rest(score) for score in slopes.scores])
    rest = rest - held @ (held.T @ rest)
    return np.array([_promise(model, base, name, held, rest) for name in names])


def worth_trying(model: Model, base: Fit, names: Sequence[str], least_nats: float) -> list[str]:
    """The names without those whose slopes at the neutral point promise less than `least_nats`.

    Always kept are effects without a slope there or with a jagged likelihood, and those that move a
    calibrated constant which the fit has bent; all are kept if the fit has bent its calibration as
    a whole.
    """
    if base.calibration_log_prior < BENT_NATS:
        return list(names)
    bent = bent_quantities(base)
    kept = []
    for name, promised in zip(names, promises(model, base, names), strict=True):
        free = model.free((*base.hypothesis, name))
        parameters = own_parameters(free, name)
        moves, is_jagged = {f.quantity for f in parameters}, any(f.scanned for f in parameters)
        if promised > least_nats or promised < _NO_SLOPE_NATS or moves & bent or is_jagged:
            kept.append(name)
    return kept


def _promise(model: Model, base: Fit, name: str, held: FloatArray, rest: FloatArray) -> float:
    """Half the squared length of `rest` along the term's own directions."""
    hypothesis = (*base.hypothesis, name)
    free = model.free(hypothesis)
    theta = extended(base, free)
    places = own_places(free, name)
    columns = [_direction(model, base, hypothesis, theta, free, i) for i in places]
    span = np.stack(columns, axis=1)
    span = span - held @ (held.T @ span)
    prior = np.diag([1.0 / free[i].prior_sd ** 2 for i in places])
    pull = span.T @ rest
    return 0.5 * float(pull @ np.linalg.solve(span.T @ span + prior, pull))


def _direction(
    model: Model,
    base: Fit,
    hypothesis: tuple[str, ...],
    theta: FloatArray,
    free: Sequence[Free],
    column: int,
) -> FloatArray:
    moved = theta.copy()
    moved[column] += free[column].step
    parts = []
    for episode, score in zip(base.episodes, base.slopes.scores, strict=True):
        there = model.score(hypothesis, moved, episode)
        de = (there.innovation - score.innovation) / free[column].step
        dv = (there.variance - score.variance) / free[column].step
        parts.append(_white_slopes(score, de[:, None], dv[:, None])[:, 0])
    return np.concatenate(parts)


def _white_slopes(score: Score, de: FloatArray, dv: FloatArray) -> FloatArray:
    """Slopes (2n, p) whose products are the Fisher information."""
    root = np.sqrt(score.weight)[:, None]
    variance = score.variance[:, None]
    return np.vstack([-root * de / np.sqrt(variance), root * dv / (variance * math.sqrt(2.0))])


def _white_rest(score: Score) -> FloatArray:
    """What the slopes are multiplied by to give the gradient, (2n,)."""
    squares = np.sqrt(0.5 * score.weight) * (score.innovation**2 / score.variance - 1.0)
    return np.concatenate([score.white, squares])
