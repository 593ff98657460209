"""The rig file after reference flights, and what it says that the old one did not.

In: a `Reference`. Out: a rig whose constants, spreads, form and repeatability are those of the
flights, with the freedoms that are surely there as effects.
"""

import datetime
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wakedeploy.core.files import sha256_of
from wakedeploy.core.rig import Rig
from wakedeploy.gap.systems.gantry.discrepancy import PREFIX
from wakedeploy.gap.systems.gantry.findings import Sized
from wakedeploy.gap.systems.gantry.reference.learning import Reference
from wakedeploy.gap.systems.gantry.search.answer import sizes_of
from wakedeploy.gap.systems.gantry.search.correction import entry_of
from wakedeploy.physics.constants import constants_of, moved_thrust, place_of, spreads_of
from wakedeploy.physics.rail import GRAVITY_MPS2
from wakedeploy.rig.update import Calibrated, updated

# Seven flights of one afternoon know a constant better than it will hold next month.
_LEAST_SHARE = 0.1  # of the stated spread
_UNPLACED = ("command.", "range.delay")  # no section of a rig file has these


@dataclass(frozen=True)
class Learned:
    """A constant before and after, with its standard deviations."""

    name: str
    stated: float
    stated_spread: float
    value: float
    spread: float

    def as_json(self) -> dict[str, Any]:
        """As `reference.json` holds it."""
        return dict(vars(self))


def constants_learned(reference: Reference) -> list[Learned]:
    """Every calibrated constant that a rig file can hold, as the flights have it."""
    stated, spreads = constants_of(reference.rig), spreads_of(reference.rig)
    names = [n for n in spreads if n in reference.fit.names and not n.startswith(_UNPLACED)]
    return [
        Learned(
            name,
            stated[name],
            spreads[name],
            reference.fit.value(name),
            _spread(reference, name, spreads[name]),
        )
        for name in names
    ]


def _spread(reference: Reference, name: str, stated: float) -> float:
    error = reference.fit.standard_error(name)
    return float(np.clip(error, _LEAST_SHARE * stated, stated))


def form_learned(reference: Reference) -> dict[str, tuple[float, float]]:
    """The form's sizes and deviations, by name without the prefix."""
    terms = [f for f in reference.fit.free if f.is_form]
    return {
        f.name.removeprefix(PREFIX): (
            reference.fit.value(f.name),
            _spread(reference, f.name, f.prior_sd),
        )
        for f in terms
    }


def form_force_n(reference: Reference) -> float:
    """Root mean square [N] of the form's change of the force along the flights."""
    fitted = reference.fit
    plain = replace(
        fitted,
        theta=np.array(
            [0.0 if f.is_form else v for f, v in zip(fitted.free, fitted.theta, strict=True)]
        ),
    )
    squares = []
    for episode, flight in enumerate(reference.model.flights):
        with_it, without = (reference.model.forces(fit, episode) for fit in (fitted, plain))
        change = (with_it.acceleration[0] - without.acceleration[0]) * with_it.inertia_kg
        squares += [change[a:b] ** 2 for a, b in zip(flight.start, flight.stop, strict=True)]
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def corrected(reference: Reference) -> Rig:
    """The rig with all that was learned; UnusableInput if its bounds do not allow a value."""
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    rig = updated(reference.rig, _calibrated(reference), date)
    rig = rig.changed(
        discrepancy={"fitted": {n: list(term) for n, term in form_learned(reference).items()}},
        repeatability=reference.repeatability.model_dump(),
    )
    digest = sha256_of("".join(f.sha256 for f in reference.flights).encode())
    found = [
        entry_of(Sized(name=n, parameters=sizes_of(reference.fit, n)), digest, date)
        for n in reference.fit.hypothesis
    ]
    return rig.model_copy(update={"effect": (*rig.effect, *found)})


def _calibrated(reference: Reference) -> dict[str, Calibrated]:
    """Constants by their place in the rig file; a motor's scale and exponent move its table."""
    learned = {constant.name: constant for constant in constants_learned(reference)}
    known = {
        place_of(name): Calibrated(constant.value, constant.spread)
        for name, constant in learned.items()
        if not name.startswith("thrust.")
    }
    for motor in ("source", "sufferer"):
        known |= _thrust(reference.rig, motor, learned)
    return known


def _thrust(rig: Rig, motor: str, learned: Mapping[str, Learned]) -> dict[str, Calibrated]:
    scale, exponent = (learned.get(f"thrust.{motor}.{part}") for part in ("scale", "exponent"))
    if scale is None and exponent is None:
        return {}
    hover_n = rig.sufferer.mass_kg * GRAVITY_MPS2
    table = np.array(getattr(rig.thrust, motor).thrust_n)
    moved = moved_thrust(
        table, scale.value if scale else 1.0, exponent.value if exponent else 1.0, hover_n
    )
    place = f"thrust.{motor}.thrust_n"
    stated = rig.calibration.get(place)
    # A source's own scale is part of the wake's strength: its table keeps its old spread.
    kept_n = (stated.spread if stated is not None else None) or 0.0
    spread_n = scale.spread * hover_n if scale else kept_n
    return {place: Calibrated(tuple(moved.tolist()), spread_n)}
