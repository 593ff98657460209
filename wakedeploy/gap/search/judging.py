"""Which effects are named: those that are evident, and that make forecasts better.

In: a `Comparison` and a fit of the system as it is. Out: what was named, what was rejected and why,
and what still acts on the system that nothing named explains.

An effect is evident if it gains more than chance on blocks that it was not fitted to, in more than
one of them. It matters if forecasts of the blocks get better by it, each with parameters that other
blocks prefer. Sealed blocks rank nothing; they only withdraw what they do not bear out, and where
nothing is left of an answer the others rank once more without it. One that does not matter does not
end the search: the next one is tried, and a pair with it.
"""

import copy
import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.fits import Fit, FloatArray, prior_precision
from wakedeploy.gap.evidence.inference import fit, held_out, settled
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.rules import FEWEST_IN_ALL, RULES
from wakedeploy.gap.search.anew import begun_anew, bettered
from wakedeploy.gap.search.beginnings import beginning
from wakedeploy.gap.search.comparison import (
    Comparison,
    asked_far_ahead,
    errors,
    searched_on,
    theta_from,
)
from wakedeploy.gap.search.extent import is_steady, profiled
from wakedeploy.gap.search.rivalry import (
    Verdict,
    is_absent,
    is_nothing,
    rivals_with,
    sizes_of,
    undecided,
)
from wakedeploy.gap.search.scan import NOTHING, elaborates, ranked, refines, simpler
from wakedeploy.gap.search.sizes import least_squares, parameters
from wakedeploy.gap.search.weighing import (
    Weight,
    crossed,
    helps,
    is_outdone,
    share_of_gap,
    unfitted,
    unseen,
    weight_of,
)

_TRIED = 6  # candidates of a round whose forecasts are looked at
_PLAINLY = 5.0  # times what chance brings: an effect that is needed by any account
CHANCE = "no more than chance"
NO_SIZE = "its size's interval holds no effect"
ONE_BLOCK = "its gain rests on one block"
WORSE = "forecasts get worse"
UNSEEN_WORSE = "forecasts of sealed episodes get no better"
HARDLY = "evident, but forecasts hardly change"
REFINES = "it only refines what was found"
TRIFLE = "a trifle of the gap that there was"
ACCEPTED = "accepted"


@dataclass(frozen=True, eq=False)
class Named:
    """What was named: fits without and with it, rounds as JSON has them, and rivals of a class.

    The fits are of `model`: the one that was asked, or that one asked far ahead.
    `weights` say how much each effect improves forecasts of the blocks that it was found on,
    cross-fitted; `leftover` is what still acts and is not explained. Of a system whose forecasts
    are no better than those that ask no model (`is_outdone`) nothing is named, unless it surely
    removes most of the error: where little moves, the last reading is hard to outdo.
    """

    model: Comparison
    base: Fit
    found: Fit
    rounds: list[dict[str, Any]]
    rivals: tuple[str, ...] = ()
    weights: Mapping[str, Weight] = field(default_factory=dict)
    unsettled: tuple[str, ...] = ()
    leftover: tuple[dict[str, Any], ...] = ()
    alone: tuple[Candidate, ...] = ()  # every effect without any other
    is_outdone: bool = False
    is_far_ahead: bool = False
    withdrawn: tuple[str, ...] = ()  # named once, and not borne out by sealed episodes


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
    part = searched_on(model)
    base = settled(part, fit(part, (), used, beginning(part, used)))[0]
    return base if part is model else settled(model, fit(model, (), used, base.theta))[0]


