"""What effects do to the innovations of a log at any size, nuisances readjusted.

In: a `LogModel`, its base fit, parameters of effects. Out: whitened changes with everything removed
that nuisances imitate within their priors. Half their squared length is what an effect gains, half
the squared distance to a rival's nearest change what the rival loses [nats]. A rival takes any of
its sizes: a small lag and a small dead time do the same, large ones do not.
"""

from collections.abc import Sequence

import numpy as np

from wakedeploy.gap.evidence.fits import (
    LOST_NATS,
    Fit,
    FloatArray,
    Score,
    extended,
    own_places,
    prior_precision,
    scores_of,
)
from wakedeploy.gap.evidence.separation import whitened
from wakedeploy.gap.systems.likelihood.logs import LogModel

GRID = 10.0 ** np.linspace(-4.0, 1.5, 12)  # multiples of the size at an effect's start


class Responses:
    """The log and the base around which effects are looked at."""

    def __init__(self, model: LogModel, base: Fit) -> None:
        self.model, self.base = model, base
        known = np.concatenate(whitened(base.slopes))
        prior = np.diag(np.sqrt(prior_precision(base.free)))
        q, _ = np.linalg.qr(np.vstack([known, prior]))
        self._known = q
        rest = [
            [-s.white, np.sqrt(0.5 * s.weight) * (s.innovation**2 / s.variance - 1.0)]
            for s in base.slopes.scores
        ]
        self.rest = self._residual(np.concatenate([part for parts in rest for part in parts]))

    def usual(self, name: str) -> FloatArray:
        """Parameters of an effect at each of its starts, (S, p)."""
        starts = [f.starts or (f.neutral,) for f in self.model.effects[name]]
        count = max(len(s) for s in starts)
        return np.array([[s[min(k, len(s) - 1)] for s in starts] for k in range(count)])

    def scaled(self, name: str, points: FloatArray, factors: FloatArray) -> FloatArray:
        """Points (S, p) at multiples of their sizes, shapes as they are, (S, g, p), in bounds."""
        free = self.model.effects[name]
        multiples = np.repeat(points[:, None, :], len(factors), axis=1)
        for k, f in enumerate(free):
            if f.neutral == 0.0:
                multiples[:, :, k] *= factors
            multiples[:, :, k] = np.clip(multiples[:, :, k], f.low, f.high)
        return multiples

    def of(self, name: str, points: FloatArray) -> FloatArray:
        """What is left of the changes at parameters (K, p): (K, 2n + nuisances).

        NaN where the system leaves its model.
        """
        base, hypothesis = self.base, (*self.base.hypothesis, name)
        free = self.model.free(hypothesis)
        places = own_places(free, name)
        thetas = np.tile(extended(base, free), (len(points) + 1, 1))  # the last is without it
        thetas[:-1, places] = points
        *moved, without = scores_of(self.model, hypothesis, thetas, base.episodes)
        return np.array([self._residual(self._change(without, scores)) for scores in moved])

    def _change(self, without: Sequence[Score], moved: Sequence[Score]) -> FloatArray:
        parts = []
        for score, origin, there in zip(self.base.slopes.scores, without, moved, strict=True):
            root = np.sqrt(score.weight)
            innovation = there.innovation - origin.innovation
            stretch = (there.variance - origin.variance) / score.variance
            if there.log_density.min(initial=0.0) <= LOST_NATS:
                innovation = np.full_like(innovation, np.nan)
            parts += [root * innovation / np.sqrt(score.variance), root * stretch / 2.0**0.5]
        return np.concatenate(parts)

    def _residual(self, row: FloatArray) -> FloatArray:
        """A change less what nuisances make of it; what that costs their priors comes behind it."""
        padded = np.concatenate([row, np.zeros(len(self._known) - len(row))])
        return np.asarray(padded - self._known @ (self._known[: len(row)].T @ row))


def lost_nats(truth: FloatArray, curves: FloatArray) -> float:
    """What a rival loses when a change (m,) is the truth: half the squared distance to its nearest.

    `curves` (S, g, m) are its changes at rising sizes, joined by straight lines, from none on.
    """
    least = 0.5 * float(truth @ truth)
    for curve in curves:
        begin = np.vstack([np.zeros(len(truth)), curve[:-1]])
        along = curve - begin
        length = np.maximum((along**2).sum(1), 1e-300)
        part = np.clip(((truth - begin) * along).sum(1) / length, 0.0, 1.0)
        off = truth - begin - part[:, None] * along
        least = min(least, 0.5 * float((off**2).sum(1).min()))
    return least
