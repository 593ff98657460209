"""The same kind of effect at ports alike: the friction of both wheels, the sag of all motors.

In: a fit and a judged round on top of it. Out: kinds that are fitted at all those ports at once,
best first. What both wheels of a robot lack turns the robot when it is added to one wheel: alone it
gains, and forecasts get worse.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wakedeploy.gap.evidence.fits import Fit, FloatArray
from wakedeploy.gap.evidence.inference import settled
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.climbing import begun, climbed, height, raced
from wakedeploy.gap.search.comparison import Comparison, theta_from
from wakedeploy.gap.search.imitation import NEAR, doing_alike
from wakedeploy.gap.search.rivalry import Verdict, is_nothing, rivals_with
from wakedeploy.gap.search.scan import elaborates

_MOST = 3  # kinds that are fitted as they gain at each port, and as they do what the best one does
_NOT_BEHIND = 0.5  # share of the lead's gain with which one has not fallen behind in a race


def distinct(model: Comparison, names: Sequence[str]) -> int:
    """How many effects there are, where a kind at ports alike counts once."""
    seen: list[str] = []
    for name in names:
        if not set(model.ports_alike(name)) & set(seen):
            seen.append(name)
    return len(seen)


def room_for(model: Comparison, names: Sequence[str], kinds: int = 1) -> int:
    """How many more effects an answer may name beside these, if `kinds` of them may be others."""
    is_full = distinct(model, names) + kinds > RULES.most_effects
    is_full &= kinds > 1 or not any(set(model.ports_alike(n)) - set(names) for n in names)
    return 0 if is_full else max(RULES.most_named - len(names), 0)


def askable(model: Comparison, names: Sequence[str], untried: Sequence[str]) -> list[str]:
    """Effects that may be named beside these: all, or at other ports what is named already."""
    if distinct(model, names) < RULES.most_effects:
        return [*untried]
    return [n for n in untried if set(model.ports_alike(n)) & set(names)]


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
    most: int,
) -> list[Twins]:
    """Kinds fitted at all ports alike, best first, or a simpler one before it.

    Asked are kinds that gain what is `needed` [nats] at every port alone, nearly as much as at the
    best port, and those that together do much of what the best effect does, or the best such kind.
    Each gains what is needed more at all ports than at any one. A kind is left out if its size may
    be nothing at a port, or if it is at more than `most` ports. A model that knows no ports has no
    twins.
    """
    fitted: dict[frozenset[str], Twins] = {}
    firsts = {v.candidate.name: v for v in verdicts}
    gains = {name: v.candidate.gain_nats for name, v in firsts.items()}
    sets = _sets(model, found, firsts, most)
    for verdict in verdicts:
        names = sets.get(verdict.candidate.name, ())
        nearly = RULES.port_share * verdict.candidate.gain_nats
        if not names or any(gains[n] < max(needed.get(n, np.inf), nearly) for n in names):
            continue
        if frozenset(names) in fitted or len(fitted) == _MOST:
            continue
        both = _settled(model, found, _climbed(model, found, verdict.candidate.fit, names), verdict)
        if _needs_all(both, gains, needed):
            fitted[frozenset(names)] = both
    leads = [v.candidate.fit for v in verdicts[:1]] + [t.candidate.fit for t in fitted.values()]
    lead = max(leads, key=height, default=found)
    for fit in _doing_as(model, found, lead, sets.values()):
        first = firsts[fit.hypothesis[len(found.hypothesis)]]
        both = _settled(model, found, fit, first)
        known = fitted.get(frozenset(both.names), both)
        if _needs_all(both, gains, needed):
            fitted[frozenset(both.names)] = max(both, known, key=_gain)
    return _simplest_first(model, sorted(fitted.values(), key=_gain, reverse=True))


def _gain(each: Twins) -> float:
    return each.candidate.gain_nats


def _settled(model: Comparison, found: Fit, together: Fit, first: Verdict) -> Twins:
    """Effects at all ports, fitted until that moves nothing more."""
    together, still = settled(model, together)
    names = together.hypothesis[len(found.hypothesis) :]
    return Twins(names, candidate(found, names[0], together, model), first, still)


def _needs_all(both: Twins, gains: Mapping[str, float], needed: Mapping[str, float]) -> bool:
    """Whether all together gain more than any one, and none may be nothing."""
    more = _gain(both) - max(gains[name] for name in both.names)
    is_more = more > max(needed[name] for name in both.names)
    return is_more and not any(is_nothing(both.candidate.fit, name) for name in both.names)


def _sets(
    model: Comparison, found: Fit, firsts: Mapping[str, Verdict], most: int
) -> dict[str, tuple[str, ...]]:
    """By each effect, that effect and the same kind at other ports, if there are `most` at most.

    There is no set without a port at which the kind was withdrawn.
    """
    sets = {}
    for name in firsts:
        names = (name, *(n for n in model.ports_alike(name) if n not in found.hypothesis))
        if 1 < len(names) <= most and all(n in firsts for n in names):
            sets[name] = names
    return sets


def _doing_as(
    model: Comparison, found: Fit, lead: Fit, sets: Collection[tuple[str, ...]]
) -> list[Fit]:
    """Fits of those that come near to a lead, begun where they do what it does.

    At one port alone the true kind may gain next to nothing: a lag of one rotor turns the robot.
    The port at which a kind gains most comes first.
    """
    gained = lead.objective - found.objective
    known = [set(lead.hypothesis[len(found.hypothesis) :])]
    others = list[tuple[str, ...]]()
    for names in sets:
        finer = any(elaborates(model, n, other) for n in names for other in found.hypothesis)
        if set(names) not in known and not finer:
            known.append(set(names))
            others.append(names)
    if not others or gained < RULES.least_nats:
        return []
    begun = doing_alike(model, found, lead, others)
    near = [fit for fit in begun.values() if height(fit) > found.objective + NEAR * gained]
    fits = raced(model, found, sorted(near, key=height, reverse=True)[:_MOST])
    return [f for f in fits if f.objective > found.objective + _NOT_BEHIND * gained]


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
