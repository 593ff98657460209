"""Hypotheses fitted by maximum likelihood, and judged on episodes that they were not fitted to.

In: a `Model`, which scores one episode under a hypothesis, sample by sample. Out: fits with
intervals, and held-out gains: leaving an episode out is one more Newton step from the common
optimum.
"""

from collections.abc import Sequence

import numpy as np

from wakedeploy.gap.evidence.ascent import ENOUGH_NATS, Ascent, promised_nats
from wakedeploy.gap.evidence.fits import (
    LOST_NATS,
    Fit,
    FloatArray,
    Hypothesis,
    Model,
    Slopes,
    bounds_of,
    densities,
    neutral,
    prior_precision,
    scores_of,
    solved,
)

_FARTHEST = 16.0  # square of a leave-one-out step in standard deviations, all directions together
_IMPLAUSIBLE = 2.0  # times what an episode gains: a parabola that loses more is looked into
_MUCH_NATS = 10.0  # the least gain that this counts from
_RISEN_NATS, _MOST_REFITS = 0.1, 4  # a smaller rise ends the repeats of a fit; how many there are
_ON_RIDGE_NATS = 1.0  # what slopes promise where a climb has stopped on its way
_WORSE = 1.1  # times the squared error of forecasts that there was: the way was not a ridge's
_AT_REST_SD = 0.1  # a size that a repeated fit moves by less has come to rest


def fit(
    model: Model,
    hypothesis: Hypothesis,
    episodes: Sequence[int],
    start: FloatArray | None = None,
    slopes: Slopes | None = None,
    moving: Sequence[int] | None = None,
    least: float = -np.inf,
    enough_nats: float | None = None,
) -> Fit:
    """Maximise log likelihood plus log priors over the hypothesis's parameters.

    `start` (p,) is where to begin (the neutral values if None). `slopes`, if they are known there,
    save a round. With `moving`, only those parameters' slopes are renewed on the way, which is
    enough to tell a contender from the rest. A climb that will not reach an objective of `least` is
    given up, not converged. With `enough_nats` all slopes are renewed at every step, and a climb
    that converges is within about that much of a summit, but on a narrow ridge: see `settled`.
    """
    free = model.free(hypothesis)
    theta = neutral(free) if start is None else np.clip(start, *bounds_of(free))
    chosen = tuple(episodes)
    ascent = Ascent(model, hypothesis, free, chosen, moving, least, enough_nats)
    return ascent.run(theta, slopes)


def settled(model: Model, fitted: Fit) -> tuple[Fit, bool]:
    """A fit repeated from where it ended, and whether its effects' sizes have come to rest.

    They have if it no longer rises, or if the rise moves no size against its standard error: noise
    may creep on for long, and how far it gets depends on how a processor rounds. Where nothing
    rises any more and slopes promise something all the same, a fit is on a ridge, and goes along
    it: a constant that has bent to what is missing comes back beside it. It stays where it is if
    the way rises more than promised, and forecasts get worse: it then leads to another summit, as
    that at which strong short pushes move a servo that its command hardly moves. It is at rest
    then: what its slopes promise is not on its own summit.
    """
    fitted, is_at_rest = _repeated(model, fitted)
    promised = promised_nats(fitted) if is_at_rest else 0.0
    if promised > _ON_RIDGE_NATS:
        free, episodes = fitted.free, fitted.episodes
        ridge = Ascent(model, fitted.hypothesis, free, episodes, None, -np.inf, ENOUGH_NATS)
        farther = ridge.along_ridge(fitted.theta)
        is_along = farther.objective - fitted.objective <= promised
        if is_along or not _forecasts_get_worse(model, fitted, farther):
            return farther, farther.converged
    return fitted, is_at_rest


def _forecasts_get_worse(model: Model, before: Fit, after: Fit) -> bool:
    """Whether squared errors of forecasts rise, on average over channels, or one is no number now.

    A model with a method `disagreements` forecasts: it says what a fit predicts wrongly. A channel
    counts by its larger error of the two, so that one without error decides no more than others.
    """
    disagreements = getattr(model, "disagreements", None)
    if disagreements is None:
        return False
    was, now = (np.concatenate(disagreements(f, f.episodes), axis=1) for f in (before, after))
    if np.any(np.isfinite(was) & ~np.isfinite(now)):
        return True
    both = np.isfinite(was) & np.isfinite(now)
    sums = [np.square(np.where(both, errors, 0.0)).sum(axis=1) for errors in (was, now)]
    larger = np.maximum(*sums)
    larger[larger == 0.0] = 1.0
    return bool(np.sum(sums[1] / larger) > _WORSE * np.sum(sums[0] / larger))


def _repeated(model: Model, fitted: Fit) -> tuple[Fit, bool]:
    moved = np.inf
    for _ in range(_MOST_REFITS):
        again = fit(
            model, fitted.hypothesis, fitted.episodes, fitted.theta, enough_nats=ENOUGH_NATS
        )
        rise, moved, fitted = again.objective - fitted.objective, _moved_sd(fitted, again), again
        if rise < _RISEN_NATS:
            return fitted, True
    return fitted, moved < _AT_REST_SD