def named(model: Comparison, base: Fit, progress: Progress = quiet) -> Named:
    """Effects one after another, as long as one is evident and matters.

    Long recordings are searched in part; sizes and sealed episodes are those of all. The model is
    asked for the next reading; where the answer explains too little, it is asked far ahead, too,
    beside what was named, if that has no rivals. What comes of it takes the place of an unknown if
    forecasts get better, those of sealed episodes, too; of another answer, if they surely do.
    """
    outcome = _named(model, base, progress)
    far = None if _is_whole(outcome) else asked_far_ahead(model)
    if far is None:
        return outcome
    progress("asking far ahead")
    if verdict_of(outcome) == "named":
        again = _further_ahead(far, outcome, progress)
    else:
        again = _named(far, fitted_base(far), progress, lacks_something=True)
    again = replace(again, is_far_ahead=True)
    if verdict_of(again) not in ("named", "class"):
        return outcome
    gained = weight_of(*(unfitted(n.model, n.found) for n in (outcome, again)))
    is_better = gained.matters if verdict_of(outcome) == "unknown" else gained.low > 0.0
    if is_better and weight_of(*(unseen(n.model, n.found) for n in (outcome, again))).share > 0.0:
        return replace(again, leftover=_left_near(model, outcome, again))
    return outcome


def _further_ahead(far: Comparison, near: Named, progress: Progress) -> Named:
    """What was named for the next reading, and is needed far ahead, with what else is named there.

    It is fitted there, too. A forecast's few readings alone leave room for laws that every reading
    speaks against.
    """
    base, hypothesis = fitted_base(far), near.found.hypothesis
    start = theta_from(far, hypothesis, near.found, base)
    found = settled(far, fit(far, hypothesis, base.episodes, start))[0]
    rounds = copy.deepcopy(near.rounds)
    begun = replace(near, model=far, base=base, found=found, rounds=rounds)
    return _searched(far, base, begun, progress)


def _left_near(model: Comparison, outcome: Named, again: Named) -> tuple[dict[str, Any], ...]:
    """What still acts beside what was named far ahead, where no push can say so."""
    acting = getattr(model, "leftovers", None)
    if acting is None:
        return ()
    hypothesis = again.found.hypothesis
    start = theta_from(model, hypothesis, outcome.found, again.found)
    fitted = settled(model, fit(model, hypothesis, outcome.found.episodes, start))[0]
    left: tuple[dict[str, Any], ...] = acting(fitted)
    return left


def _named(
    model: Comparison, base: Fit, progress: Progress, lacks_something: bool = False
) -> Named:
    """What one way of asking names; where that explains too little, the effects are begun anew.

    With `lacks_something` another way has said so: then "none" explains too little.
    """
    part = searched_on(model)
    begun = base
    if part is not model:
        begun = settled(part, fit(part, (), base.episodes, base.theta))[0]
    outcome = _searched(model, base, Named(model, begun, begun, []), progress)
    is_open = verdict_of(outcome) == "unknown"
    is_open = is_open or (lacks_something and not outcome.found.hypothesis)
    if not is_open and _is_whole(outcome):
        return outcome
    stage = "beginning effects anew"
    anew = begun_anew(part, begun, list(part.effects), functools.partial(progress, stage))
    if not anew:
        return outcome
    better = bettered(part, begun, anew.values())
    if better is not begun:
        base = better if part is model else bettered(model, base, [better])
    again = _searched(model, base, Named(model, better, better, []), progress, anew)
    if verdict_of(again) not in ("named", "class"):
        return outcome
    gained = weight_of(crossed(model, outcome.found), crossed(model, again.found))
    return again if is_open or gained.low > 0.0 else outcome


def _is_whole(outcome: Named) -> bool:
    """Whether nothing hints at more than an answer says."""
    is_open = verdict_of(outcome) == "unknown" or _evident_yet_unnamed(outcome)
    return not (is_open or outcome.leftover or is_outdone(outcome.model, outcome.found))


def _searched(
    model: Comparison,
    base: Fit,
    outcome: Named,
    progress: Progress,
    anew: Mapping[str, Fit] = NOTHING,
) -> Named:
    """What is named on top of a base, candidates beginning there or where `anew` has them."""
    outcome = _found(model, base, outcome, progress, anew)
    needed = any(weight.low > RULES.surely_share for weight in outcome.weights.values())
    if not needed and is_outdone(model, outcome.found):
        outcome = replace(outcome, found=base, rivals=(), weights={}, unsettled=(), is_outdone=True)
    acting = getattr(model, "leftovers", None)
    return outcome if acting is None else replace(outcome, leftover=acting(outcome.found))


