"""Which effects are named: those that are evident, and that make forecasts better.

In: a `Comparison` and a fit of the system as it is. Out: what was named, what was rejected and why,
and what still acts on the system that nothing named explains.

An effect is evident if it gains more than chance on blocks that it was not fitted to, in more than
one of them. It matters if forecasts of the blocks get better by it, each with parameters that other
blocks prefer. Sealed blocks take no part: what is reported of them was not chosen by them. One that
does not matter does not end the search: the next one is tried, and a pair with it.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.gap.evidence.inference import (
    Fit,
    FloatArray,
    fit,
    held_out,
    prior_precision,
    settled,
)
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.rules import CLASS_NATS, MOST_IN_CLASS
from wakedeploy.gap.search.comparison import Comparison, errors
from wakedeploy.gap.search.scan import elaborates, ranked, simpler
from wakedeploy.gap.search.sizes import least_squares, parameters
from wakedeploy.gap.search.weighing import Weight, cross_weighed, crossed

MOST_EFFECTS = 4
_TRIED = 6  # candidates of a round whose forecasts are looked at
_SURE = 0.95
_PLAINLY = 5.0  # times what chance brings: an effect that is needed by any account
CHANCE = "no more than chance"
NO_SIZE = "its size's interval holds no effect"
ONE_BLOCK = "its gain rests on one block"
WORSE = "forecasts get worse"
HARDLY = "evident, but forecasts hardly change"
ACCEPTED = "accepted"
_UNEXPLAINED = 0.1  # share of the error that a rejected effect removed: something is missing


@dataclass(frozen=True, eq=False)
class Named:
    """What was named: fits without and with it, rounds as JSON has them, and rivals of a class.

    `weights` say how much each effect improves forecasts of the blocks that it was found on,
    cross-fitted; `leftover` is what still acts and is not explained.
    """

    base: Fit
    found: Fit
    rounds: list[dict[str, Any]]
    rivals: tuple[str, ...] = ()
    weights: Mapping[str, Weight] = field(default_factory=dict)
    unsettled: tuple[str, ...] = ()
    leftover: tuple[dict[str, Any], ...] = ()
    alone: tuple[Candidate, ...] = ()  # every effect without any other


@dataclass(frozen=True, eq=False)
class _Verdict:
    """A candidate of a round, why it is not named (or "accepted"), and what forecasts say."""

    one: Candidate
    why: str
    weight: Weight | None = None


def named(model: Comparison, base: Fit, progress: Progress = quiet) -> Named:
    """Effects one after another, as long as one is evident and matters."""
    told = Named(base, base, [])
    while len(told.found.hypothesis) < MOST_EFFECTS:
        further = _round(model, told, progress)
        if further is None:
            break
        told = further
    told = _still_needed(model, told)
    acting = getattr(model, "leftovers", None)
    return told if acting is None else replace(told, leftover=acting(told.found))


def _round(model: Comparison, told: Named, progress: Progress) -> Named | None:
    """What was named with one more effect, or a pair; None where there is none."""
    found = told.found
    verdicts = _judged_round(model, told, found, progress)
    if not told.alone:
        told = replace(told, alone=tuple(v.one for v in verdicts))
    accepted = _accepted(model, found, verdicts)
    if accepted:
        return _with(model, told, accepted)
    evident = [v for v in verdicts if v.why in (HARDLY, WORSE)]
    if not evident or len(found.hypothesis) + 2 > MOST_EFFECTS:
        return None
    return _pair(model, told, evident[0], progress)


def _judged_round(model: Comparison, told: Named, found: Fit, progress: Progress) -> list[_Verdict]:
    """Every candidate on top of a fit, best first, judged; written into the rounds."""
    left = [n for n in model.effects if n not in found.hypothesis]
    beside = f" beside {', '.join(found.hypothesis)}" if found.hypothesis else ""
    stage = f"ranking effects{beside}"
    progress(stage)
    ranking, chance = ranked(model, found, left, functools.partial(progress, stage))
    before = crossed(model, found)
    verdicts = [_judged(model, before, one, chance) for one in ranking[:_TRIED]]
    verdicts += [_Verdict(one, "") for one in ranking[_TRIED:]]
    entries = [_entry(c, found) for c in ranking]
    for entry, verdict in zip(entries, verdicts, strict=True):
        if verdict.why:
            entry["judged"] = verdict.why
        if verdict.weight is not None:
            entry["forecast"] = asdict(verdict.weight)
    told.rounds.append(
        {"given": list(found.hypothesis), "threshold_nats": chance, "ranking": entries}
    )
    return verdicts


def _judged(model: Comparison, before: FloatArray, one: Candidate, chance: float) -> _Verdict:
    """Why a candidate is not named, or "accepted"."""
    if one.gain_nats <= chance:
        return _Verdict(one, CHANCE)
    if is_nothing(one.fit, one.name):
        return _Verdict(one, NO_SIZE)
    weight = cross_weighed(model, before, one.fit)
    if not is_shared(one, chance):
        return _Verdict(one, ONE_BLOCK, weight)
    if weight.matters:
        return _Verdict(one, ACCEPTED, weight)
    return _Verdict(one, WORSE if weight.high < 0.0 else HARDLY, weight)


def is_shared(one: Candidate, chance: float) -> bool:
    """Whether a gain is more than one block's, and not taken back by others."""
    gains = one.gains
    if len(gains) < 2:
        return False
    least = chance * (len(gains) - 1) / len(gains)
    lost, won = -gains[gains < 0.0].sum(), gains[gains > 0.0].sum()
    return bool(one.gain_nats - gains.max() > least and lost < 0.5 * won)


