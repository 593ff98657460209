"""What ordinary flights show of a rig beyond its file.

In: a rig and flights in which nothing is new. Out: a `Reference`: each flight's own thrust, battery
and bias, which flights are unlike the others, and a fit of everything else, from which `corrected`
makes a rig.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.core.rig_sections import Repeatability
from wakedeploy.gap.evidence.fits import Fit, FloatArray, extended
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.systems.gantry.flight import Flight
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.reference.spread import (
    Apart,
    Variation,
    farthest,
    variation,
    without,
)
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.naming import may_be_nothing
from wakedeploy.gap.systems.gantry.search.refitting import reduced, refitted
from wakedeploy.gap.systems.gantry.varying import SAG, Varying, varying

# Priors of each flight's own values before a first look: so loose that they say nothing.
LOOSE = Repeatability(thrust=0.03, sag_per_s=0.003, bias_m=0.01)
FREEDOMS = ("crosswind-offset", "battery-sag", "wake-decay")  # no calibration measures these
_FIRST_TURNS = 2
_FIELDS = {"thrust.sufferer.scale": "thrust", SAG: "sag_per_s", "range.bias_m": "bias_m"}


@dataclass(frozen=True, eq=False)
class Own:
    """A quantity that differs between flights: values and errors (n,), and their variation.

    The variation is that of the flights that are like one another.
    """

    quantity: Varying
    values: FloatArray
    errors: FloatArray
    between: Variation


@dataclass(frozen=True)
class Odd:
    """A flight that is unlike the others: in which quantity, by how much, p-value."""

    flight: int
    quantity: Varying
    away: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Reference:
    """What was learned; `fit` is of the flights that are like one another, `kept`, under `rig`."""

    rig: Rig
    flights: tuple[Flight, ...]
    kept: tuple[int, ...]
    variations: tuple[Own, ...]
    odd: tuple[Odd, ...]
    model: GantryModel
    fit: Fit

    @property
    def repeatability(self) -> Repeatability:
        """The variation of each quantity, if it is sure."""
        sure = {
            _FIELDS[o.quantity.name]: o.between.sd for o in self.variations if o.between.is_sure
        }
        return Repeatability(**sure)


def learn(rig: Rig, flights: Sequence[Flight], progress: Progress = quiet) -> Reference:
    """Fit the flights, each with values of its own; then once more with what varies.

    Raises UnusableInput for fewer than `RULES.fewest_flights` + 1 flights.
    """
    if len(flights) <= RULES.fewest_flights:
        raise UnusableInput(
            f"{len(flights)} reference flights are too few to compare; fly at least"
            f" {RULES.fewest_flights + 1}."
        )
    progress("letting each flight have thrust, battery and bias of its own")
    loose = rig.model_copy(update={"repeatability": LOOSE})
    model = GantryModel(loose, flights)
    for _ in range(_FIRST_TURNS):  # a flight of another thrust is no noise
        model = model.around_own_motion(model.neutral())
    start = model.neutral().theta
    model, base = refitted(model, fit(model, (), range(model.episodes), start))
    deviations = [model.own_deviations(base, episode) for episode in range(len(flights))]
    odd = odd_flights(varying(loose), deviations)
    kept = tuple(i for i in range(len(flights)) if i not in {o.flight for o in odd})
    variations = tuple(_variation(quantity, deviations, kept) for quantity in varying(loose))
    first = Reference(rig, tuple(flights), kept, variations, odd, model, base)
    progress("fitting what they have in common")
    return _settled(first)


def odd_flights(
    quantities: Sequence[Varying], deviations: Sequence[Mapping[str, tuple[float, float]]]
) -> tuple[Odd, ...]:
    """The flights that are unlike the others, the oddest first, as long as enough are left.

    `deviations` are value and standard error per flight, by quantity.
    """
    found: list[Odd] = []
    while len(deviations) - len(found) > RULES.fewest_flights:
        remaining = [i for i in range(len(deviations)) if i not in {o.flight for o in found}]
        tried = len(remaining) * len(quantities)
        each = [_farthest(quantity, deviations, remaining, tried) for quantity in quantities]
        oddest = min(each, key=lambda o: o.p_value)
        if oddest.p_value > RULES.odd_p:
            break
        found.append(oddest)
    return tuple(found)


def _farthest(
    quantity: Varying,
    deviations: Sequence[Mapping[str, tuple[float, float]]],
    remaining: Sequence[int],
    tried: int,
) -> Odd:
    pairs = np.array([deviations[i][quantity.name] for i in remaining])
    apart: Apart = farthest(pairs[:, 0], pairs[:, 1], tried)
    return Odd(remaining[apart.flight], quantity, apart.away, apart.p_value)


def _variation(
    quantity: Varying, deviations: Sequence[Mapping[str, tuple[float, float]]], kept: Sequence[int]
) -> Own:
    pairs = np.array([of_flight[quantity.name] for of_flight in deviations])
    odd = [i for i in range(len(deviations)) if i not in kept]
    between = variation(without(pairs[:, 0], odd), without(pairs[:, 1], odd))
    return Own(quantity, pairs[:, 0], pairs[:, 1], between)


def _settled(first: Reference) -> Reference:
    """All that the flights have in common, fitted together with what varies."""
    steady = first.rig.model_copy(update={"repeatability": first.repeatability})
    flights = [first.model.flights[i] for i in first.kept]
    near, base = refitted(*_from(GantryModel(steady, flights), first.fit))
    names = tuple(n for n in FREEDOMS if n not in {e.name for e in first.rig.effect})
    start = extended(base, near.free(names))
    model, fitted = refitted(near, fit(near, names, base.episodes, start))
    idle = [name for name in names if may_be_nothing(fitted, name, RULES.nothing_level)]
    if idle:
        rest = tuple(n for n in names if n not in idle)
        model, fitted = reduced(model, fitted, rest)
    return replace(first, model=model, fit=fitted)


def _from(model: GantryModel, base: Fit) -> tuple[GantryModel, Fit]:
    """The base hypothesis on a model's flights, starting from another fit of it."""
    model = model.standing(base)
    return model, fit(model, (), range(model.episodes), base.theta)
