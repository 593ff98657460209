"""One round of a search: every effect is judged on top of what was found, and one is named.

In: an outcome. Out: the outcome with one more effect, or a pair of them; None without one.

An effect is evident if it gains more than chance on blocks that it was not fitted to, or less if it
does so steadily (`needed_gain.py`), and in more than one block. It matters if it makes forecasts of
the blocks better, each with parameters that other blocks prefer. An effect that does not matter
does not end the search: the next one is tried, and a pair with it.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from wakedeploy.gap.evidence.fits import Fit, FloatArray, Free, own_places
from wakedeploy.gap.evidence.inference import settled
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.progress import Progress
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.alike_ports import Twins, askable, room_for, twins
from wakedeploy.gap.search.artefacts import Forecast, Ranked, Round
from wakedeploy.gap.search.comparison import Comparison, errors
from wakedeploy.gap.search.needed_gain import Chance, is_shared, needed_nats
from wakedeploy.gap.search.outcome import (
    ACCEPTED,
    CHANCE,
    HARDLY,
    NO_SIZE,
    ONE_BLOCK,
    REFINES,
    TRIFLE,
    WORSE,
    Named,
    chance_of,
    marked,
    still_open,
)
from wakedeploy.gap.search.rivalry import (
    Verdict,
    is_absent,
    is_companion,
    is_nothing,
    rivals_with,
    sizes_of,
    undecided,
)
from wakedeploy.gap.search.scan import NOTHING, elaborates, ranked, refines, simpler
from wakedeploy.gap.search.size_bounds import is_steady
from wakedeploy.gap.search.sizes import least_squares, parameters
from wakedeploy.gap.search.weighing import (
    Weight,
    crossed,
    removes_most,
    share_of_gap,
    weight_of,
)

_TRIED = 6  # candidates of a round whose forecasts are looked at


def with_one_more(
    model: Comparison, outcome: Named, progress: Progress, anew: Mapping[str, Fit] = NOTHING
) -> Named | None:
    """What was named with one more effect, or a pair; None without one."""
    found = outcome.found
    verdicts = _judged_round(model, outcome, found, progress, anew)
    if not outcome.alone:
        outcome = replace(outcome, alone=tuple(v.candidate for v in verdicts))
    leader = _leader(verdicts)
    further = _twins(model, outcome, verdicts, progress)
    if further is not None:
        return further
    if leader is not None:  # the simpler effect first, then the leader if that is turned down
        plainer = _plainer(model, found, leader, verdicts)
        further = _with(model, outcome, _best(model, found, plainer, verdicts))
        if further is None and plainer is not leader:
            further = _with(model, outcome, _best(model, found, leader, verdicts))
        return further
    evident = [v for v in verdicts if v.why in (HARDLY, WORSE)]
    if not evident or room_for(model, found.hypothesis, 2) < 2:
        return None
    return _pair(model, outcome, evident[0], verdicts, progress)


def _judged_round(
    model: Comparison,
    outcome: Named,
    found: Fit,
    progress: Progress,
    anew: Mapping[str, Fit] = NOTHING,
) -> list[Verdict]:
    """Judge every candidate on top of a fit, best first, and append the round."""
    excluded = {*found.hypothesis, *outcome.withdrawn}
    untried = [n for n in model.effects if n not in excluded]
    untried = askable(model, found.hypothesis, untried)
    beside = f" beside {', '.join(found.hypothesis)}" if found.hypothesis else ""
    stage = f"ranking effects{beside}"
    progress(stage)
    counted = functools.partial(progress, stage)
    ranking, chance = ranked(model, found, untried, counted, anew)
    before = crossed(model, found)
    begun = crossed(model, outcome.base) if found.hypothesis else before
    needed = [needed_nats(effect, chance, len(ranking)) for effect in ranking]
    verdicts = [
        _judged(model, found, (begun, before), effect, nats, chance)
        for effect, nats in zip(ranking[:_TRIED], needed, strict=False)
    ]
    verdicts += [Verdict(effect, "") for effect in ranking[_TRIED:]]
    outcome.rounds.append(
        Round(
            given=list(found.hypothesis),
            threshold_nats=chance.nats,
            steady_nats=chance.without_loud_nats,
            ranking=[
                _entry(model, v, nats, found) for v, nats in zip(verdicts, needed, strict=True)
            ],
        )
    )
    return verdicts


def _judged(
    model: Comparison,
    found: Fit,
    errors_before: tuple[FloatArray, FloatArray],
    effect: Candidate,
    needed: float,
    chance: Chance,
) -> Verdict:
    """Why a candidate is not named, or "accepted"; it has to gain what is `needed` [nats].

    `errors_before` are squared errors of the base and of what was `found`. A further effect has
    to matter as a share of the base's errors: no form is exact, and once nearly all of a gap is
    closed, every trifle is a large share of the rest. A finer law of a friction that was found has
    to matter more than that; if it does not, whether it improves forecasts is chance.

    An effect that surely removes most of the error, block by block, owes that to no loud moment and
    to no single block: it only has to gain more than quiet noise brings by `chance`. A push that
    lasts takes up a constant force in each block but the first, and so nats say little of one.
    """
    begun, before = errors_before
    known = effect.fit.hypothesis[:-1]
    if effect.gain_nats <= min(needed, chance.without_loud_nats):
        return Verdict(effect, CHANCE)
    if is_absent(effect.fit, effect.name):
        return Verdict(effect, NO_SIZE)  # its gain is what the fit before it had left to rise
    squares = crossed(model, effect.fit)
    weight = weight_of(before, squares)
    gained = share_of_gap(begun, before, squares)
    is_evident = effect.gain_nats > needed and is_shared(effect, needed)
    by_forecasts = not is_evident and removes_most(model, found, effect.fit)
    if effect.gain_nats <= needed and not by_forecasts:
        return Verdict(effect, CHANCE)
    if not is_evident and not by_forecasts:
        why = NO_SIZE if is_nothing(effect.fit, effect.name) else ONE_BLOCK
    elif gained < RULES.least_share and any(refines(model, effect.name, n) for n in known):
        why = REFINES
    elif is_worth_naming(weight, known):
        why = TRIFLE if gained < RULES.least_of_gap else ACCEPTED
    else:
        why = WORSE if weight.high < 0.0 else HARDLY
    return Verdict(effect, why, weight, squares, by_forecasts)


def _leader(verdicts: Sequence[Verdict]) -> Verdict | None:
    """The first that is accepted, unless another surely removes twice as much of the error.

    A lag bends to a little of everything that is missing, so it may gain more nats. Fitted first it
    takes what is another's, and the climbs of all later rounds start beside that.
    """
    accepted = [(v, v.weight) for v in verdicts if v.why == ACCEPTED and v.weight is not None]
    if not accepted:
        return None
    first, weight = accepted[0]
    for verdict, other in accepted:
        if other.low > RULES.first_times * weight.high:
            first, weight = verdict, other
    return first


def is_worth_naming(weight: Weight, known: Sequence[str]) -> bool:
    """Whether an effect makes forecasts better; beside others, surely better.

    Each further name may be wrong, and without it there is an answer already.
    """
    return weight.matters and (weight.low > 0.0 or not known)


def _best(
    model: Comparison, found: Fit, leader: Verdict, verdicts: Sequence[Verdict]
) -> list[Verdict]:
    """A leader and its rivals, the accepted ones first, of these the simplest first.

    What went as far as its effect may comes after those: it is more than that, or something else.
    """
    alike = _alike(model, found, leader, verdicts)
    if not any(v.why == ACCEPTED for v in alike):  # no effect with better forecasts is evident
        return [leader]

    def place(verdict: Verdict) -> tuple[bool, bool, int]:
        sizes = sizes_of(verdict.candidate.fit, verdict.candidate.name)
        ends = any(_is_at_bound(verdict.candidate.fit, size) for size in sizes)
        return verdict.why != ACCEPTED, ends, len(sizes)

    return sorted(alike, key=place)


def _is_at_bound(fitted: Fit, size: Free) -> bool:
    """Whether a size went as far as it may, to the other end than that without the effect."""
    ends = (end for end in (size.low, size.high) if end != size.neutral)
    return fitted.value(size.name) in ends


def _alike(
    model: Comparison, found: Fit, leader: Verdict, verdicts: Sequence[Verdict]
) -> list[Verdict]:
    """A leader and the effects that recordings cannot tell from it, without mere elaborations.

    Forecasts do not take out a leader if, unlike it, all that they leave makes inputs do far less.
    A controller's inputs answer what acts on a system; a forecast that does not know of it yet
    takes them as they come, and is better the less they do. So are the blocks, as long as what acts
    is known in part only; so of a leader that makes inputs do hardly anything other effects are
    rivals with a good share of what it gains.
    """
    alike = undecided(model, [leader, *_rivals(model, found, leader, verdicts)])
    if leader not in alike and not _does_far_less(model, leader.candidate):
        is_by_less = all(_does_far_less(model, v.candidate) for v in alike)
        alike = [leader, *alike] if is_by_less else alike
    elif leader in alike and _answered(model, leader.candidate) <= RULES.hardly_anything:
        held = [v for v in _held_against(model, found, leader, verdicts) if v not in alike]
        alike += held[: max(RULES.most_in_class - len(alike), 0)]
    names = [v.candidate.name for v in alike]
    return [
        v
        for v in alike
        if v is leader or not any(elaborates(model, v.candidate.name, other) for other in names)
    ]


def _held_against(
    model: Comparison, found: Fit, leader: Verdict, verdicts: Sequence[Verdict]
) -> list[Verdict]:
    """What a controller may have held against, where a leader has inputs do hardly anything."""
    least = RULES.companion_share * leader.candidate.gain_nats
    return [
        v
        for v in verdicts[:_TRIED]
        if v is not leader
        and v.why == ACCEPTED
        and v.candidate.gain_nats >= least
        and not _does_far_less(model, v.candidate)
        and not is_companion(model, found, leader.candidate, v.candidate)
    ]


def _does_far_less(model: Comparison, effect: Candidate) -> bool:
    """Whether inputs do far less with an effect than without."""
    return _answered(model, effect) <= RULES.far_less


def _answered(model: Comparison, effect: Candidate) -> float:
    """What inputs do with an effect, as a share of what they do without."""
    return model.inputs_answered(effect.fit, effect.name)


def _plainer(
    model: Comparison, found: Fit, leader: Verdict, verdicts: Sequence[Verdict]
) -> Verdict:
    """A simpler effect that gains as much and improves forecasts; else the leader."""
    plainer = simpler(model, found, leader.candidate, [v.candidate for v in verdicts])
    if plainer is leader.candidate:
        return leader
    squares = crossed(model, plainer.fit)
    weight = weight_of(crossed(model, found), squares)
    worth = is_worth_naming(weight, found.hypothesis)
    return Verdict(plainer, ACCEPTED, weight, squares) if worth else leader


def _rivals(
    model: Comparison, found: Fit, leader: Verdict, verdicts: Sequence[Verdict]
) -> list[Verdict]:
    """The fitted effects that blocks cannot tell from a leader, without elaborations of it.

    One that gains beside the leader most of what it gains without is none: each explains something
    else.
    """
    leading = leader.candidate.name
    return [
        v
        for v in verdicts[:_TRIED]
        if v.candidate.name != leading
        and not elaborates(model, v.candidate.name, leading)
        and rivals_with(leader.candidate, v.candidate)
        and not is_companion(model, found, leader.candidate, v.candidate)
    ]


def _with(model: Comparison, outcome: Named, best: Sequence[Verdict]) -> Named | None:
    """One more effect: the first that is accepted and still something once all else has followed.

    The ones after it are its class. Beside an open class an effect is named only if it has no
    rivals, or if its rivals are of that class, which then shrinks to them. Beside a name, an effect
    with more rivals than a class may have is not named: it would turn that answer into an unknown.
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
        follows = candidate(outcome.found, effect.name, better, model)
        if not _is_something(follows, searched, verdict.removes_most):
            why = NO_SIZE if is_nothing(better, effect.name) else ONE_BLOCK
            searched = outcome.rounds[-1] = marked(searched, effect.name, why)
            continue
        outcome.rounds[-1] = _with_chosen(model, searched, better, (effect.name,), members)
        rivals = still_open(model, better, members if len(members) > 1 else outcome.rivals)
        unsettled = outcome.unsettled if still else (*outcome.unsettled, effect.name)
        weights = {**outcome.weights, effect.name: weight}
        return replace(outcome, found=better, rivals=rivals, weights=weights, unsettled=unsettled)
    return None


