"""Candidates fitted beside each other: those that fall far behind are not fitted to the end.

In: a `Comparison` and points. Out: fits. A step is tried with several dampings in one run over the
logs: a run with several parameter sets costs little more than one with a single set.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wakedeploy.gap.evidence.ascent import aside, parabola, top_within
from wakedeploy.gap.evidence.fits import (
    NO_SLOPES,
    Fit,
    FloatArray,
    Score,
    Slopes,
    bounds_of,
    densities,
    log_prior,
    scores_of,
)
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.search.comparison import Comparison

DAMPINGS = (1e-3, 0.1, 1.0, 10.0)
_DAMPED = (DAMPINGS, (100.0, 1e3, 1e4))  # the second three where the first only fall
_NEARLY_LINEAR = ("form.",)
_MOST = 10  # steps of a climb
_ENOUGH_NATS = 0.3  # a step that gains less ends a climb
_RACED = 2  # steps after which those that fall behind stop
_BEHIND = 0.5  # share of what the best has gained that another must have
NEAR_NATS = 15.0  # none this near to the best has fallen behind


def raced(model: Comparison, base: Fit, starts: Sequence[Fit]) -> list[Fit]:
    """Fits from all starts; one that soon gains much less than the best is stopped there."""
    fits, rising = [fresh(model, start, start.theta) for start in starts], [True] * len(starts)
    for step in range(_MOST):
        best = max((f.objective for f in fits), default=0.0) - base.objective
        for i, fitted in enumerate(fits):
            gained = fitted.objective - base.objective
            behind = step >= _RACED and gained < min(_BEHIND * best, best - NEAR_NATS)
            if rising[i] and not behind:
                fits[i], rise = advanced(model, fitted)
                rising[i] = rise > _ENOUGH_NATS
    return fits


def contending(base: Fit, fits: Mapping[str, Fit]) -> list[str]:
    """The names of the fits that have not fallen behind the best one."""
    gained = {name: height(f) - base.objective for name, f in fits.items()}
    best = max(gained.values(), default=0.0)
    return [n for n, gain in gained.items() if gain > min(_BEHIND * best, best - NEAR_NATS)]


def to_the_end(model: Comparison, base: Fit, points: Sequence[FloatArray], fitted: Fit) -> Fit:
    """The best of a candidate's fit and of climbs from its sizes at points (p,), else the base.

    A race ends where steps get short, and along a curved valley that is far below the summit. A
    climb that starts with the effect's size from the race or from before it, and all else as in the
    base, goes round most such valleys.
    """
    reached = [fitted]
    for theta in points:
        begin = sized(base, fitted, theta)
        reached.append(fit(model, fitted.hypothesis, fitted.episodes, begin))
    return settled(model, max(reached, key=lambda f: f.objective))[0]


def sized(base: Fit, fitted: Fit, theta: FloatArray) -> FloatArray:
    """A point (p,) with an effect's sizes from `theta` (p,), and all else as in the base."""
    known = dict(zip(base.names, base.theta, strict=True))
    return np.array([known.get(n, size) for n, size in zip(fitted.names, theta, strict=True)])


def climbed(model: Comparison, start: Fit) -> Fit:
    """A fit from a point."""
    return raced(model, start, [start])[0]  # alone, it falls behind none


def begun(model: Comparison, hypothesis: tuple[str, ...], like: Fit, theta: FloatArray) -> Fit:
    """A point of a hypothesis on another fit's blocks, without slopes yet."""
    free = model.free(hypothesis)
    return Fit(hypothesis, free, like.episodes, theta, NO_SLOPES, np.zeros(0))


def height(fitted: Fit) -> float:
    """How high a point is; one that has left the model is below all others [nats]."""
    return float(np.nan_to_num(fitted.objective, nan=-np.inf))


def advanced(model: Comparison, fitted: Fit) -> tuple[Fit, float]:
    """The fit after one step, with fresh slopes, and the nats that the step gained."""
    for dampings in _DAMPED:
        points = np.array([stepped(fitted, damping) for damping in dampings])
        scores = scores_of(model, fitted.hypothesis, points, fitted.episodes)
        reached = [_objective(fitted, p, s) for p, s in zip(points, scores, strict=True)]
        best = int(np.argmax(np.nan_to_num(reached, nan=-np.inf)))
        rise = reached[best] - fitted.objective
        if rise > 0.0:
            return fresh(model, fitted, points[best]), float(rise)
    return fitted, 0.0


def _objective(fitted: Fit, theta: FloatArray, scores: Sequence[Score]) -> float:
    return sum(float(s.log_density.sum()) for s in scores) + log_prior(fitted.free, theta)


def stepped(fitted: Fit, damping: float) -> FloatArray:
    """A step of Levenberg and Marquardt within the bounds."""
    gradient, curvature = parabola(fitted)
    curvature += damping * np.diag(np.diag(curvature))
    return top_within(fitted.theta, gradient, curvature, *bounds_of(fitted.free))


def fresh(model: Comparison, fitted: Fit, theta: FloatArray) -> Fit:
    """The fit at another point, with scores and slopes from one run.

    Slopes of the form, which is nearly linear, are kept where they are known.
    """
    known = fitted.slopes.innovation
    renewed = [
        i for i, f in enumerate(fitted.free) if not (known and f.name.startswith(_NEARLY_LINEAR))
    ]
    points, sizes = [theta], []
    for i in renewed:
        moved, size = aside(theta, fitted.free, i)
        points.append(moved)
        sizes.append(size)
    here, *beside = scores_of(model, fitted.hypothesis, np.array(points), fitted.episodes)
    innovation, variance = [], []
    for e, score in enumerate(here):
        shape = (len(score.innovation), len(fitted.free))
        de = known[e].copy() if known else np.zeros(shape)
        dv = fitted.slopes.variance[e].copy() if known else np.zeros(shape)
        for i, there, size in zip(renewed, beside, sizes, strict=True):
            de[:, i] = (there[e].innovation - score.innovation) / size
            dv[:, i] = (there[e].variance - score.variance) / size
        innovation.append(de)
        variance.append(dv)
    slopes = Slopes(here, tuple(innovation), tuple(variance))
    return replace(fitted, theta=theta, slopes=slopes, per_episode=densities(here))
