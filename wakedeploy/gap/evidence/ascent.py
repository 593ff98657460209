"""The way up a likelihood: Levenberg and Marquardt's steps between bounds.

In: a `Model`, a hypothesis and where to begin. Out: a `Fit`, or slopes at some parameters.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import lsq_linear

from wakedeploy.gap.evidence.fits import (
    FLAT,
    Fit,
    FloatArray,
    Free,
    Hypothesis,
    Model,
    Score,
    Slopes,
    bounds_of,
    densities,
    log_prior,
    neutral,
    prior_precision,
    scores_of,
    sets_at_once,
)

ENOUGH_NATS = 0.05  # a step that promises less ends a fit
_ITERATIONS = 24  # most climbs take under ten; from far away, with loud noise, twelve are too few
# Steps keep slopes until they have gained this much together; those of the form, nearly linear, for
# longer, and always while the climb is far away.
_SETTLED_NATS, _FORM_SETTLED_NATS, _FAR_NATS = 2.0, 20.0, 200.0
# A climb that slows to steps of this many nats is given up where its promise, times the optimism,
# is less than it has to reach. Faster ones come from far away, where promises are too small.
_SLOW_NATS, OPTIMISM = 30.0, 3.0
_SHORTER = 3  # steps that are scored beside one, in case it gains nothing
# Along a ridge: the share of its step that a finite difference reaches, the dampings of steps, the
# points looked back to, and how many times farther than from there the climb goes.
_NEAR = 0.01
_DAMPINGS = tuple(10.0**power for power in range(-12, -2))
_LIMITS = (1e-8, 1e-6, 1e-4, 1e-2)  # of curvature along a ridge, as shares of the largest
_PASSED, _FARTHER = (1, 2, 4), (1.0, 3.0, 10.0, 30.0, 100.0)


class Ascent:
    """Levenberg–Marquardt on the log posterior.

    The expected information is too little curvature where the noise is not what the model assumes.
    A climb with fresh slopes learns from its steps what is lacking (Dennis, Gay and Welsch 1981).
    It then ends at the top; without this, climbs stop on the way along a ridge.
    """

    def __init__(
        self,
        model: Model,
        hypothesis: Hypothesis,
        free: tuple[Free, ...],
        episodes: tuple[int, ...],
        moving: Sequence[int] | None,
        least: float,
        enough_nats: float | None = None,
    ) -> None:
        self._model, self._hypothesis, self._free = model, hypothesis, free
        self._episodes, self._moving, self._least = episodes, moving, least
        self._is_fresh = enough_nats is not None
        self._enough_nats = ENOUGH_NATS if enough_nats is None else enough_nats
        self._lacking = np.zeros((len(free), len(free)))  # curvature that the information lacks
        self._gained = np.zeros(len(free))  # nats since each parameter's slopes were renewed
        self._precision = prior_precision(free)
        self._centre = neutral(free)
        self._room = sets_at_once(model, episodes)
        self._ahead: dict[bytes, tuple[Score, ...]] = {}  # scores by the parameters' bytes

    def run(self, theta: FloatArray, slopes: Slopes | None) -> Fit:
        """The fit reached from parameters (p,); `slopes` are those known there, if any."""
        slopes = slopes if slopes is not None else self.slopes(theta, None)
        value = self._objective(slopes.scores, theta)
        damping, converged, gained = 1e-3, False, np.inf
        for _ in range(_ITERATIONS):
            tried, promised = self._tried(slopes, theta, damping)
            if promised < self._enough_nats:
                converged = True
                break
            if gained < _SLOW_NATS and value + OPTIMISM * promised < self._least:
                break
            self._look_ahead(slopes, theta, tried, promised, damping)
            scores = self._scores(tried)
            reached = self._objective(scores, tried)
            if not reached > value:
                damping = _shorter(damping)
                if damping > 1e4:
                    break
                continue
            gained, value, before = reached - value, reached, (slopes, theta)
            damping = max(0.2 * damping, 1e-6)
            slopes, theta = self._renewed(slopes, tried, scores, gained), tried
            if self._is_fresh:
                self._learn(*before, slopes, theta)
        return self._fitted(theta, slopes, converged)

    def along_ridge(self, theta: FloatArray) -> Fit:
        """The fit reached along a narrow ridge, where a damped step is short and others fall off.

        Slopes show a direction that leaves the ridge before long, and steps go from side to side.
        From a point on it to a later one is a better direction (Hooke and Jeeves 1961); steps of
        all dampings, steps along the ridge alone and points farther on from where the climb has
        passed are scored together. Its finite differences are short; those of the fit are not, as
        some likelihoods are jagged.
        """
        low, high = bounds_of(self._free)
        slopes, passed, converged = self.slopes(theta, None, share=_NEAR), [theta], False
        value = self._objective(slopes.scores, theta)
        for _ in range(_ITERATIONS):
            tried = [self._tried(slopes, theta, damping)[0] for damping in _DAMPINGS]
            tried += [np.clip(theta + step, low, high) for step in self._steps_along(slopes, theta)]
            behind = [passed[-1 - back] for back in _PASSED if back < len(passed)]
            tried += [
                np.clip(theta + times * (theta - point), low, high)
                for point in behind
                for times in _FARTHER
            ]
            best, scores, reached = self._best_of(np.array(tried))
            if not reached - value > self._enough_nats:
                converged = True
                break
            before, value, theta = (slopes, theta), reached, best
            slopes = self.slopes(theta, None, scores, share=_NEAR)
            self._learn(*before, slopes, theta)
            passed.append(theta)
        return self._fitted(theta, self.slopes(theta, None, slopes.scores), converged)

    def _best_of(self, tried: FloatArray) -> tuple[FloatArray, tuple[Score, ...], float]:
        """The best of some points (K, p), its scores and its height; no other scores are kept."""
        best: tuple[FloatArray, tuple[Score, ...], float] = (tried[0], (), -np.inf)
        at_once = max(self._room, 1)
        for first in range(0, len(tried), at_once):
            self._ahead = {}
            some = tried[first : first + at_once]
            for there, scores in zip(some, self._many(some), strict=True):
                value = self._objective(scores, there)
                best = (there, scores, value) if value > best[2] else best
        self._ahead = {}
        return best

    def _steps_along(self, slopes: Slopes, theta: FloatArray) -> list[FloatArray]:
        """Steps in the directions of little curvature alone, for several limits and lengths.

        Across a ridge a gradient that is off by little, as one that leaves out how strays are
        weighed, throws a whole step off it.
        """
        gradient, curvature = self._gradient(slopes, theta), self._information(slopes)
        if not (np.isfinite(gradient).all() and np.isfinite(curvature).all()):
            return []
        scale = 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300))
        values, vectors = np.linalg.eigh(curvature * np.outer(scale, scale))
        lengths = (vectors.T @ (scale * gradient)) / np.maximum(values, FLAT * values[-1])
        return [
            share * scale * (vectors @ np.where(values < limit * values[-1], lengths, 0.0))
            for limit in _LIMITS
            for share in (1.0, 0.3)
        ]

    def _fitted(self, theta: FloatArray, slopes: Slopes, converged: bool) -> Fit:
        per_episode = densities(slopes.scores)
        return Fit(
            self._hypothesis, self._free, self._episodes, theta, slopes, per_episode,
            converged=converged,
        )  # fmt: skip

    def _renewed(
        self, slopes: Slopes, theta: FloatArray, scores: tuple[Score, ...], gained: float
    ) -> Slopes:
        """Slopes with fresh columns for the parameters that are due; all scores are new.

        Those of the form, which is nearly linear, wait until the climb is no longer far away.
        """
        if self._is_fresh:
            return self.slopes(theta, None, scores)
        due = self._due(gained)
        if self._moving is None:
            self._gained += gained
            self._gained[due] = 0.0
        return self.slopes(theta, (slopes, due), scores)

    def _due(self, gained: float) -> Sequence[int]:
        """The parameters whose slopes are renewed after a step that gained this many nats."""
        if self._is_fresh:
            return range(len(self._free))
        if self._moving is not None:
            return self._moving
        is_form = np.array([f.is_form for f in self._free])
        due = self._gained + gained > np.where(is_form, _FORM_SETTLED_NATS, _SETTLED_NATS)
        due &= ~(is_form & (gained > _FAR_NATS))
        return [int(i) for i in np.flatnonzero(due)]

    def _look_ahead(
        self,
        slopes: Slopes,
        theta: FloatArray,
        tried: FloatArray,
        promised: float,
        damping: float,
    ) -> None:
        """Score a step together with what may be asked for next: its slopes, and shorter steps.

        Only a model that scores many sets in about the time of one does this; the result is the
        same.
        """
        if tried.tobytes() in self._ahead:
            return
        self._ahead = {}
        if self._room < 1 + _SHORTER:
            return
        sets = [tried]
        for _ in range(_SHORTER):
            damping = _shorter(damping)
            sets.append(self._tried(slopes, theta, damping)[0])
        beside = [aside(tried, self._free, c)[0] for c in self._due(promised)]
        if len(sets) + len(beside) <= self._room:
            sets += beside
        self._many(np.array(sets))

    def _tried(self, slopes: Slopes, theta: FloatArray, damping: float) -> tuple[FloatArray, float]:
        """Where a step leads, (p,), and the nats that it promises."""
        gradient, information = self._gradient(slopes, theta), self._information(slopes)
        low, high = bounds_of(self._free)
        extra = np.diag(damping * np.diag(information))
        curvature = information
        if self._is_fresh and _is_convex(information + self._lacking + extra):
            curvature = information + self._lacking
        tried = top_within(theta, gradient, curvature + extra, low, high)
        step = tried - theta
        return tried, float(gradient @ step - 0.5 * step @ curvature @ step)

    def _learn(
        self, slopes: Slopes, theta: FloatArray, slopes_there: Slopes, there: FloatArray
    ) -> None:
        """Learn what the information lacks from how the gradient changed along a step."""
        step = there - theta
        bend = self._gradient(slopes, theta) - self._gradient(slopes_there, there)
        missing = bend - self._information(slopes_there) @ step
        known = abs(float(step @ self._lacking @ step))
        if known > 0.0:
            self._lacking *= min(1.0, abs(float(step @ missing)) / known)
        along = float(bend @ step)
        if along > 0.0:
            rest = missing - self._lacking @ step
            both = np.outer(rest, bend) / along
            self._lacking += both + both.T - (rest @ step) * np.outer(bend, bend) / along**2

    def _gradient(self, slopes: Slopes, theta: FloatArray) -> FloatArray:
        """The gradient of the log posterior, (p,)."""
        gradient = slopes.gradient().sum(0) - self._precision * (theta - self._centre)
        return np.asarray(gradient)

    def _information(self, slopes: Slopes) -> FloatArray:
        """The information of all episodes and the prior, (p, p)."""
        return np.asarray(slopes.fisher().sum(0) + np.diag(self._precision))

    def _objective(self, scores: Sequence[Score], theta: FloatArray) -> float:
        return sum(float(s.log_density.sum()) for s in scores) + log_prior(self._free, theta)

    def _scores(self, theta: FloatArray) -> tuple[Score, ...]:
        return self._many(theta[None])[0]

    def _many(self, thetas: FloatArray) -> list[tuple[Score, ...]]:
        """All episodes under several parameter sets, in one call where the model can."""
        known = [theta.tobytes() for theta in thetas]
        unknown = {k: theta for k, theta in zip(known, thetas, strict=True) if k not in self._ahead}
        if unknown:
            sets = np.array(list(unknown.values()))
            found = scores_of(self._model, self._hypothesis, sets, self._episodes)
            self._ahead |= dict(zip(unknown, found, strict=True))
        return [self._ahead[k] for k in known]

    def slopes(
        self,
        theta: FloatArray,
        known: tuple[Slopes, Sequence[int]] | None,
        scores: tuple[Score, ...] | None = None,
        *,
        share: float = 1.0,
    ) -> Slopes:
        """All slopes fresh, or `known` ones with some columns renewed.

        Finite differences reach a `share` of the parameters' steps.
        """
        columns = range(len(theta)) if known is None else known[1]
        moved = [aside(theta, self._free, column, share) for column in columns]
        sets = [m for m, _ in moved]
        if scores is None:
            *beside, here = self._many(np.array([*sets, theta]))
        else:
            here, beside = scores, self._many(np.array(sets)) if moved else []
        innovation = _columns(here, len(theta), None if known is None else known[0].innovation)
        variance = _columns(here, len(theta), None if known is None else known[0].variance)
        for column, (_, size), scores in zip(columns, moved, beside, strict=True):
            for i, (s, there) in enumerate(zip(here, scores, strict=True)):
                innovation[i][:, column] = (there.innovation - s.innovation) / size
                variance[i][:, column] = (there.variance - s.variance) / size
        return Slopes(here, tuple(innovation), tuple(variance))


def slopes_at(
    model: Model,
    hypothesis: Hypothesis,
    episodes: Sequence[int],
    theta: FloatArray,
    known: tuple[Slopes, Sequence[int]] | None = None,
) -> Slopes:
    """Scores and derivatives at some parameters; of `known` ones, only some columns are renewed."""
    free = model.free(hypothesis)
    return Ascent(model, hypothesis, free, tuple(episodes), None, -np.inf).slopes(theta, known)


def parabola(fitted: Fit) -> tuple[FloatArray, FloatArray]:
    """The gradient (p,) and the curvature (p, p) of the log posterior, by a fit's slopes."""
    precision = prior_precision(fitted.free)
    pulled = precision * (fitted.theta - neutral(fitted.free))
    gradient = fitted.slopes.gradient().sum(0) - pulled
    return gradient, np.asarray(fitted.slopes.fisher().sum(0) + np.diag(precision))


