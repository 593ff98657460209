"""The same kind of effect at ports alike: the friction of both wheels, the sag of all motors.

In: a fit and a judged round on top of it. Out: kinds that are fitted at all those ports at once,
best first. What both wheels of a robot lack turns the robot when it is added to one wheel: alone it
gains, and forecasts get worse.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wakedeploy.gap.evidence.fits import Fit, FloatArray
from wakedeploy.gap.evidence.inference import settled
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.climbing import begun, climbed
from wakedeploy.gap.search.comparison import Comparison, theta_from
from wakedeploy.gap.search.rivalry import Verdict, is_nothing, rivals_with
from wakedeploy.gap.search.scan import elaborates

_MOST = 3  # kinds that are fitted


@dataclass(frozen=True, eq=False)
class Twins:
    """A kind at all ports alike: its `names`, the fit as one candidate, and the `first` of them.

    `is_at_rest` says that repeating the fit moves none of its sizes.
    """

    names: tuple[str, ...]
    candidate: Candidate
    first: Verdict
    is_at_rest: bool


def twins(
    model: Comparison,
    found: Fit,
    verdicts: Sequence[Verdict],
    needed: Mapping[str, float],
    most_effects: int,
) -> list[Twins]:
    """Kinds of the verdicts fitted at all ports alike, best first, or a simpler one before it.

    Each gains what is `needed` [nats] at every port alone, nearly as much as at the best port, and
    that much more at all together than at any one. A kind is left out if its size may be nothing at
    a port, or if it makes more than `most_effects` with those found before. A model that knows
    no ports has no twins.
    """
    fitted: list[Twins] = []
    gains = {v.candidate.name: v.candidate.gain_nats for v in verdicts}
    for verdict in verdicts:
        alike = [n for n in model.ports_alike(verdict.candidate.name) if n not in found.hypothesis]
        names = (verdict.candidate.name, *alike)
        nearly = RULES.port_share * verdict.candidate.gain_nats
        if not alike or any(gains.get(n, 0.0) < max(needed.get(n, np.inf), nearly) for n in names):
            continue
        is_known = any(set(names) == set(each.names) for each in fitted)
        too_many = len(found.hypothesis) + len(names) > most_effects
        if is_known or too_many or len(fitted) == _MOST:
            continue
        together, still = settled(model, _climbed(model, found, verdict.candidate.fit, names))
        both = candidate(found, names[0], together, model)
        most = max(needed[name] for name in names)
        needs_all = both.gain_nats - max(gains[name] for name in names) > most
        if needs_all and not any(is_nothing(together, name) for name in names):
            fitted.append(Twins(names, both, verdict, still))
    return _simplest_first(model, sorted(fitted, key=lambda each: -each.candidate.gain_nats))


def _simplest_first(model: Comparison, fitted: list[Twins]) -> list[Twins]:
    """First the kind that the best only elaborates, if it gains as much; without elaborations."""
    for each in fitted[1:]:
        finer = _all_elaborate(model, fitted[0], each)
        if finer and rivals_with(fitted[0].candidate, each.candidate):
            return [each, *(other for other in fitted[1:] if other is not each)]
    best = fitted[:1]
    return best + [each for each in fitted[1:] if not _all_elaborate(model, each, best[0])]


def _all_elaborate(model: Comparison, finer: Twins, plainer: Twins) -> bool:
    """Whether each of the `finer` effects is the same as one of the `plainer`, with more to it."""
    pairs = zip(sorted(finer.names), sorted(plainer.names), strict=False)
    return all(elaborates(model, name, other) for name, other in pairs)


def _climbed(model: Comparison, found: Fit, alone: Fit, names: Sequence[str]) -> Fit:
    """A fit of all the effects, each starting with the sizes of the first one alone."""
    hypothesis = (*found.hypothesis, *names)
    return climbed(model, begun(model, hypothesis, found, _alike(model, hypothesis, alone, names)))


def _alike(
    model: Comparison, hypothesis: tuple[str, ...], alone: Fit, names: Sequence[str]
) -> FloatArray:
    """Parameters (p,) in which every effect of `names` has the sizes of the first one."""
    start = theta_from(model, hypothesis, alone)
    for i, free in enumerate(model.free(hypothesis)):
        name, _, size = free.name.partition(".")
        if name in names[1:]:
            start[i] = np.clip(alone.value(f"{names[0]}.{size}"), free.low, free.high)
    return start