def _found(
    model: Comparison, base: Fit, start: Named, progress: Progress, anew: Mapping[str, Fit]
) -> Named:
    """What is named and borne out; where nothing is, once more without what was withdrawn.

    One effect may fit too well what a few episodes show, and hide another that all of them bear
    out.
    """
    part, outcome = searched_on(model), start
    while len(outcome.found.hypothesis) < RULES.most_effects:
        further = _round(part, outcome, progress, anew)
        if further is None:
            break
        outcome, anew = further, {}
    outcome = _still_needed(part, outcome)
    if part is not model:
        progress("fitting what was found to all samples")
        outcome = _on_all(model, base, outcome)
    sized = _with_sizes(model, outcome)
    outcome = _borne_out(model, sized)
    withdrawn = sized.found.hypothesis
    if outcome.found.hypothesis or not withdrawn or start.withdrawn:
        return outcome
    rounds, alone = copy.deepcopy(outcome.rounds), outcome.alone
    start = replace(start, rounds=rounds, alone=alone, withdrawn=withdrawn)
    again = _found(model, base, start, progress, {})
    return again if again.found.hypothesis else outcome


def _on_all(model: Comparison, base: Fit, outcome: Named) -> Named:
    """What was found in a part of the recordings, fitted to all of them."""
    found, still = base, True
    if outcome.found.hypothesis:
        start = fit(model, outcome.found.hypothesis, base.episodes, outcome.found.theta)
        found, still = settled(model, start)
    unsettled = () if still else found.hypothesis[-1:]
    return replace(outcome, base=base, found=found, unsettled=unsettled)


def _round(
    model: Comparison, outcome: Named, progress: Progress, anew: Mapping[str, Fit] = NOTHING
) -> Named | None:
    """What was named with one more effect, or a pair; None where there is none."""
    found = outcome.found
    verdicts = _judged_round(model, outcome, found, progress, anew)
    if not outcome.alone:
        outcome = replace(outcome, alone=tuple(v.candidate for v in verdicts))
    leader = next((v for v in verdicts if v.why == ACCEPTED), None)
    if leader is not None:  # what is simpler comes first, and the leader where that is turned down
        plainer = _plainer(model, found, leader)
        further = _with(model, outcome, _best(model, plainer, verdicts))
        if further is None and plainer is not leader:
            further = _with(model, outcome, _best(model, leader, verdicts))
        return further
    evident = [v for v in verdicts if v.why in (HARDLY, WORSE)]
    if not evident or len(found.hypothesis) + 2 > RULES.most_effects:
        return None
    return _pair(model, outcome, evident[0], verdicts, progress)


def _judged_round(
    model: Comparison,
    outcome: Named,
    found: Fit,
    progress: Progress,
    anew: Mapping[str, Fit] = NOTHING,
) -> list[Verdict]:
    """Every candidate on top of a fit, best first, judged; written into the rounds."""
    excluded = {*found.hypothesis, *outcome.withdrawn}
    untried = [n for n in model.effects if n not in excluded]
    beside = f" beside {', '.join(found.hypothesis)}" if found.hypothesis else ""
    stage = f"ranking effects{beside}"
    progress(stage)
    counted = functools.partial(progress, stage)
    ranking, chance = ranked(model, found, untried, counted, anew)
    before = crossed(model, found)
    begun = crossed(model, outcome.base) if found.hypothesis else before
    verdicts = [_judged(model, begun, before, effect, chance) for effect in ranking[:_TRIED]]
    verdicts += [Verdict(effect, "") for effect in ranking[_TRIED:]]
    entries = [_entry(c, found) for c in ranking]
    for entry, verdict in zip(entries, verdicts, strict=True):
        if verdict.why:
            entry["judged"] = verdict.why
        if verdict.weight is not None:
            entry["forecast"] = asdict(verdict.weight)
    outcome.rounds.append(
        {"given": list(found.hypothesis), "threshold_nats": chance, "ranking": entries}
    )
    return verdicts


