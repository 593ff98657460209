"""What an effect is: one named piece of physics with parameters, and where it acts.

The same class serves the plant, which calls it with numbers step by step, and the gap workflow,
which calls it with arrays over a whole flight. An effect therefore keeps no state: whatever it
needs to remember (charge drawn, way travelled) is in the `Motion` it is given, or is its own answer
of a step before (a pulse, the carriage's place).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Number = float | FloatArray  # one step of the plant, or a whole flight
Values = Mapping[str, float]

Stage = Literal["command", "actuator", "wake", "force", "body", "sensor"]
STAGES: tuple[Stage, ...] = ("command", "actuator", "wake", "force", "body", "sensor")


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    `scale`: how large the effect plausibly is, as the standard deviation of its prior around the
    neutral value. `constant`: the constant of the rig that this parameter replaces (see
    `wakedeploy.physics.constants`); its neutral value is then the rig's own, else `neutral`.
    `starts`: how far from neutral (in `scale`) fits begin, where the neutral point itself has no
    slope. `scanned`: least size, largest size, and the ratio from one to the next, for a likelihood
    so jagged that every such size is looked at first. `summits_apart`: how far its summits stand
    from each other, as a share of the size; no standard error below that is stated. Nor is one
    below `finest`: what the laws that a fit goes by leave open, however much is flown.
    """

    name: str
    unit: str
    scale: float
    low: float
    high: float
    neutral: float = 0.0
    constant: str | None = None
    starts: tuple[float, ...] = (0.5,)
    scanned: tuple[float, float, float] | None = None
    summits_apart: float = 0.0
    finest: float = 0.0

    def neutral_on(self, constants: Values) -> float:
        """The value at which it changes nothing on a rig with these constants."""
        return self.neutral if self.constant is None else constants[self.constant]


@dataclass
class Motion:
    """The state of the rig that effects may look at, in SI units; numbers or arrays (N,).

    `time_s` counts from the first take-off, `charge_s` is the integral of the sufferer's thrust
    over its weight, `travelled_m` the carriage's way so far, `direction` the sign of its last
    motion. `source_rate_nps` is how fast the source's thrust changes, `wake_mps` the air's vertical
    speed at the sufferer, `wake_n` the wake's force.
    """

    time_s: Number = 0.0
    x_m: Number = 0.0
    vx_mps: Number = 0.0
    z_m: Number = 0.0
    vz_mps: Number = 0.0
    source_n: Number = 0.0
    source_rate_nps: Number = 0.0
    sufferer_n: Number = 0.0
    wake_mps: Number = 0.0
    wake_n: Number = 0.0
    charge_s: Number = 0.0
    travelled_m: Number = 0.0
    direction: Number = 0.0


@dataclass(frozen=True)
class Setting:
    """What about the rig an effect may need and never changes."""

    source_height_m: float
    mass_kg: float
    weight_n: float
    rotor_radius_m: float
    travel_m: float


class Effect:
    """Base of all effects: acts nowhere. A subclass overrides the methods of its stage.

    Class attributes: `name` as in rig files and results, `stage`, `parameters`. `physics` is one
    sentence. `equation` says the same in the symbols of docs/reference/effects.md, with a prime for
    what it makes. `confused_with` names effects that look alike, `split_by` the manoeuvre or sensor
    that tells them apart. `shows_in` is what it changes beside the sufferer's motion, by the names
    of sensors that one could buy (`gap.systems.gantry.planning.sensors`). An effect whose
    parameters all replace constants of the rig needs no method at all.
    """

    name: ClassVar[str]
    physics: ClassVar[str]
    equation: ClassVar[str]
    stage: ClassVar[Stage]
    parameters: ClassVar[tuple[Parameter, ...]]
    confused_with: ClassVar[tuple[str, ...]] = ()
    split_by: ClassVar[str] = ""
    shows_in: ClassVar[tuple[str, ...]] = ()

    @property
    def constants(self) -> tuple[str, ...]:
        """The rig's constants that its parameters stand for."""
        return tuple(p.constant for p in self.parameters if p.constant is not None)

    @classmethod
    def changes(cls, *quantities: str) -> bool:
        """Whether it changes any of these quantities, named as its methods are."""
        return any(getattr(cls, name) is not getattr(Effect, name) for name in quantities)

    def pulse_us(
        self, p: Values, pulse_us: float, applied_us: float, motor: str, idle_us: float
    ) -> float:
        """The pulse [µs] that a motor's ESC takes over instead of `pulse_us`.

        Asked once per servo frame and motor ("source", "sufferer"); `applied_us` is the answer of
        the frame before.
        """
        return pulse_us

    def pulses_us(self, p: Values, pulses_us: FloatArray, motor: str, idle_us: float) -> FloatArray:
        """What the ESC takes over [µs] (n,) of a whole flight's pulses (n,), from idle on.

        The same as `pulse_us` frame by frame; fits ask it thousands of times.
        """
        taken = np.empty_like(pulses_us)
        applied_us = idle_us
        for i, pulse_us in enumerate(pulses_us.tolist()):
            taken[i] = applied_us = self.pulse_us(p, pulse_us, applied_us, motor, idle_us)
        return taken

    def source_n(self, p: Values, m: Motion, s: Setting) -> Number:
        """The source's thrust [N] instead of `m.source_n`."""
        return m.source_n

    def sufferer_n(self, p: Values, m: Motion, s: Setting) -> Number:
        """The sufferer's thrust [N] instead of `m.sufferer_n`."""
        return m.sufferer_n

    def carriage_m(self, p: Values, drive_m: float, before_m: float) -> float:
        """Where the carriage is [m] when its drive is at `drive_m`.

        Asked once per step; `before_m` is the answer of the step before.
        """
        return drive_m

    def carriages_m(self, p: Values, drive_m: FloatArray) -> FloatArray:
        """Where the carriage is [m] (n,) along its drive's path (n,), at whose start they agree."""
        places_m = np.empty_like(drive_m)
        carriage_m = float(drive_m[0])
        for i, at_m in enumerate(drive_m.tolist()):
            places_m[i] = carriage_m = self.carriage_m(p, at_m, carriage_m)
        return places_m

    def wake_offset_m(self, p: Values, m: Motion, s: Setting) -> Number:
        """How far to the right [m] the wake lies of where the carriage says it is."""
        return 0.0

    def wake_mps(self, p: Values, m: Motion, s: Setting) -> Number:
        """The air's vertical speed [m/s] at the sufferer instead of `m.wake_mps`."""
        return m.wake_mps

    def force_n(self, p: Values, m: Motion, s: Setting) -> Number:
        """An extra vertical force [N] on the sufferer, up positive."""
        return 0.0

    def added_mass_kg(self, p: Values, m: Motion, s: Setting) -> Number:
        """What the sufferer's inertia gains [kg]; its weight stays."""
        return 0.0

    def range_m(self, p: Values, range_m: Number, m: Motion, s: Setting) -> Number:
        """The range [m] that is read where `range_m` would have been."""
        return range_m


def as_numbers(values: Mapping[str, Any]) -> dict[str, float]:
    """Parameter values as plain floats."""
    return {name: float(value) for name, value in values.items()}