def _accepted(model: Comparison, found: Fit, verdicts: Sequence[_Verdict]) -> list[_Verdict]:
    """The best one that is accepted, or what is simpler and as good, and those that rival it."""
    accepted: list[_Verdict] = []
    for verdict in verdicts:
        if verdict.why == ACCEPTED and (not accepted or _rivals_with(accepted[0].one, verdict.one)):
            accepted.append(verdict)
    if not accepted:
        return []
    plainer = simpler(model, found, accepted[0].one)
    if plainer is not accepted[0].one:
        weight = cross_weighed(model, crossed(model, found), plainer.fit)
        if weight.matters:
            others = [v for v in accepted[1:] if v.one.name != plainer.name]
            accepted = [_Verdict(plainer, ACCEPTED, weight), *others]
    return accepted


def _with(model: Comparison, told: Named, accepted: Sequence[_Verdict]) -> Named | None:
    """One more effect: the first whose size is still something once all else has followed."""
    searched = told.rounds[-1]
    for k, verdict in enumerate(accepted):
        one, weight = verdict.one, verdict.weight
        assert weight is not None
        better, still = settled(model, one.fit)
        if is_nothing(better, one.name):
            _mark(searched, one.name, NO_SIZE)
            continue
        rivals = told.rivals
        searched["chosen"] = one.name
        searched["class"] = [v.one.name for v in accepted[k:]]
        searched["accepted"] = parameters(better, (one.name,), least_squares(model, better))
        searched["sealed_error"] = errors(model, better, model.sealed())
        if len(searched["class"]) > 1 and not rivals:
            rivals = tuple(searched["class"])
        unsettled = told.unsettled if still else (*told.unsettled, one.name)
        weights = {**told.weights, one.name: weight}
        return replace(told, found=better, rivals=rivals, weights=weights, unsettled=unsettled)
    return None


def _pair(model: Comparison, told: Named, first: _Verdict, progress: Progress) -> Named | None:
    """An evident effect that changes no forecast alone, and one that does beside it."""
    beside, still = settled(model, first.one.fit)
    verdicts = _judged_round(model, told, beside, progress)
    for verdict in verdicts:
        if verdict.why not in (ACCEPTED, HARDLY):
            continue
        both = cross_weighed(model, crossed(model, told.found), verdict.one.fit)
        if not both.matters:
            continue
        company = replace(told, found=beside)
        further = _with(model, company, [replace(verdict, weight=both)])
        if further is None or is_nothing(further.found, first.one.name):
            continue
        weights = {**further.weights, first.one.name: both}
        unsettled = further.unsettled if still else (*further.unsettled, first.one.name)
        return replace(further, weights=weights, unsettled=unsettled)
    return None


def _mark(searched: dict[str, Any], name: str, why: str) -> None:
    for entry in searched["ranking"]:
        if entry["name"] == name:
            entry["judged"] = why