def _judged(
    model: Comparison, begun: FloatArray, before: FloatArray, effect: Candidate, chance: float
) -> Verdict:
    """Why a candidate is not named, or "accepted".

    `begun` and `before` are squared errors of the base and of what was found. A further effect has
    to matter to the base's: no form is exact, and beside what closed nearly all of a gap every
    trifle is a large share of the rest. A finer law of a friction that was found has to matter more
    than that; where it does not, whether forecasts get better by it is chance and says nothing.
    """
    known = effect.fit.hypothesis[:-1]
    if effect.gain_nats <= chance:
        return Verdict(effect, CHANCE)
    if is_absent(effect.fit, effect.name):
        return Verdict(effect, NO_SIZE)  # it gains what the fit before it had left to rise
    squares = crossed(model, effect.fit)
    weight = weight_of(before, squares)
    gained = share_of_gap(begun, before, squares)
    if not is_shared(effect, chance):
        why = NO_SIZE if is_nothing(effect.fit, effect.name) else ONE_BLOCK
    elif gained < RULES.least_share and any(refines(effect.name, n) for n in known):
        why = REFINES
    elif _is_worth_naming(weight, known):
        why = TRIFLE if gained < RULES.least_of_gap else ACCEPTED
    else:
        why = WORSE if weight.high < 0.0 else HARDLY
    return Verdict(effect, why, weight, squares)


def _is_worth_naming(weight: Weight, known: Sequence[str]) -> bool:
    """Whether forecasts get better by an effect; beside others, surely.

    Each further name is one more chance of a wrong one, and without it there is an answer already.
    """
    return weight.matters and (weight.low > 0.0 or not known)


def is_shared(effect: Candidate, chance: float) -> bool:
    """Whether a gain is more than one block's, and not taken back by others."""
    gains = effect.gains
    if len(gains) < 2:
        return False
    least = chance * (len(gains) - 1) / len(gains)
    lost, won = -gains[gains < 0.0].sum(), gains[gains > 0.0].sum()
    return bool(effect.gain_nats - gains.max() > least and lost < 0.5 * won)


def _best(model: Comparison, leader: Verdict, verdicts: Sequence[Verdict]) -> list[Verdict]:
    """A leader and all that rival it: those that are accepted first, of these the simplest."""
    alike = undecided(model, [leader, *_rivals(leader, verdicts)])
    if not any(v.why == ACCEPTED for v in alike):  # none of the better forecasts is evident
        return [leader]
    return sorted(
        alike, key=lambda v: (v.why != ACCEPTED, len(sizes_of(v.candidate.fit, v.candidate.name)))
    )


def _plainer(model: Comparison, found: Fit, leader: Verdict) -> Verdict:
    """What is simpler than a candidate and gains as much, where forecasts get better by it."""
    plainer = simpler(model, found, leader.candidate)
    if plainer is leader.candidate:
        return leader
    squares = crossed(model, plainer.fit)
    weight = weight_of(crossed(model, found), squares)
    worth = _is_worth_naming(weight, found.hypothesis)
    return Verdict(plainer, ACCEPTED, weight, squares) if worth else leader


def _rivals(leader: Verdict, verdicts: Sequence[Verdict]) -> list[Verdict]:
    """Those of the fitted that blocks do not tell from a leader; none that only elaborates it."""
    leading = leader.candidate.name
    return [
        v
        for v in verdicts[:_TRIED]
        if v.candidate.name != leading
        and not elaborates(v.candidate.name, leading)
        and rivals_with(leader.candidate, v.candidate)
    ]


