"""Which manoeuvre splits a class of effects that the flights so far cannot tell apart.

In: a rig, the names of the class. Out: for every manoeuvre of the menu, the nats by which each
rival would lose and the flights that takes; and the choice, which splits the worst pair in the
least time. Each manoeuvre is flown on the simulated rig and judged by the likelihood that `name`
itself uses.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.reference import FlightPlan, random_plan
from runtime.reference_file import write_reference
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.evidence.separation import Evidence, gather, loss_nats
from wakedeploy.gap.progress import StepsDone, uncounted
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.systems.gantry import artefacts
from wakedeploy.gap.systems.gantry.discrepancy import form_hooks
from wakedeploy.gap.systems.gantry.flight import Flight, flight_from_log
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.planning.manoeuvres import Manoeuvre, menu
from wakedeploy.gap.systems.gantry.search.naming import fitted_base
from wakedeploy.physics.constants import constants_of
from wakedeploy.physics.effects import LIBRARY, effect

MOST_FLIGHTS = 30
RANDOM_S = 20.0
_SEED = 7001


@dataclass(frozen=True, eq=False)
class Option:
    """One manoeuvre: `loss` (C, C) nats that rival j loses in one flight when i is the truth.

    `flights` are what splits every pair, with margin; None if `MOST_FLIGHTS` are too few.
    """

    manoeuvre: Manoeuvre
    seconds: float
    loss: FloatArray
    flights: int | None

    @property
    def total_s(self) -> float:
        """How long all flights take, rests included [s]; infinite if they cannot split it."""
        return float("inf") if self.flights is None else self.flights * self.seconds

    @property
    def worst_nats(self) -> float:
        """The nats of the pair that is hardest to split."""
        return float(_pairs(self.loss).min())

    @property
    def as_artefact(self) -> artefacts.Option:
        """As plan.json has it."""
        return artefacts.Option(
            manoeuvre=self.manoeuvre.name,
            description=self.manoeuvre.description,
            seconds=self.seconds,
            loss_nats=self.loss.tolist(),
            worst_nats=self.worst_nats,
            flights=self.flights,
        )


@dataclass(frozen=True, eq=False)
class Plan:
    """The options, best first, and random flights to compare them with."""

    names: tuple[str, ...]
    options: tuple[Option, ...]
    random: Option

    @property
    def best(self) -> Option | None:
        """The manoeuvre to fly; None if nothing in the menu can split the class."""
        first = self.options[0]
        return None if first.flights is None else first

    @property
    def sensors(self) -> dict[str, str]:
        """What splits each member, by the library."""
        return {name: effect(name).split_by for name in self.names}

    @property
    def sentence(self) -> str:
        """The advice in plain words."""
        members = " and ".join([", ".join(self.names[:-1]), self.names[-1]])
        best = self.best
        if best is None:
            advice = "; ".join(dict.fromkeys(self.sensors.values()))
            return (
                f"No manoeuvre within this rig's limits splits {members} in {MOST_FLIGHTS} "
                f"flights; what would: {advice}."
            )
        flights = "one flight" if best.flights == 1 else f"{best.flights} flights"
        return (
            f"To split {members}, fly {best.manoeuvre.name} ({best.manoeuvre.description}): "
            f"{flights} of {best.seconds:.0f} s, rests included; the closest pair then differs by "
            f"{_expected(best):.0f} nats. Give these logs before the earlier ones: the last are "
            "sealed, and nothing is learned from them."
        )

    @property
    def as_artefact(self) -> artefacts.Plan:
        """As plan.json has it."""
        best = self.best
        return artefacts.Plan(
            rivals=list(self.names),
            sentence=self.sentence,
            manoeuvre=None if best is None else best.manoeuvre.name,
            flights=None if best is None else best.flights,
            seconds=math.nan if best is None else best.total_s,
            split_by=self.sensors,
            is_searched=True,
            margin_nats=RULES.margin_nats,
            options=[option.as_artefact for option in (*self.options, self.random)],
        )


def make_plan(
    rig: Rig,
    names: Sequence[str],
    *,
    sizes: Mapping[str, Sequence[float]] | None = None,
    manoeuvres: Sequence[Manoeuvre] | None = None,
    progress: StepsDone = uncounted,
) -> Plan:
    """Judge every manoeuvre of the menu for a class of two effects or more.

    `sizes` are each effect's parameters, as fitted; by default one prior scale from neutral.
    Flights already flown do not count: whatever they were expected to show, they left the class.
    Raises UnusableInput for fewer than two effects or an unknown one.
    """
    chosen = tuple(dict.fromkeys(effect(name).name for name in names))
    if len(chosen) < 2:
        raise UnusableInput("A class to split has at least two effects: give --class twice.")
    known = {name: plausible_size(rig, name) for name in chosen} | dict(sizes or {})
    options = []
    tried = (random_flight(), *(menu() if manoeuvres is None else manoeuvres))
    for each in tried:
        options.append(_option(rig, each, chosen, known))
        progress(len(options), len(tried))
    order = sorted(options[1:], key=lambda o: (o.total_s, -o.worst_nats / o.seconds))
    return Plan(chosen, tuple(order), options[0])


def random_flight() -> Manoeuvre:
    """A flight without a plan, to compare with."""
    return Manoeuvre(
        "random", "everything at random", lambda rig: random_plan(rig, RANDOM_S, _SEED)
    )


def evidence_of(
    rig: Rig, flights: Sequence[Flight], names: Sequence[str], sizes: Mapping[str, Sequence[float]]
) -> Evidence:
    """What some flights can say about effects, with nuisances as fitted to them."""
    model, base = fitted_base(GantryModel(rig, flights))
    return gather(model, base, names, sizes)


def plausible_size(rig: Rig, name: str) -> tuple[float, ...]:
    """An effect's parameters one prior scale away from none at all.

    A parameter that only shapes the effect (its neutral value is not zero, and it replaces no
    constant of the rig) stays where it is.
    """
    constants = constants_of(rig)
    values = []
    for p in LIBRARY[name].parameters:
        neutral = p.neutral_on(constants)
        moves = p.constant is not None or p.neutral == 0.0
        values.append(float(np.clip(neutral + (p.scale if moves else 0.0), p.low, p.high)))
    return tuple(values)


def stated_sizes(
    named: artefacts.Name | None, names: Sequence[str]
) -> dict[str, tuple[float, ...]]:
    """The parameters that name.json states for these effects, from the last round with each."""
    ranked = {} if named is None else named.ranked
    sizes = {}
    for name in names:
        stated = ranked[name].parameters if name in ranked else {}
        wanted = [stated[p.name].value for p in effect(name).parameters if p.name in stated]
        if len(wanted) == len(effect(name).parameters) and all(map(math.isfinite, wanted)):
            sizes[name] = tuple(wanted)
    return sizes


def write_plan_reference(path: Path, rig: Rig, option: Option) -> FlightPlan:
    """Write the manoeuvre for `run-gantry --reference`."""
    flown = option.manoeuvre.plan(rig)
    write_reference(path, flown, rig, option.manoeuvre.name)
    return flown


def _option(
    rig: Rig,
    manoeuvre: Manoeuvre,
    names: Sequence[str],
    sizes: Mapping[str, Sequence[float]],
) -> Option:
    flown = manoeuvre.plan(rig)
    log = record(rig, seconds=RANDOM_S, seed=_SEED, plan=flown, **form_hooks(rig))
    seconds = len(log) / log.rate_hz
    try:
        flight = flight_from_log(log, rig, manoeuvre.name)
    except UnusableInput:  # it cannot be flown whole on this rig, so it says nothing
        return Option(manoeuvre, seconds, np.zeros((len(names), len(names))), None)
    evidence = evidence_of(rig, [flight], names, sizes)
    return Option(manoeuvre, seconds, loss_nats(evidence), _flights(evidence))


def _flights(evidence: Evidence) -> int | None:
    """The flights until every pair differs by enough, with margin; None if too many."""
    for count in range(1, MOST_FLIGHTS + 1):
        if _pairs(loss_nats(evidence, copies=float(count))).min() >= RULES.margin_nats:
            return count
    return None


def _expected(option: Option) -> float:
    return (option.flights or 0) * option.worst_nats


def _pairs(loss: FloatArray) -> FloatArray:
    """The entries off the diagonal."""
    return np.asarray(loss[~np.eye(len(loss), dtype=bool)])
