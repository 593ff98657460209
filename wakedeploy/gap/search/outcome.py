"""What a search has named so far, and the verdict that follows from it.

In: a base fit, what was found on top of it and the rounds that led there. Out: the answer in a
word.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Forecast, Leftover, Round
from wakedeploy.gap.search.comparison import Comparison
from wakedeploy.gap.search.needed_gain import Chance
from wakedeploy.gap.search.scan import elaborates
from wakedeploy.gap.search.weighing import Weight

CHANCE = "no more than chance"
NO_SIZE = "its size's interval holds no effect"
ONE_BLOCK = "its gain rests on one block"
WORSE = "forecasts get worse"
UNSEEN_WORSE = "forecasts of sealed episodes get no better"
HARDLY = "evident, but forecasts hardly change"
SUPERFLUOUS = "what was named after it explains all of it"
REFINES = "it only refines what was found"
OUTDONE = "forecasts get better, but no better than the last reading or the mean"
TRIFLE = "a trifle of the gap that there was"
ACCEPTED = "accepted"


@dataclass(frozen=True, eq=False)
class Named:
    """What was named: fits without and with it, its rounds, and rivals of a class.

    The fits are of `model`: the one that was asked, or the same asked far ahead. `weights` say how
    much each effect improves forecasts of the blocks that it was found on, cross-fitted; `leftover`
    is what still acts unexplained. If the system's forecasts are no better than those without a
    model (`is_outdone`), nothing is named unless it surely removes most of the error: where little
    moves, the last reading is hard to outdo.
    """

    model: Comparison
    base: Fit
    found: Fit
    rounds: list[Round]
    rivals: tuple[str, ...] = ()
    weights: Mapping[str, Weight] = field(default_factory=dict)
    unsettled: tuple[str, ...] = ()
    leftover: tuple[Leftover, ...] = ()
    alone: tuple[Candidate, ...] = ()  # every effect by itself on the base
    is_outdone: bool = False
    is_far_ahead: bool = False
    withdrawn: tuple[str, ...] = ()  # named once, but superfluous or not borne out


def verdict_of(outcome: Named) -> str:
    """The answer in a word: named, class, none or unknown."""
    if outcome.rivals:
        return "class" if len(outcome.rivals) <= RULES.most_in_class else "unknown"
    if outcome.found.hypothesis:
        return "named"
    doubtful = any(f.share > RULES.unexplained_share for f in evident_yet_unnamed(outcome))
    acts = any(push.matters for push in outcome.leftover)
    return "unknown" if doubtful or acts or outcome.is_outdone else "none"


def evident_yet_unnamed(outcome: Named) -> list[Forecast]:
    """The forecast gain of each evident effect, if nothing was named."""
    if outcome.found.hypothesis:
        return []
    return [e.forecast for r in outcome.rounds for e in r.ranking if e.forecast is not None]


def left_of(outcome: Named, found: Fit) -> Named:
    """What was named, reduced to what a fit still has."""
    kept = {n: w for n, w in outcome.weights.items() if n in found.hypothesis}
    rivals = still_open(outcome.model, found, outcome.rivals)
    return replace(outcome, found=found, rivals=rivals, weights=kept)


def still_open(model: Comparison, found: Fit, rivals: tuple[str, ...]) -> tuple[str, ...]:
    """A class without its members' elaborations; () if more than one member was found."""
    if sum(n in found.hypothesis for n in rivals) != 1:
        return ()
    named_member = next(n for n in rivals if n in found.hypothesis)
    distinct = tuple(
        n for n in rivals if n == named_member or not elaborates(model, n, named_member)
    )
    return distinct if len(distinct) > 1 else ()


def chance_of(searched: Round) -> Chance:
    """What chance brings to the effects of a round."""
    return Chance(searched.threshold_nats, searched.steady_nats)


def marked(searched: Round, name: str, why: str) -> Round:
    """A round that says why one effect of its ranking is not named."""
    ranking = [
        entry.model_copy(update={"judged": why}) if entry.name == name else entry
        for entry in searched.ranking
    ]
    return searched.model_copy(update={"ranking": ranking})


def with_superfluous(outcome: Named, before: Named, names: tuple[str, ...], first: int) -> Named:
    """An outcome that tells of effects that had left before it; `first` is its first round."""
    gone = {e.name: e for r in before.rounds for e in r.ranking if e.name in names}
    superfluous = [e.model_copy(update={"judged": SUPERFLUOUS}) for e in gone.values()]
    begun = outcome.rounds[first]
    ranking = sorted([*begun.ranking, *superfluous], key=lambda e: -e.gain_nats)
    outcome.rounds[first] = begun.model_copy(update={"ranking": ranking})
    alone = tuple(c for c in before.alone if c.name in names)
    return replace(outcome, alone=(*outcome.alone, *alone))
