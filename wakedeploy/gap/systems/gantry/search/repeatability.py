"""Whether two halves of the flights, each by itself, give the same answer.

An answer that only all flights together give may rest on one of them. Each half is fitted by
itself, from where all flights' base stands. It ranks what the whole search found, its nearest
rivals, and whatever else its own slopes promise most.

In: the flights, an answer. Out: what each half ranks first, at which size, and whether they agree.
"""

from collections.abc import Sequence

from wakedeploy.gap.evidence.expected_gains import promises
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import Candidate, rank_fairly
from wakedeploy.gap.search.artefacts import Repeated
from wakedeploy.gap.search.repeatability import PROMISING, RIVALS, agree
from wakedeploy.gap.systems.gantry.findings import Half
from wakedeploy.gap.systems.gantry.flight import Flight
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.naming import with_terms
from wakedeploy.gap.systems.gantry.search.outcome import Answer
from wakedeploy.physics.effects import LIBRARY

FEWEST = 2 * RULES.fewest_flights


def repeated(answer: Answer, sealed: Sequence[Flight]) -> Repeated[Half] | None:
    """Both halves' answers about the first effect found; None where there is nothing to repeat.

    That is with too few flights, the `sealed` included, or without an effect of the library.
    """
    found = next((n for n in answer.fit.hypothesis if n in LIBRARY), None)
    if found is None or answer.verdict == "unknown":
        return None
    if answer.model.episodes + len(sealed) < FEWEST:
        return None
    moved = with_terms(GantryModel(answer.model.rig, sealed)).around_own_motion(answer.base)
    flights = (*answer.base_model.flights, *moved.flights)
    wanted = _shortlist(answer, found)
    halves = [_half(answer, flights[start::2], found, wanted) for start in (0, 1)]
    return Repeated(agree=agree(halves[0], halves[1], {found}), halves=halves)


def _shortlist(answer: Answer, found: str) -> list[str]:
    first = next(r for r in answer.rounds if r.found == found)
    rivals = [c.name for c in first.ranking if c.name != found][:RIVALS]
    return [found, *rivals]


def _half(answer: Answer, flights: Sequence[Flight], found: str, wanted: Sequence[str]) -> Half:
    model = with_terms(GantryModel(answer.model.rig, flights))
    base = fit(model, (), range(model.episodes), answer.base.theta)
    known = {entry.name for entry in answer.model.rig.effect}
    others = [n for n in LIBRARY if n not in known and n not in wanted]
    promised = dict(zip(others, promises(model, base, others), strict=True))
    most = sorted(others, key=lambda n: -promised[n])[:PROMISING]
    base, ranked = rank_fairly(model, base, [*wanted, *most])
    near = [c for c in ranked if c.gain_nats > ranked[0].gain_nats - RULES.class_nats]
    return _half_of(flights, near, found)


def _half_of(flights: Sequence[Flight], near: Sequence[Candidate], found: str) -> Half:
    """The half's answer: the effect that the whole search found, if it is near the best."""
    leading = next((c for c in near if c.name == found), near[0])
    parameter = LIBRARY[leading.name].parameters[0]
    low, high = leading.fit.interval(f"{leading.name}.{parameter.name}")
    return Half(
        flights=[f.name for f in flights],
        leading=leading.name,
        gain_nats=leading.gain_nats,
        near=[c.name for c in near],
        parameter=parameter.name,
        low=low,
        high=high,
        unit=parameter.unit,
    )