def _moved_sd(before: Fit, after: Fit) -> float:
    """How far the effects' parameters moved, in standard errors: the largest of them."""
    sizes = [n for n in after.names if n.startswith(tuple(f"{e}." for e in after.hypothesis))]
    moved = (
        abs(after.value(n) - before.value(n)) / max(after.standard_error(n), 1e-300) for n in sizes
    )
    return max(moved, default=0.0)


def applied(model: Model, fitted: Fit, episodes: Sequence[int] | None = None) -> Fit:
    """A fit's hypothesis and parameters on episodes of `model` (default: all), without fitting."""
    episodes = tuple(range(model.episodes) if episodes is None else episodes)
    scores = tuple(model.score(fitted.hypothesis, fitted.theta, e) for e in episodes)
    slopes = Slopes(scores, (), ())
    return Fit(fitted.hypothesis, fitted.free, episodes, fitted.theta, slopes, densities(scores))


def held_out(base: Fit, larger: Fit, model: Model | None = None) -> FloatArray:
    """What a larger hypothesis adds to each episode's log density, not having seen it, (E,) nats.

    Only the larger one's own parameters are left out: they are those that the other episodes
    prefer, with noise and calibration following them as all episodes say. Both hypotheses have
    fitted noise and calibration; leaving these out as well would add little to the difference but
    scatter. A calibrated constant that an effect takes over counts as the effect's own. The method
    is one Newton step from the common optimum, exact for a quadratic log density (as in the
    efficient score: Neyman 1959). Where such a step loses implausibly much, as across the jump of a
    sensor that is cut, `model` is asked at its end, if it is given.

    With one episode nothing can be left out; each parameter then costs one nat (Akaike 1974).
    Raises ValueError where the fits are of different episodes.
    """
    if base.episodes != larger.episodes:
        raise ValueError(f"fitted to {base.episodes} and to {larger.episodes}: not comparable")
    places = [i for i, n in enumerate(larger.names) if n not in set(base.names)]
    seen = larger.per_episode - base.per_episode
    if len(larger.episodes) < 2:
        return seen - len(places)
    return seen - _flattery(larger, places, seen, model)


def gain_over(base: Fit, larger: Fit) -> float:
    """What a larger hypothesis gains on episodes held out, priors included [nats]."""
    return float(held_out(base, larger).sum()) + larger.log_prior - base.log_prior


def _flattery(
    fitted: Fit, places: Sequence[int], seen: FloatArray, model: Model | None
) -> FloatArray:
    """The nats (E,) by which parameters fit each episode too well, having been fitted to it.

    Where a prediction jumps, a finite difference is no slope and its parabola means nothing: if one
    loses implausibly much, `model` says what is lost at the end of the step. No episode loses more
    than the worst sample can.
    """
    gradient, fisher = fitted.slopes.gradient(), fitted.slopes.fisher()
    prior = np.diag(prior_precision(fitted.free))
    total = fisher.sum(0) + prior
    low, high = bounds_of(fitted.free)
    fixed = (fitted.theta <= low) | (fitted.theta >= high)
    places = [i for i in places if not fixed[i]]  # at its bound a parameter follows no episode
    if not places:
        return np.zeros(len(gradient))
    shared = [i for i in range(len(total)) if i not in set(places) and not fixed[i]]
    follow = np.column_stack(
        [solved(total[np.ix_(shared, shared)], total[shared, i]) for i in places]
    )  # (s, k): how far the shared parameters go with the own ones
    along = np.zeros((len(total), len(places)))
    along[places, range(len(places))] = 1.0
    along[shared] = -follow
    pull = gradient @ along  # (E, k)
    curvature = along.T @ fisher @ along  # (E, k, k)
    stated = along.T @ prior @ along
    lost = np.zeros(len(gradient))
    for e, (u, j) in enumerate(zip(pull, curvature, strict=True)):
        rest = np.delete(curvature, e, axis=0).sum(0) + stated  # no difference of large numbers
        step = solved(rest, -u)
        step *= min(1.0, (_FARTHEST / max(float(step @ rest @ step), 1e-12)) ** 0.5)
        lost[e] = min(0.5 * float(step @ j @ step) - float(u @ step), -LOST_NATS)
        if model is not None and lost[e] > _IMPLAUSIBLE * max(seen[e], _MUCH_NATS):
            lost[e] = _lost(model, fitted, e, np.clip(fitted.theta + along @ step, low, high))
    return lost


def _lost(model: Model, fitted: Fit, place: int, theta: FloatArray) -> float:
    """What one of a fit's episodes loses with other parameters (p,) [nats]."""
    ((score,),) = scores_of(
        model, fitted.hypothesis, theta[None], fitted.episodes[place : place + 1]
    )
    lost = np.nan_to_num(fitted.per_episode[place] - score.log_density.sum(), nan=-LOST_NATS)
    return float(np.clip(lost, 0.0, -LOST_NATS))
