"""Which effects are named: those that are evident, and that make forecasts better.

In: a `Comparison` and a fit of the system as it is. Out: what was named, what was rejected and why,
and what still acts on the system that nothing named explains.

`rounds.py` finds one effect after another; `withdrawal.py` takes out what does not hold. Sealed
blocks rank nothing; they only withdraw what they do not bear out. If nothing is left of an answer,
the other blocks rank once more without it.
"""

import functools
import itertools
from collections.abc import Mapping
from dataclasses import replace

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.rules import FEWEST_IN_ALL, RULES
from wakedeploy.gap.search.alike_ports import room_for
from wakedeploy.gap.search.artefacts import Leftover
from wakedeploy.gap.search.comparison import Comparison, asked_far_ahead, searched_on, theta_from
from wakedeploy.gap.search.outcome import (
    OUTDONE,
    SUPERFLUOUS,
    Named,
    evident_yet_unnamed,
    marked,
    verdict_of,
    with_superfluous,
)
from wakedeploy.gap.search.restarts import begun_anew, bettered
from wakedeploy.gap.search.rounds import is_worth_naming, with_one_more
from wakedeploy.gap.search.scan import NOTHING
from wakedeploy.gap.search.starting_constants import beginning
from wakedeploy.gap.search.weighing import (
    Weight,
    crossed,
    is_outdone,
    unfitted,
    unseen,
    weight_of,
)
from wakedeploy.gap.search.withdrawal import borne_out, still_needed, with_sizes


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
    """Effects named one after another, as long as one is evident and matters.

    Long recordings are searched in part; sizes and sealed episodes come from all of them. The model
    is first asked for the next reading. If that explains too little, it is asked far ahead, too,
    beside what was named if that has no rivals. The second answer replaces an unknown if forecasts
    get better, also on sealed episodes; it replaces any other answer if they surely do.
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
    """What was named for the next reading and is needed far ahead, and what else is named there.

    It is fitted far ahead, too. The few readings of a forecast would alone leave room for laws that
    the other readings speak against.
    """
    base, hypothesis = fitted_base(far), near.found.hypothesis
    part, begun = _on_part(far, base)
    start = theta_from(part, hypothesis, near.found, begun)
    found = settled(part, fit(part, hypothesis, base.episodes, start))[0]
    rounds = list(near.rounds)
    outcome = replace(near, model=far, base=begun, found=found, rounds=rounds)
    return _searched(far, base, outcome, progress)


def _on_part(model: Comparison, base: Fit) -> tuple[Comparison, Fit]:
    """The part of the recordings that a search looks at, and the base fitted to it."""
    part = searched_on(model)
    if part is model:
        return model, base
    return part, settled(part, fit(part, (), base.episodes, base.theta))[0]


def _left_near(model: Comparison, outcome: Named, again: Named) -> tuple[Leftover, ...]:
    """What still acts beside what was named far ahead, where no lasting push can show it."""
    hypothesis = again.found.hypothesis
    start = theta_from(model, hypothesis, outcome.found, again.found)
    fitted = settled(model, fit(model, hypothesis, outcome.found.episodes, start))[0]
    return model.leftovers(fitted)


def _named(
    model: Comparison, base: Fit, progress: Progress, lacks_something: bool = False
) -> Named:
    """What is named by one way of asking; if it explains too little, the effects start anew.

    `lacks_something` says that another way found too little: then "none" explains too little.
    """
    part, begun = _on_part(model, base)
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
    """Whether nothing hints that more is missing than the answer says."""
    is_open = verdict_of(outcome) == "unknown" or evident_yet_unnamed(outcome)
    return not (is_open or outcome.leftover or is_outdone(outcome.model, outcome.found))


def _searched(
    model: Comparison,
    base: Fit,
    outcome: Named,
    progress: Progress,
    anew: Mapping[str, Fit] = NOTHING,
) -> Named:
    """What is named on top of a base; candidates start there, or where `anew` has them."""
    outcome = _found(model, base, outcome, progress, anew)
    needed = any(weight.low > RULES.surely_share for weight in outcome.weights.values())
    if not needed and is_outdone(model, outcome.found):
        for name in outcome.found.hypothesis:
            outcome.rounds[:] = [marked(r, name, OUTDONE) for r in outcome.rounds]
        outcome = replace(outcome, found=base, rivals=(), weights={}, unsettled=(), is_outdone=True)
    return replace(outcome, leftover=model.leftovers(outcome.found))


def _found(
    model: Comparison, base: Fit, start: Named, progress: Progress, anew: Mapping[str, Fit]
) -> Named:
    """What is named and borne out; if nothing is, once more without what was withdrawn.

    One effect may fit too well what a few episodes show, and hide another that all episodes bear
    out.
    """
    part = searched_on(model)
    outcome = _needed(part, start, progress, anew)
    if part is not model:
        progress("fitting what was found to all samples")
        outcome = _on_all(model, base, outcome)
    outcome, withdrawn = _stays(model, outcome)
    if outcome.found.hypothesis or not withdrawn or start.withdrawn:
        return outcome
    rounds, alone = list(outcome.rounds), outcome.alone
    start = replace(start, rounds=rounds, alone=alone, withdrawn=withdrawn)
    again = _found(model, base, start, progress, {})
    return again if again.found.hypothesis else outcome


def _needed(part: Comparison, start: Named, progress: Progress, anew: Mapping[str, Fit]) -> Named:
    """What is named and still needed beside what followed it.

    What was judged beside an effect that has left again is judged once more, without it. The others
    begin there at their sizes too, so that this search comes as far. If it explains less all the
    same, the first answer stays, weighed without the effects that left, if all of it still matters.
    """
    ahead = _ahead(part, replace(start, rounds=list(start.rounds)), progress, anew)
    if ahead.found.hypothesis:
        progress("asking whether each effect is still needed")
    outcome = still_needed(part, ahead)
    gone = tuple(n for n in ahead.found.hypothesis if n not in outcome.found.hypothesis)
    if not gone or set(gone) & set(start.found.hypothesis):
        return outcome
    fewer = replace(start, rounds=list(start.rounds), withdrawn=(*start.withdrawn, *gone))
    again = still_needed(part, _ahead(part, fewer, progress, {}, outcome.found))
    if again.found.objective < outcome.found.objective - RULES.class_nats:
        weights = _weights_anew(part, outcome)
        named = list(weights)
        if all(is_worth_naming(weights[n], named[:k]) for k, n in enumerate(named)):
            for name in gone:
                outcome.rounds[len(start.rounds) :] = [
                    marked(r, name, SUPERFLUOUS) for r in outcome.rounds[len(start.rounds) :]
                ]
            return replace(outcome, weights=weights)
    return with_superfluous(again, ahead, gone, len(start.rounds))


def _weights_anew(part: Comparison, outcome: Named) -> dict[str, Weight]:
    """The weight of each effect on top of those before it; of several named as one, of them all."""
    weights, before, found = dict[str, Weight](), crossed(part, outcome.base), outcome.found
    for _, together in itertools.groupby(found.hypothesis, lambda n: id(outcome.weights[n])):
        names = list(together)
        so_far = (*weights, *names)
        is_all = so_far == found.hypothesis
        after = crossed(part, found if is_all else _refitted(part, so_far, found))
        weights |= dict.fromkeys(names, weight_of(before, after))
        before = after
    return weights


def _refitted(part: Comparison, hypothesis: tuple[str, ...], *fits: Fit) -> Fit:
    """Some effects, begun at their sizes in the last of the fits that has them."""
    start = theta_from(part, hypothesis, *fits)
    return settled(part, fit(part, hypothesis, fits[-1].episodes, start))[0]


def _ahead(
    part: Comparison,
    outcome: Named,
    progress: Progress,
    anew: Mapping[str, Fit],
    earlier: Fit | None = None,
) -> Named:
    """What is named, one effect after another, until none is or there are enough.

    Candidates of the first round start where `anew` has them. In every round those of an `earlier`
    fit start at their sizes there, too.
    """
    while room_for(part, outcome.found.hypothesis):
        if earlier is not None:
            named = outcome.found.hypothesis
            remaining = [n for n in earlier.hypothesis if n not in named]
            anew = {n: _refitted(part, (*named, n), outcome.found, earlier) for n in remaining}
        further = with_one_more(part, outcome, progress, anew)
        if further is None:
            break
        outcome, anew = further, {}
    return outcome


def _stays(model: Comparison, outcome: Named) -> tuple[Named, tuple[str, ...]]:
    """What has a size and is borne out, and the names that had a size at first.

    Once an effect that sealed episodes do not bear out is gone, another may have no size, and so
    on.
    """
    sized = with_sizes(model, outcome)
    borne, named_at_first = borne_out(model, sized), sized.found.hypothesis
    while borne.found.hypothesis != sized.found.hypothesis:
        sized = with_sizes(model, borne)
        borne = borne_out(model, sized)
    return borne, named_at_first


def _on_all(model: Comparison, base: Fit, outcome: Named) -> Named:
    """What was found in a part of the recordings, fitted to all of them."""
    found, still = base, True
    if outcome.found.hypothesis:
        start = fit(model, outcome.found.hypothesis, base.episodes, outcome.found.theta)
        found, still = settled(model, start)
    unsettled = () if still else found.hypothesis[-1:]
    return replace(outcome, base=base, found=found, unsettled=unsettled)
