"""The constants of a rig that an effect or a calibration may move, by name, as plain numbers.

In: a `Rig`. Out: a dictionary of constants, and back a rig that has them. Each has the spread that
is assumed where the rig file states none.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from wakedeploy.core.rig import Rig
from wakedeploy.core.rig_sections import ThrustCurve
from wakedeploy.physics.rail import GRAVITY_MPS2

Constants = dict[str, float]


@dataclass(frozen=True)
class Spread:
    """Calibration uncertainty (1 sd) where a rig file states none: a share of the value, or more.

    The larger of `relative` times the value and `absolute` holds.
    """

    relative: float = 0.0
    absolute: float = 0.0

    def of(self, value: float) -> float:
        """One standard deviation for a constant of this value, in its unit."""
        return max(self.relative * abs(value), self.absolute)


# What constants are where a rig file does not state them: a curve as tabulated, no delay, no bias.
NEUTRAL: Constants = {
    "thrust.source.scale": 1.0,
    "thrust.source.exponent": 1.0,
    "thrust.sufferer.scale": 1.0,
    "thrust.sufferer.exponent": 1.0,
    "command.delay_s": 0.0,
    "command.window_s": 0.004,  # within which it is uncertain when a command meets a servo frame
    "range.bias_m": 0.0,
    "range.scale": 1.0,
    "range.delay_s": 0.0,
    "range.hold_s": 0.0,
}
_OF_RIG = (
    "spool.source.up_s",
    "spool.source.down_s",
    "spool.sufferer.up_s",
    "spool.sufferer.down_s",
    "wake.speed_mps",
    "wake.diffusivity_m2ps",
    "wake.decay_per_s",
    "wake.strength",
    "wake.width_m",
    "wake.speed_exponent",
    "rail.coulomb_n",
    "rail.stiction_n",
    "rail.viscous_n_per_mps",
    "disturbance.esc_frame_s",
)
_SENSOR = {"range.bias_m": "range_sensor.bias_m", "range.scale": "range_sensor.scale"}
DEFAULT_SPREAD: Mapping[str, Spread] = {
    "thrust.sufferer.scale": Spread(absolute=0.03),
    "thrust.sufferer.exponent": Spread(absolute=0.05),
    "thrust.source.exponent": Spread(absolute=0.05),
    "command.delay_s": Spread(absolute=0.002),
    "command.window_s": Spread(absolute=0.002),
    "range.bias_m": Spread(absolute=0.005),
    "range.delay_s": Spread(absolute=0.003),
    "spool.source.up_s": Spread(relative=0.1),
    "spool.source.down_s": Spread(relative=0.1),
    "spool.sufferer.up_s": Spread(relative=0.1),
    "spool.sufferer.down_s": Spread(relative=0.1),
    "wake.speed_mps": Spread(relative=0.05),
    "wake.strength": Spread(relative=0.10),
    "wake.width_m": Spread(relative=0.05),
    "wake.diffusivity_m2ps": Spread(relative=0.10),
    "rail.coulomb_n": Spread(relative=0.3, absolute=0.01),
    "rail.viscous_n_per_mps": Spread(relative=0.3, absolute=0.01),
    "rail.stiction_n": Spread(relative=0.3, absolute=0.01),  # no calibration measures it
}


def place_of(constant: str) -> str:
    """Where a rig file states this constant; a curve's scale and exponent are in its table."""
    if constant.startswith("thrust."):
        return f"{constant.rpartition('.')[0]}.thrust_n"
    return _SENSOR.get(constant, constant)


def constants_of(rig: Rig) -> Constants:
    """Every movable constant with the rig's value."""
    places = {name: name for name in _OF_RIG} | _SENSOR
    return NEUTRAL | {name: _lookup(rig, place) for name, place in places.items()}


def spreads_of(rig: Rig) -> Constants:
    """Calibration uncertainty (1 sd) of each uncertain constant: the rig file's, or the default."""
    values = constants_of(rig)
    spreads = {name: spread.of(values[name]) for name, spread in DEFAULT_SPREAD.items()}
    for name in values:
        stated = rig.calibration.get(_SENSOR.get(name, name))
        if stated is not None and stated.spread is not None:
            spreads[name] = stated.spread
    for motor in ("source", "sufferer"):
        stated = rig.calibration.get(f"thrust.{motor}.thrust_n")
        if stated is not None and stated.spread is not None:  # in newtons, at hover
            spreads[f"thrust.{motor}.scale"] = stated.spread / _hover_n(rig)
    return {name: spread for name, spread in spreads.items() if spread > 0.0}


def with_constants(rig: Rig, constants: Mapping[str, float]) -> Rig:
    """A rig whose sections state these constants; sensor bias, scale and delays stay as they are.

    Raises UnusableInput for values out of the rig's bounds.
    """
    changes: dict[str, Any] = {}
    present = constants_of(rig)
    for name, value in constants.items():
        if name in _OF_RIG and not math.isclose(value, present[name], rel_tol=1e-12):
            *sections, leaf = name.split(".")
            table = changes
            for section in sections:
                table = table.setdefault(section, {})
            table[leaf] = value
    for motor in ("source", "sufferer"):
        scale = constants.get(f"thrust.{motor}.scale", 1.0)
        exponent = constants.get(f"thrust.{motor}.exponent", 1.0)
        if (scale, exponent) != (1.0, 1.0):
            curve: ThrustCurve = getattr(rig.thrust, motor)
            moved = moved_thrust(np.array(curve.thrust_n), scale, exponent, _hover_n(rig))
            changes.setdefault("thrust", {})[motor] = {"thrust_n": moved.tolist()}
    return rig.changed(**changes) if changes else rig


def moved_thrust(
    thrust_n: npt.ArrayLike, scale: float, exponent: float, hover_n: float
) -> npt.NDArray[np.float64]:
    """A thrust [N] after a change of coefficient and exponent; hover moves by `scale` alone."""
    return np.asarray(scale * hover_n * (np.maximum(thrust_n, 0.0) / hover_n) ** exponent)


def _hover_n(rig: Rig) -> float:
    return rig.sufferer.mass_kg * GRAVITY_MPS2


def _lookup(rig: Rig, name: str) -> float:
    found: Any = rig
    for part in name.split("."):
        found = getattr(found, part)
    return float(found)
