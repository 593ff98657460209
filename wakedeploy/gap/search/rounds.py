"""Which effects a system lacks, found one after another.

In: a `Comparison`. Out: what was named, and every round of the search. An effect is named if it is
evident (it gains more than chance on episodes that it was not fitted to, and so does every likely
sum of episodes) and if it matters (what is predicted of sealed episodes gets better by it). One
that is not does not end the search: the next one is tried.
"""

import functools
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.inference import Fit, fit, held_out, settled
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.rules import FEWEST_IN_ALL, RULES
from wakedeploy.gap.search.comparison import Comparison, errors
from wakedeploy.gap.search.scan import Weight, elaborates, ranked, simpler, weighed
from wakedeploy.gap.search.sizes import least_squares, parameters

_TRIED = 6  # candidates of a round that are looked at on the sealed blocks
NO_SIZE = "its size's interval holds no effect"


@dataclass(frozen=True, eq=False)
class Named:
    """What was named: fits without and with it, rounds as JSON has them, and rivals of a class."""

    base: Fit
    found: Fit
    rounds: list[dict[str, Any]]
    rivals: tuple[str, ...] = ()
    weights: dict[str, Weight] = field(default_factory=dict)
    unsettled: tuple[str, ...] = ()
    alone: tuple[Candidate, ...] = ()  # every effect without any other


def fitted_base(model: Comparison) -> Fit:
    """The system as it is, on the episodes that are not sealed.

    Raises UnusableInput for too few episodes.
    """
    if model.episodes < FEWEST_IN_ALL:
        raise UnusableInput(
            f"{model.name}: the recordings make {model.episodes} episodes; at least {FEWEST_IN_ALL}"
            " are needed, as effects are judged on episodes that they were not fitted to."
        )
    sealed = model.sealed()
    used = [e for e in range(model.episodes) if e not in sealed]
    return settled(model, fit(model, (), used))[0]


def named(model: Comparison, base: Fit, progress: Progress = quiet) -> Named:
    """Effects one after another, as long as one is evident and matters."""
    told = Named(base, base, [])
    while len(told.found.hypothesis) < RULES.most_effects:
        told, goes_on = _round(model, told, progress)
        if not goes_on:
            break
    return _still_needed(model, told)


def _round(model: Comparison, told: Named, progress: Progress) -> tuple[Named, bool]:
    found = told.found
    left = [n for n in model.effects if n not in found.hypothesis]
    beside = f" beside {', '.join(found.hypothesis)}" if found.hypothesis else ""
    stage = f"ranking effects{beside}"
    progress(stage)
    ranking, chance = ranked(model, found, left, functools.partial(progress, stage))
    searched: dict[str, Any] = {
        "given": list(found.hypothesis),
        "threshold_nats": chance,
        "ranking": [_entry(c, found) for c in ranking],
    }
    told.rounds.append(searched)
    if not told.alone:
        told = replace(told, alone=tuple(ranking))
    accepted: list[tuple[Candidate, Weight]] = []
    for entry, one in list(zip(searched["ranking"], ranking, strict=True))[:_TRIED]:
        entry["judged"], weight = _judged(model, found, one, chance)
        if weight is not None:
            entry["forecast"] = asdict(weight)
        if entry["judged"] != "accepted" or weight is None:
            continue
        if not accepted or _rivals_with(accepted[0][0], one):
            accepted.append((one, weight))
    if not accepted:
        return told, False
    chosen, weight = accepted[0]
    plainer = simpler(model, found, chosen)
    if plainer is not chosen:
        other = weighed(model, found, plainer.fit, model.sealed())
        if other.matters:
            chosen, weight = plainer, other
            accepted[0] = (plainer, other)
            accepted = [
                one for k, one in enumerate(accepted) if not k or one[0].name != plainer.name
            ]
    better, still = settled(model, chosen.fit)
    while is_nothing(better, chosen.name):  # once all else has followed
        for entry in searched["ranking"]:
            if entry["name"] == chosen.name:
                entry["judged"] = NO_SIZE
        accepted = [one for one in accepted if one[0].name != chosen.name]
        if not accepted:
            return told, False
        chosen, weight = accepted[0]
        better, still = settled(model, chosen.fit)
    searched["chosen"] = chosen.name
    searched["class"] = [one.name for one, _ in accepted]
    rivals = told.rivals
    if len(accepted) > 1 and not rivals:
        rivals = tuple(searched["class"])
    unsettled = told.unsettled if still else (*told.unsettled, chosen.name)
    searched["accepted"] = parameters(better, (chosen.name,), least_squares(model, better))
    searched["sealed_error"] = errors(model, better, model.sealed())
    weights = told.weights | {chosen.name: weight}
    after = replace(told, found=better, rivals=rivals, weights=weights, unsettled=unsettled)
    return after, True


def _judged(
    model: Comparison, found: Fit, one: Candidate, chance: float
) -> tuple[str, Weight | None]:
    """Why a candidate is not named, or "accepted"."""
    if one.gain_nats <= chance:
        return "no more than chance", None
    if is_nothing(one.fit, one.name):
        return NO_SIZE, None
    if one.gain_interval()[0] <= 0.0:
        return "its gain's interval reaches zero", weighed(model, found, one.fit, model.sealed())
    weight = weighed(model, found, one.fit, model.sealed())
    if weight.share < 0.0:
        return "forecasts of sealed blocks get worse", weight
    if not weight.matters:
        return "evident, but forecasts of sealed blocks hardly change", weight
    return "accepted", weight


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
        return float(apart.sum()) < RULES.class_nats
    reach = float(student_t.ppf(0.95, count - 1)) * float(apart.std(ddof=1)) * count**0.5
    return bool(float(apart.sum()) - reach < RULES.class_nats)


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
    for name in found.hypothesis[:-1]:
        rest = tuple(n for n in found.hypothesis if n != name)
        known = dict(zip(found.names, found.theta, strict=True))
        start = np.array([known[f.name] for f in model.free(rest)])
        without, _ = settled(model, fit(model, rest, found.episodes, start))
        again = candidate(without, name, found)
        chance = next(r["threshold_nats"] for r in told.rounds if r.get("chosen") == name)
        if held_out(without, found).sum() <= chance or again.gain_interval()[0] <= 0.0:
            found = without
    kept = {n: w for n, w in told.weights.items() if n in found.hypothesis}
    rivals = _still_open(found, told.rivals)
    return replace(told, found=found, rivals=rivals, weights=kept)


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
        return "class" if len(told.rivals) <= RULES.most_in_class else "unknown"
    if told.found.hypothesis:
        return "named"
    rejected = (e for r in told.rounds for e in r["ranking"] if "forecast" in e)
    doubtful = any(e["forecast"]["share"] > RULES.unexplained_share for e in rejected)
    return "unknown" if doubtful else "none"