def _with(model: Comparison, outcome: Named, best: Sequence[Verdict]) -> Named | None:
    """One more effect: the first that is accepted and still something once all else has followed.

    Its class are those after it. Beside an open class only an effect without rivals is named, or
    one whose rivals are of that class: the class is then what is left of it. Beside a name, one
    with more rivals than a class may have would make an answer unknown that has a name.
    """
    searched = outcome.rounds[-1]
    for k, verdict in enumerate(best):
        effect, weight = verdict.candidate, verdict.weight
        if verdict.why != ACCEPTED or weight is None:
            break
        members = tuple(v.candidate.name for v in best[k:])
        if outcome.rivals and len(members) > 1 and not set(members) <= set(outcome.rivals):
            return None
        if outcome.weights and len(members) > RULES.most_in_class:
            return None
        better, still = settled(model, effect.fit)
        follows = candidate(outcome.found, effect.name, better)
        if not _is_something(follows, searched["threshold_nats"]):
            _mark(searched, effect.name, NO_SIZE if is_nothing(better, effect.name) else ONE_BLOCK)
            continue
        searched["chosen"] = effect.name
        searched["class"] = list(members)
        searched["accepted"] = parameters(better, (effect.name,), least_squares(model, better))
        searched["sealed_error"] = errors(model, better, model.sealed())
        rivals = members if len(members) > 1 else outcome.rivals
        unsettled = outcome.unsettled if still else (*outcome.unsettled, effect.name)
        weights = {**outcome.weights, effect.name: weight}
        return replace(outcome, found=better, rivals=rivals, weights=weights, unsettled=unsettled)
    return None


def _is_something(effect: Candidate, chance: float) -> bool:
    """Whether a gain is more than one block's, and the effect's size or its blocks exclude none."""
    return is_shared(effect, chance) and (
        not is_nothing(effect.fit, effect.name)
        or effect.gain_interval()[0] > 0.0
        or is_steady(np.asarray(effect.gains))
    )


def _pair(
    model: Comparison,
    outcome: Named,
    first: Verdict,
    beside_it: Sequence[Verdict],
    progress: Progress,
) -> Named | None:
    """An evident effect that changes no forecast alone, and one that does beside it."""
    beside, still = settled(model, first.candidate.fit)
    verdicts = _judged_round(model, outcome, beside, progress)
    for verdict in verdicts:
        if verdict.why not in (ACCEPTED, HARDLY):
            continue
        before, after = (crossed(model, f) for f in (outcome.found, verdict.candidate.fit))
        both = weight_of(before, after)
        gained = share_of_gap(crossed(model, outcome.base), before, after)
        if not _is_worth_naming(both, list(outcome.weights)) or gained < RULES.least_of_gap:
            continue
        alike = undecided(model, [first, *_rivals(first, beside_it)])
        members = (first.candidate.name, *(v.candidate.name for v in alike if v is not first))
        most = RULES.most_in_class if outcome.weights else len(members)
        if (outcome.rivals and len(members) > 1) or len(members) > most:
            return None
        company = replace(
            outcome, found=beside, rivals=members if len(members) > 1 else outcome.rivals
        )
        second = replace(verdict, why=ACCEPTED, weight=both)
        alike = undecided(model, [second, *_rivals(second, verdicts)])
        further = _with(model, company, [second, *(v for v in alike if v is not second)])
        if further is None:
            continue
        weights = {**further.weights, first.candidate.name: both}
        unsettled = further.unsettled if still else (*further.unsettled, first.candidate.name)
        return replace(further, weights=weights, unsettled=unsettled)
    return None


def _mark(searched: dict[str, Any], name: str, why: str) -> None:
    for entry in searched["ranking"]:
        if entry["name"] == name:
            entry["judged"] = why


def _entry(effect: Candidate, base: Fit) -> dict[str, Any]:
    low, high = effect.gain_interval()
    return {
        "name": effect.name,
        "gain_nats": effect.gain_nats,
        "interval": [low, high],
        "parameters": parameters(effect.fit, (effect.name,)),
        "note": _note(effect, base),
    }


def _note(effect: Candidate, base: Fit) -> str:
    """What a fit shows of itself: that nothing moves, or that it ends at a bound."""
    places = [i for i, f in enumerate(effect.fit.free) if f.name.startswith(f"{effect.name}.")]
    moved = max(float(np.abs(s[:, places]).max()) for s in effect.fit.slopes.innovation)
    if moved == 0.0:
        return "moves no output"
    ends = [
        effect.fit.theta[i] in (effect.fit.free[i].low, effect.fit.free[i].high) for i in places
    ]
    return "at a bound" if any(ends) and effect.fit.objective > base.objective else ""