def _is_something(effect: Candidate, searched: Round, by_forecasts: bool) -> bool:
    """Whether more than one block gains, and size, gain or blocks exclude that nothing is there.

    What is evident `by_forecasts` has removed error from all of them.
    """
    needed = needed_nats(effect, chance_of(searched), len(searched.ranking))
    return (by_forecasts or is_shared(effect, needed)) and (
        not is_nothing(effect.fit, effect.name)
        or effect.gain_interval()[0] > 0.0
        or is_steady(np.asarray(effect.gains))
    )


def _twins(
    model: Comparison, outcome: Named, verdicts: Sequence[Verdict], progress: Progress
) -> Named | None:
    """One kind at ports alike, if it gains at each of them and no single effect explains as much.

    If recordings cannot tell another kind at these ports from it, the ports are asked one by one.
    Beside an open class no twins are named.
    """
    if outcome.rivals:
        return None
    found, searched = outcome.found, outcome.rounds[-1]
    needed = {each.name: each.needed_nats for each in searched.ranking}
    fitted = twins(model, found, verdicts, needed, room_for(model, found.hypothesis))
    if not fitted:
        return None
    best, *others = fitted
    begun, before = crossed(model, outcome.base), crossed(model, found)
    chance = chance_of(searched)
    nats = needed_nats(best.candidate, chance, len(needed))
    verdict = _judged(model, found, (begun, before), best.candidate, nats, chance)
    singles = [v.candidate for v in verdicts if v.why == ACCEPTED]
    is_needed = not any(rivals_with(best.candidate, single) for single in singles)
    if verdict.why != ACCEPTED or verdict.weight is None or not is_needed:
        return None
    if any(rivals_with(best.candidate, other.candidate) for other in others):
        return _one_by_one(model, outcome, best, verdicts, progress)
    better = best.candidate.fit
    searched = _with_chosen(model, searched, better, best.names, best.names[:1])
    for name in best.names:
        searched = marked(searched, name, ACCEPTED)
    outcome.rounds[-1] = searched
    weights = {**outcome.weights, **dict.fromkeys(best.names, verdict.weight)}
    restless = () if best.is_at_rest else best.names
    unsettled = (*outcome.unsettled, *restless)
    return replace(outcome, found=better, weights=weights, unsettled=unsettled)


