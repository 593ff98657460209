"""The same kind of effect at ports alike: the friction of both wheels, the sag of all motors.

In: a fit and a judged round on top of it. Out: kinds that are fitted at all those ports at once,
best first. What both wheels of a robot lack turns it when it is added to one of them: alone it
gains, and forecasts get worse.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wakedeploy.gap.evidence.fits import Fit, FloatArray
from wakedeploy.gap.evidence.inference import settled
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.search.climbing import begun, climbed
from wakedeploy.gap.search.comparison import Comparison, theta_from
from wakedeploy.gap.search.rivalry import Verdict, is_nothing, rivals_with
from wakedeploy.gap.search.scan import elaborates

_MOST = 3  # kinds that are fitted
_NEARLY = 0.5  # share of what a kind gains at one port, that it has to gain at the others


@dataclass(frozen=True, eq=False)
class Twins:
    """A kind at all ports alike: its `names`, the fit as one candidate, and the `first` of them."""

    names: tuple[str, ...]
    candidate: Candidate
    first: Verdict


def twins(
    model: Comparison, found: Fit, verdicts: Sequence[Verdict], least_nats: float, most_effects: int
) -> list[Twins]:
    """Kinds of the verdicts at all ports alike, the one that gains most first, or what is simpler.

    Only those that gain `least_nats` at each port alone, and nearly as much as at the other ports.
    None whose sizes may be nothing at one of them, or that would be more than `most_effects` with
    those that were found.
    """
    fitted: list[Twins] = []
    gains = {v.candidate.name: v.candidate.gain_nats for v in verdicts}
    for verdict in verdicts:
        alike = _at_ports_alike(model, found, verdict.candidate.name)
        names = (verdict.candidate.name, *alike)
        least = max(least_nats, _NEARLY * verdict.candidate.gain_nats)
        if any(gains.get(name, 0.0) < least for name in names):
            continue
        is_known = any(set(names) == set(each.names) for each in fitted)
        too_many = len(found.hypothesis) + len(names) > most_effects
        if not alike or is_known or too_many or len(fitted) == _MOST:
            continue
        together = settled(model, _climbed(model, found, verdict.candidate.fit, names))[0]
        if not any(is_nothing(together, name) for name in names):
            fitted.append(Twins(names, candidate(found, names[0], together), verdict))
    return _simplest_first(sorted(fitted, key=lambda each: -each.candidate.gain_nats))


def _simplest_first(fitted: list[Twins]) -> list[Twins]:
    """What the best one only elaborates comes before it, where it gains as much."""
    for each in fitted[1:]:
        finer = all(map(elaborates, sorted(fitted[0].names), sorted(each.names)))
        if finer and rivals_with(fitted[0].candidate, each.candidate):
            return [each, *(other for other in fitted if other is not each)]
    return fitted


def _at_ports_alike(model: Comparison, found: Fit, name: str) -> list[str]:
    """Effects of the same kind, with sizes in the same units, that were not found."""
    kind, units = name.partition("@")[0], [f.unit for f in model.effects[name]]
    return [
        other
        for other, free in model.effects.items()
        if other not in (name, *found.hypothesis)
        and other.partition("@")[0] == kind
        and [f.unit for f in free] == units
    ]


def _climbed(model: Comparison, found: Fit, alone: Fit, names: Sequence[str]) -> Fit:
    """A fit of all, from where each has the sizes of the first one alone."""
    hypothesis = (*found.hypothesis, *names)
    return climbed(model, begun(model, hypothesis, found, _alike(model, hypothesis, alone, names)))


def _alike(
    model: Comparison, hypothesis: tuple[str, ...], alone: Fit, names: Sequence[str]
) -> FloatArray:
    """Parameters (p,) in which every effect of `names` has the sizes that its first one has."""
    start = theta_from(model, hypothesis, alone)
    for i, free in enumerate(model.free(hypothesis)):
        name, _, size = free.name.partition(".")
        if name in names[1:]:
            start[i] = np.clip(alone.value(f"{names[0]}.{size}"), free.low, free.high)
    return start
