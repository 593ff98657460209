"""Which effects explain what a named one explains: rivals, told apart by evidence or by forecasts.

In: candidates with what each gains on every block, and the squared errors of their forecasts. Out:
the class that an answer has to name. A rival need neither improve forecasts enough to be named
itself nor gain more than chance: what counts is whether the recordings tell it from the one
that would be named. But what explains next to nothing is no rival: by then it has been decided that
something is missing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.gap.evidence.fits import (
    Fit,
    FloatArray,
    Free,
    densities,
    log_prior,
    own_parameters,
    scores_of,
)
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.comparison import Comparison, theta_from
from wakedeploy.gap.search.weighing import Weight, crossed, weight_of

_NEXT_TO_NOTHING = 0.1  # share of the best's gain


@dataclass(frozen=True, eq=False)
class Verdict:
    """A candidate of a round, why it is not named (or "accepted"), and what forecasts say.

    `squares` are the squared errors of its forecasts of each stretch (stretches, channels).
    `removes_most` says that it is evident by forecasts, whatever loud moments and single blocks do.
    """

    candidate: Candidate
    why: str
    weight: Weight | None = None
    squares: FloatArray | None = None
    removes_most: bool = False


def rivals_with(best: Candidate, other: Candidate) -> bool:
    """Whether blocks do not agree that the best gains more than another.

    What priors say of the parameters that each needs, mostly of bent constants, counts as well, and
    has no spread. Where a few blocks bring most of the best's gain, they hardly tell it from no
    effect either; so one that gains next to nothing is no rival, whatever the blocks' spread.
    """
    least = min(RULES.least_nats, _NEXT_TO_NOTHING * best.gain_nats)
    if other.gain_nats < least <= best.gain_nats - RULES.class_nats:
        return False
    apart, count = best.gains - other.gains, len(best.gains)
    reach = 0.0
    if count > 1:
        reach = (
            float(student_t.ppf(RULES.interval_quantile, count - 1))
            * float(apart.std(ddof=1))
            * count**0.5
        )
    return bool(best.gain_nats - other.gain_nats - reach < RULES.class_nats)


def is_companion(model: Comparison, found: Fit, best: Candidate, other: Candidate) -> bool:
    """Whether another gains beside the best one most of what it gains on top of a fit without it.

    Both then explain different things, and recordings hold evidence for each. It is looked at with
    its own sizes and all else as the best one has it, which can only gain less than a fit of both.
    """
    alone = other.fit.objective - found.objective
    hypothesis = (*best.fit.hypothesis, other.name)
    theta = theta_from(model, hypothesis, other.fit, best.fit)
    scores = scores_of(model, hypothesis, theta[None], best.fit.episodes)[0]
    both = float(densities(scores).sum()) + log_prior(model.free(hypothesis), theta)
    return bool(both - best.fit.objective >= RULES.companion_share * alone > 0.0)


def undecided(model: Comparison, members: Sequence[Verdict]) -> list[Verdict]:
    """The candidates that forecasts cannot tell apart either, of those that blocks cannot.

    Stretches are compared in pairs with those of the one that forecasts best. A trifle tells none
    apart, however sure it is: where noise is small, the same law in other words forecasts a little
    better in every stretch.
    """
    squares = [_squares(model, v) for v in members]
    usual = np.where(squares[0].sum(0) > 0.0, squares[0].sum(0), 1.0)
    best = min(squares, key=lambda each: float((each.sum(0) / usual).sum()))
    return [
        v
        for v, squared in zip(members, squares, strict=True)
        if squared is best or not _is_told_apart(weight_of(squared, best))
    ]


def _is_told_apart(removed: Weight) -> bool:
    """Whether the best one's forecasts are surely better by as much as matters."""
    return removed.low >= RULES.least_share


def is_absent(fitted: Fit, name: str) -> bool:
    """Whether every size of an effect is exactly the value without effect."""
    return all(fitted.value(f.name) == f.neutral for f in sizes_of(fitted, name))


def is_nothing(fitted: Fit, name: str) -> bool:
    """Whether the intervals of all sizes of an effect hold the value without effect.

    A shape, whose neutral value is not 0, does not count: it has no meaning where the size is 0.
    """
    sizes = sizes_of(fitted, name)
    ends = [fitted.interval(f.name) for f in sizes]
    return all(low <= f.neutral <= high for f, (low, high) in zip(sizes, ends, strict=True))


def sizes_of(fitted: Fit, name: str) -> list[Free]:
    """The parameters that are 0 without the effect; all parameters if none is."""
    parameters = own_parameters(fitted.free, name)
    return [f for f in parameters if f.neutral == 0.0] or parameters


def _squares(model: Comparison, verdict: Verdict) -> FloatArray:
    known = verdict.squares
    return np.asarray(crossed(model, verdict.candidate.fit) if known is None else known)