def _one_by_one(
    model: Comparison, outcome: Named, both: Twins, verdicts: Sequence[Verdict], progress: Progress
) -> Named | None:
    """The first of the twins and another of them beside it, each with its rivals.

    None if the first is named alone: the others follow in later rounds.
    """
    if both.first.why == ACCEPTED:
        return None
    rounds = len(outcome.rounds)
    pair = _pair(model, outcome, both.first, verdicts, progress, both.names)
    if pair is None:
        del outcome.rounds[rounds:]
    return pair


def _pair(
    model: Comparison,
    outcome: Named,
    first: Verdict,
    beside_it: Sequence[Verdict],
    progress: Progress,
    among: Sequence[str] | None = None,
) -> Named | None:
    """An evident effect that alone improves no forecast, and one that does beside it.

    The second is one of `among`, if that is given.
    """
    beside, still = settled(model, first.candidate.fit)
    verdicts = _judged_round(model, outcome, beside, progress)
    for verdict in verdicts:
        sought = among is None or verdict.candidate.name in among
        if not sought or verdict.why not in (ACCEPTED, HARDLY):
            continue
        before, after = (crossed(model, f) for f in (outcome.found, verdict.candidate.fit))
        both = weight_of(before, after)
        gained = share_of_gap(crossed(model, outcome.base), before, after)
        if not is_worth_naming(both, list(outcome.weights)) or gained < RULES.least_of_gap:
            continue
        alike = _alike(model, outcome.found, first, beside_it)
        members = (first.candidate.name, *(v.candidate.name for v in alike if v is not first))
        most = RULES.most_in_class if outcome.weights else len(members)
        if (outcome.rivals and len(members) > 1) or len(members) > most:
            return None
        company = replace(
            outcome, found=beside, rivals=members if len(members) > 1 else outcome.rivals
        )
        second = replace(verdict, why=ACCEPTED, weight=both)
        alike = _alike(model, beside, second, verdicts)
        further = _with(model, company, [second, *(v for v in alike if v is not second)])
        if further is None:
            continue
        weights = {**further.weights, first.candidate.name: both}
        unsettled = further.unsettled if still else (*further.unsettled, first.candidate.name)
        return replace(further, weights=weights, unsettled=unsettled)
    return None