def is_nothing(fitted: Fit, name: str) -> bool:
    """Whether the intervals of all parameters of an effect hold the value without effect."""
    own = [f for f in fitted.free if f.name.startswith(f"{name}.")]
    ends = [fitted.interval(f.name) for f in own]
    return all(low <= f.neutral <= high for f, (low, high) in zip(own, ends, strict=True))


def _rivals_with(best: Candidate, other: Candidate) -> bool:
    """Whether blocks do not agree that the best gains more than another."""
    apart = best.gains - other.gains
    count = len(apart)
    if count < 2:
        return float(apart.sum()) < CLASS_NATS
    reach = float(student_t.ppf(_SURE, count - 1)) * float(apart.std(ddof=1)) * count**0.5
    return bool(float(apart.sum()) - reach < CLASS_NATS)


def _entry(one: Candidate, base: Fit) -> dict[str, Any]:
    low, high = one.gain_interval()
    return {
        "name": one.name,
        "gain_nats": one.gain_nats,
        "interval": [low, high],
        "parameters": parameters(one.fit, (one.name,)),
        "note": _note(one, base),
    }


def _note(one: Candidate, base: Fit) -> str:
    """What a fit shows of itself: that nothing moves, or that it ends at a bound."""
    own = [i for i, f in enumerate(one.fit.free) if f.name.startswith(f"{one.name}.")]
    moved = max(float(np.abs(s[:, own]).max()) for s in one.fit.slopes.innovation)
    if moved == 0.0:
        return "moves no output"
    ends = [one.fit.theta[i] in (one.fit.free[i].low, one.fit.free[i].high) for i in own]
    return "at a bound" if any(ends) and one.fit.objective > base.objective else ""


def _still_needed(model: Comparison, told: Named) -> Named:
    """Without the effects that those found after them have made superfluous."""
    found = told.found
    chance = max((r["threshold_nats"] for r in told.rounds), default=0.0)
    for name in found.hypothesis[:-1]:
        if _evident_by_size(found, name) > _PLAINLY * chance:
            continue
        rest = tuple(n for n in found.hypothesis if n != name)
        without, _ = settled(model, fit(model, rest, found.episodes, _shared(model, found, rest)))
        again = candidate(without, name, found)
        if held_out(without, found).sum() <= chance or not is_shared(again, chance):
            found = without
    kept = {n: w for n, w in told.weights.items() if n in found.hypothesis}
    return replace(told, found=found, rivals=_still_open(found, told.rivals), weights=kept)


def _evident_by_size(found: Fit, name: str) -> float:
    """Nats by which an effect's parameters are away from nothing, all else following (Wald)."""
    own = [i for i, f in enumerate(found.free) if f.name.startswith(f"{name}.")]
    rest = [i for i in range(len(found.free)) if i not in own]
    total = found.slopes.fisher().sum(0) + np.diag(prior_precision(found.free))
    follow = np.linalg.lstsq(total[np.ix_(rest, rest)], total[np.ix_(rest, own)], rcond=1e-12)[0]
    marginal = total[np.ix_(own, own)] - total[np.ix_(own, rest)] @ follow
    away = np.array([found.theta[i] - found.free[i].neutral for i in own])
    return 0.5 * float(away @ marginal @ away)


def _shared(model: Comparison, fitted: Fit, hypothesis: tuple[str, ...]) -> FloatArray:
    """A fit's parameters as far as a smaller hypothesis has them."""
    known = dict(zip(fitted.names, fitted.theta, strict=True))
    return np.array([known[f.name] for f in model.free(hypothesis)])


def _still_open(found: Fit, rivals: tuple[str, ...]) -> tuple[str, ...]:
    """A class without its members' elaborations; () where more than one of it was found."""
    if sum(n in found.hypothesis for n in rivals) != 1:
        return ()
    own = next(n for n in rivals if n in found.hypothesis)
    left = tuple(n for n in rivals if n == own or not elaborates(n, own))
    return left if len(left) > 1 else ()


def verdict_of(told: Named) -> str:
    """The answer in a word: named, class, none or unknown."""
    if told.rivals:
        return "class" if len(told.rivals) <= MOST_IN_CLASS else "unknown"
    if told.found.hypothesis:
        return "named"
    rejected = (e["forecast"] for r in told.rounds for e in r["ranking"] if "forecast" in e)
    doubtful = any(f["share"] > _UNEXPLAINED and f["low"] > 0.0 for f in rejected)
    return "unknown" if doubtful or told.leftover else "none"