def promised_nats(fitted: Fit) -> float:
    """What a fit's slopes promise of the way to the top; 0 where there are none, or no numbers."""
    if not fitted.slopes.innovation:
        return 0.0
    with np.errstate(all="ignore"):  # of a state that has left its model
        gradient, curvature = parabola(fitted)
    if not (np.isfinite(gradient).all() and np.isfinite(curvature).all()):
        return 0.0
    step = top_within(fitted.theta, gradient, curvature, *bounds_of(fitted.free)) - fitted.theta
    return float(gradient @ step - 0.5 * step @ curvature @ step)


def _columns(
    scores: Sequence[Score], count: int, known: Sequence[FloatArray] | None
) -> list[FloatArray]:
    if known is not None:
        return [k.copy() for k in known]
    return [np.zeros((len(s.innovation), count)) for s in scores]


def aside(
    theta: FloatArray, free: Sequence[Free], i: int, share: float = 1.0
) -> tuple[FloatArray, float]:
    """The parameters with one of them moved by its step, on the side that has room; that step.

    It is moved by a `share` of its step.
    """
    size = share * free[i].step
    size = size if theta[i] + size <= free[i].high else -size
    moved = theta.copy()
    moved[i] += size
    return moved, size


def top_within(
    theta: FloatArray,
    gradient: FloatArray,
    curvature: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """The top (p,) of a parabola around `theta` (p,) between bounds, arrays (p,).

    If a bound stops one parameter, the others go as far as that allows: cut off one by one, a step
    along a ridge would end beside it. By active sets (Stark and Parker 1995). A parameter that a
    bound stops is exactly at it. A parameter without room stays; all stay if slopes are not finite.
    """
    top, free = theta.copy(), np.flatnonzero(low < high)
    theta, gradient, curvature = theta[free], gradient[free], curvature[np.ix_(free, free)]
    if not (len(free) and np.isfinite(gradient).all() and np.isfinite(curvature).all()):
        return top
    low, high = low[free], high[free]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    values, vectors = np.linalg.eigh(curvature * scale[:, None] * scale[None, :])
    informed = values > FLAT * values[-1]
    root, axes = np.sqrt(values[informed]), vectors[:, informed].T
    aim = axes @ (scale * gradient) / root
    step = axes.T @ (aim / root)
    lowest = np.minimum(low - theta, 0.0) / scale
    highest = np.maximum(high - theta, 0.0) / scale
    if (step < lowest).any() or (step > highest).any():
        step = lsq_linear(root[:, None] * axes, aim, (lowest, highest), method="bvls").x
    moved = np.clip(theta + scale * step, low, high)
    is_low, is_high = step < lowest + FLAT, step > highest - FLAT
    top[free] = np.where(is_low, low, np.where(is_high, high, moved))
    return top


def _shorter(damping: float) -> float:
    """The damping after a step that gained nothing."""
    return max(10.0 * damping, 1e-2)


def _is_convex(matrix: FloatArray) -> bool:
    """Whether a parabola of this symmetric curvature has a top."""
    scale = np.diag(matrix)
    if not (scale > 0.0).all():
        return False
    return bool(np.linalg.eigvalsh(matrix / np.sqrt(np.outer(scale, scale)))[0] > FLAT)