def _entry(model: Comparison, verdict: Verdict, needed: float, base: Fit) -> Ranked:
    effect, weight = verdict.candidate, verdict.weight
    return Ranked(
        name=effect.name,
        gain_nats=effect.gain_nats,
        needed_nats=needed,
        interval=effect.gain_interval(),
        parameters=parameters(model, effect.fit, (effect.name,)),
        note=_note(effect, base),
        judged=verdict.why,
        forecast=None if weight is None else Forecast(**asdict(weight)),
    )


def _with_chosen(
    model: Comparison, searched: Round, better: Fit, names: Sequence[str], members: Sequence[str]
) -> Round:
    """A round with its choice: effects, the class of the first one, and their fit."""
    return searched.model_copy(
        update={
            "chosen": names[0],
            "rivals": list(members),
            "accepted": parameters(model, better, names, least_squares(model, better)),
            "sealed_error": errors(model, better, model.sealed()),
        }
    )


def _note(effect: Candidate, base: Fit) -> str:
    """What a fit shows of itself: that nothing moves, or that it ends at a bound."""
    places = own_places(effect.fit.free, effect.name)
    moved = max(float(np.abs(s[:, places]).max()) for s in effect.fit.slopes.innovation)
    if moved == 0.0:
        return "moves no output"
    ends = [
        effect.fit.theta[i] in (effect.fit.free[i].low, effect.fit.free[i].high) for i in places
    ]
    return "at a bound" if any(ends) and effect.fit.objective > base.objective else ""