def _still_needed(model: Comparison, outcome: Named) -> Named:
    """Without the effects that those found after them have made superfluous."""
    found = outcome.found
    chance = max((r["threshold_nats"] for r in outcome.rounds), default=0.0)
    for name in found.hypothesis[:-1]:
        if _evident_by_size(found, name) > _PLAINLY * chance:
            continue
        without = _without(model, found, name)
        again = candidate(without, name, found)
        if held_out(without, found).sum() <= chance or not is_shared(again, chance):
            found = without
    return _left_of(outcome, found)


def _with_sizes(model: Comparison, outcome: Named) -> Named:
    """Without effects whose size may still be nothing, however closely it is looked at."""
    found = outcome.found
    for name in outcome.found.hypothesis:
        if is_nothing(found, name):
            found = profiled(model, found, name)
            if is_nothing(found, name):
                for searched in outcome.rounds:
                    _mark(searched, name, NO_SIZE)
                found = _without(model, found, name)
    return _left_of(outcome, found)


def _borne_out(model: Comparison, outcome: Named) -> Named:
    """Without effects that make forecasts of sealed episodes no better, the last named first."""
    found = outcome.found
    for name in reversed(outcome.found.hypothesis):
        without = _without(model, found, name) if len(found.hypothesis) > 1 else outcome.base
        if helps(model, without, found, model.sealed()):
            continue
        for searched in outcome.rounds:
            _mark(searched, name, UNSEEN_WORSE)
        found = without
    return _left_of(outcome, found)


def _without(model: Comparison, found: Fit, name: str) -> Fit:
    """A fit of the others."""
    rest = tuple(n for n in found.hypothesis if n != name)
    start = theta_from(model, rest, found)
    return settled(model, fit(model, rest, found.episodes, start))[0]


def _left_of(outcome: Named, found: Fit) -> Named:
    """What was named, as far as a fit still has it."""
    kept = {n: w for n, w in outcome.weights.items() if n in found.hypothesis}
    return replace(outcome, found=found, rivals=_still_open(found, outcome.rivals), weights=kept)


def _evident_by_size(found: Fit, name: str) -> float:
    """Nats by which an effect's parameters are away from nothing, all else following (Wald)."""
    places = [i for i, f in enumerate(found.free) if f.name.startswith(f"{name}.")]
    rest = [i for i in range(len(found.free)) if i not in places]
    total = found.slopes.fisher().sum(0) + np.diag(prior_precision(found.free))
    follow = np.linalg.lstsq(total[np.ix_(rest, rest)], total[np.ix_(rest, places)], rcond=1e-12)[0]
    marginal = total[np.ix_(places, places)] - total[np.ix_(places, rest)] @ follow
    away = np.array([found.theta[i] - found.free[i].neutral for i in places])
    return 0.5 * float(away @ marginal @ away)


def _still_open(found: Fit, rivals: tuple[str, ...]) -> tuple[str, ...]:
    """A class without its members' elaborations; () where more than one of it was found."""
    if sum(n in found.hypothesis for n in rivals) != 1:
        return ()
    named_member = next(n for n in rivals if n in found.hypothesis)
    distinct = tuple(n for n in rivals if n == named_member or not elaborates(n, named_member))
    return distinct if len(distinct) > 1 else ()


def verdict_of(outcome: Named) -> str:
    """The answer in a word: named, class, none or unknown."""
    if outcome.rivals:
        return "class" if len(outcome.rivals) <= RULES.most_in_class else "unknown"
    if outcome.found.hypothesis:
        return "named"
    doubtful = any(f["share"] > RULES.unexplained_share for f in _evident_yet_unnamed(outcome))
    acts = any(push["matters"] for push in outcome.leftover)
    return "unknown" if doubtful or acts or outcome.is_outdone else "none"


def _evident_yet_unnamed(outcome: Named) -> list[dict[str, float]]:
    """What forecasts would gain by each effect that is evident where nothing was named."""
    if outcome.found.hypothesis:
        return []
    return [e["forecast"] for r in outcome.rounds for e in r["ranking"] if "forecast" in e]
