"""Every force along one flight, from the logged commands: arrays on the flight's grid.

The stages of the plant, one after another, each over the whole flight: command, actuator, wake,
force, body, sensor. A stage's result is kept while its constants and effects stay the same, because
a fit moves one parameter at a time.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np

from wakedeploy.core.rig import Rig
from wakedeploy.gap.systems.gantry.discrepancy import (
    friction_basis,
    friction_n,
    heights_of,
    places_of,
    wake_basis,
    wake_factor,
)
from wakedeploy.gap.systems.gantry.flight import DT_S, Flight, FloatArray, Line
from wakedeploy.gap.systems.gantry.repeated_readings import Held, chance_of_equals, held
from wakedeploy.gap.systems.gantry.servo_frames import period_s
from wakedeploy.physics.constants import Constants, moved_thrust
from wakedeploy.physics.effects import Motion, Setting
from wakedeploy.physics.effects.acting import blow, motion_along, push
from wakedeploy.physics.effects.chain import Chain, Parts, setting_of
from wakedeploy.physics.jet import Floats, drag_force, paces, puff_count, puff_shapes
from wakedeploy.physics.range_sensor import seen_m
from wakedeploy.physics.series import jet_along, rail_friction, spooled_thrust

Result = TypeVar("Result")

_JET_DT_S = 2.0 * DT_S  # puffs at 64 Hz still overlap by more than their width
_DZ_M = 0.005  # step of slopes by height; smaller than anything that varies with height
_DV_MPS = 0.01  # step of slopes by speed
_SLIDING_MPS = 0.003  # error of a smoothed speed about zero; more bends a steep friction
_RESTING_MPS = 0.006  # at a lower smoothed speed the sufferer stands as often as not
_PASSED_S = 3.0  # a puff is gone by then, however slow the wake
_KEPT = 3
_SHAPING = ("speed_mps", "speed_exponent", "diffusivity_m2ps", "decay_per_s", "width_m")
_PUSHING = ("sufferer_n", "wake_mps", "force_n", "added_mass_kg")
_PULSES_AVERAGED = 5


@dataclass(frozen=True, eq=False)
class Forces:
    """Along one flight's grid (N,) and samples (n,); see `wakedeploy.physics.series.filtered`.

    `acceleration` (3, N): [m/s²] at the nominal motion, and its slopes by height and by speed.
    `expected` (2, n): the reading at the nominal height, and its slope. `taken_s` (n,): when the
    samples were taken. `held`: how a sensor that repeats itself holds them.
    """

    source_n: FloatArray
    sufferer_n: FloatArray
    wake_mps: FloatArray
    wake_n: FloatArray
    inertia_kg: FloatArray
    acceleration: FloatArray
    taken_s: FloatArray
    expected: FloatArray
    held: Held


class Physics:
    """The forces along one flight for any constants and effects."""

    def __init__(self, rig: Rig, flight: Flight) -> None:
        self._rig, self._flight = rig, flight
        self._setting = setting_of(rig)
        self._weight_n = self._setting.weight_n
        first, last = _in_the_air(flight)
        self._flown = slice(first, last)
        self._air = slice(max(first - round(_PASSED_S / DT_S), 0) // 2 * 2, last)
        self._kept: dict[str, OrderedDict[Hashable, object]] = {}
        self._bends: dict[tuple[float, float], FloatArray] = {}
        self._still = motion_along(
            flight.grid_s, flight.take_off_s, flight.x_m, flight.vx_mps, DT_S
        )
        edges = np.append(flight.grid_s, flight.grid_s[-1] + DT_S)
        self._edges = edges
        sensor = rig.range_sensor
        self._chance = chance_of_equals(sensor.resolution_m, sensor.noise_m)

    def forces(self, constants: Constants, effects: Chain) -> Forces:
        """All stages; see `Forces`."""
        source_n, sufferer_n, charge_s = self._thrusts(constants, effects)
        wake = self._wake(constants, effects, source_n)
        return self._summed(constants, effects, source_n, sufferer_n, charge_s, wake)

    def _thrusts(
        self, constants: Constants, effects: Chain
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        source = self._motor("source", constants, effects)
        sufferer = self._motor("sufferer", constants, effects)
        # An array is kept with what was made from it, so that no other can get its id.
        charge_s, _ = self._remembered(
            "charge",
            id(sufferer),
            lambda: (np.cumsum(sufferer) * (DT_S / self._weight_n), sufferer),
        )
        if effects.acts_on("source_n"):
            made = _with(self._still, source_n=source, sufferer_n=sufferer, charge_s=charge_s)
            source = np.asarray(effects.source_n(made, self._setting))
        return source, sufferer, charge_s

    def _motor(self, motor: str, constants: Constants, effects: Chain) -> FloatArray:
        """Thrust [N] on the grid, spool lag included."""
        names = ("command.delay_s", "command.window_s", "disturbance.esc_frame_s")
        thrust = [f"thrust.{motor}.{c}" for c in ("scale", "exponent")]
        lags = [f"spool.{motor}.{c}" for c in ("up_s", "down_s")]
        pulses = _key(effects.acting("pulse_us"))
        key = (*(constants[n] for n in (*names, *thrust, *lags)), pulses)

        def compute() -> FloatArray:
            pulse_us = self._remembered(
                f"pulses.{motor}",
                (*key[:3], pulses),
                lambda: self._pulses(motor, constants, effects),
            )
            curve = getattr(self._rig.thrust, motor)
            table = np.array(curve.thrust_n)
            moved = moved_thrust(table, constants[thrust[0]], constants[thrust[1]], self._weight_n)
            target = np.sqrt(np.interp(pulse_us, curve.pulse_us, moved))
            return np.asarray(spooled_thrust(target, constants[lags[0]], constants[lags[1]], DT_S))

        return self._remembered(f"motor.{motor}", key, compute)

    def _pulses(self, motor: str, constants: Constants, effects: Chain) -> FloatArray:
        """The mean pulse [µs] that the ESC acted on in each step.

        If the log shows frames of another period than the rig file's, a period on the way between
        the two is a mixture, so that its likelihood is smooth.
        """
        stated_s = self._rig.disturbance.esc_frame_s
        longer_s = constants["disturbance.esc_frame_s"] - stated_s
        reported_s = self._flight.reported_frame_s
        if reported_s is None:
            return self._taken(motor, constants, effects, self._flight.frame_s, longer_s)
        stated = self._taken(motor, constants, effects, self._flight.frame_s, 0.0)
        if longer_s == 0.0:
            return stated
        reported = self._taken(motor, constants, effects, reported_s, 0.0)
        return stated + longer_s / (period_s(reported_s) - stated_s) * (reported - stated)

    def _taken(
        self,
        motor: str,
        constants: Constants,
        effects: Chain,
        frame_s: FloatArray,
        longer_s: float,
    ) -> FloatArray:
        """The same with the servo frames at `frame_s`, each up to `longer_s` longer."""
        window_s, delay_s = constants["command.window_s"], constants["command.delay_s"]

        def asked() -> tuple[FloatArray, FloatArray]:
            line: Line = getattr(self._flight, motor)
            share = (np.arange(_PULSES_AVERAGED) + 0.5) / _PULSES_AVERAGED
            back_s = window_s * (share - 0.5) + longer_s * share
            return line.at(frame_s[:, None] - delay_s - back_s[None, :]).mean(axis=1), frame_s

        key = (window_s, delay_s, longer_s, id(frame_s))
        pulse, _ = self._remembered(f"asked.{motor}", key, asked)
        pulse = effects.pulses_us(pulse, motor, self._rig.limits.pulse_us[0])
        area = np.concatenate([[0.0], np.cumsum(pulse[:-1] * np.diff(frame_s))])
        at_edges = np.interp(self._edges, frame_s, area)
        mean = np.diff(at_edges) / DT_S
        outside = (self._edges[1:] > frame_s[-1]) | (self._edges[:-1] < frame_s[0])
        mean[outside] = self._rig.limits.pulse_us[0]
        return np.asarray(mean)

    def _wake(
        self, constants: Constants, effects: Chain, source_n: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Vertical air speed [m/s] at the nominal height and its slope [1/s], (N,) each."""
        # The air's speed is linear in the strength, which therefore needs no new sum over puffs.
        moving = _key(effects.acting("wake_offset_m"))
        carriage_m = self._carriage_m(effects)
        shape = tuple(_of_wake(constants).values())
        key = (id(source_n), shape, id(carriage_m), moving)

        def compute() -> tuple[FloatArray, FloatArray, FloatArray]:
            lateral_m = carriage_m
            if moving:
                motion = _with(self._still, source_n=source_n)
                lateral_m = carriage_m - effects.wake_offset_m(motion, self._setting)
            return *self._jet(constants, source_n, lateral_m), lateral_m

        air, *_ = self._remembered("air", key, lambda: (compute(), source_n, carriage_m))
        strength = constants["wake.strength"]
        wake, _ = self._remembered(
            "wake", (id(air), strength), lambda: ((strength * air[0], strength * air[1]), air)
        )
        return self._formed(constants, wake, air[2])

    def _formed(
        self, constants: Constants, wake: tuple[FloatArray, FloatArray], lateral_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The wake with the correction of the model's form."""
        names = ("wake.speed_mps", "wake.width_m", "wake.diffusivity_m2ps")
        sizes = tuple(v for n, v in constants.items() if n.startswith("discrepancy.wake."))
        if not any(sizes):
            return wake

        def over() -> tuple[FloatArray, object]:
            z_m = self._flight.nominal[0]
            places = places_of(constants, self._rig.source.height_m, lateral_m, z_m)
            return wake_basis(places, heights_of(self._rig.sufferer.travel_m, z_m)), lateral_m

        shape = (id(lateral_m), *(constants[n] for n in names))
        basis, _ = self._remembered("form", shape, over)

        def compute() -> tuple[tuple[FloatArray, FloatArray], object, object]:
            factor = wake_factor(constants, basis)
            return (wake[0] * factor, wake[1] * factor), wake, basis

        return self._remembered("formed", (id(wake), id(basis), sizes), compute)[0]

    def _carriage_m(self, effects: Chain) -> FloatArray:
        """The carriage's true place [m] when its steps say `x_m`."""
        return self._remembered(
            "carriage",
            _key(effects.acting("carriage_m")),
            lambda: effects.carriages_m(self._flight.x_m),
        )

    def _jet(
        self, constants: Constants, source_n: FloatArray, x_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        air = self._air
        count = (air.stop - air.start) // 2
        root = np.sqrt(np.maximum(source_n[air.start : air.start + 2 * count], 0.0))
        root = root.reshape(count, 2).mean(axis=1)
        root /= math.sqrt(self._rig.wake.reference_thrust_n)
        ends = air.start + 2 * np.arange(1, count + 1) - 1
        above = self._flight.nominal[0, ends] - self._rig.source.height_m
        shape = _of_wake(constants)
        ages, *shapes = self._remembered("puffs", tuple(shape.values()), lambda: self._puffs(shape))
        speed = np.full(count, shape["speed_mps"])
        if shape["speed_exponent"] != 0.0:
            speed *= paces(root, shape["speed_exponent"])
        velocity, slope = jet_along(root, x_m[ends], above, speed, ages, *shapes)
        # Evaluated at the ends of pairs of steps, but wanted at the middle of each step.
        at = np.arange(len(source_n)) + 0.5
        return np.interp(at, ends + 1.0, velocity), np.interp(at, ends + 1.0, slope)

    def _puffs(self, shape: dict[str, float]) -> tuple[FloatArray, Floats, Floats]:
        """Ages [s], axial speeds [m/s] and widths² [m²] of the puffs in the air, (M,)."""
        wake = self._rig.wake.model_copy(update=shape)
        count = puff_count(wake, _JET_DT_S, self._rig.source.height_m)
        ages = np.asarray(_JET_DT_S * (np.arange(count) + 0.5), float)
        return ages, *puff_shapes(wake, ages, _JET_DT_S)

    def _summed(
        self,
        constants: Constants,
        effects: Chain,
        source_n: FloatArray,
        sufferer_n: FloatArray,
        charge_s: FloatArray,
        wake: tuple[FloatArray, FloatArray],
    ) -> Forces:
        nominal = self._flight.nominal
        motion = _with(
            self._still,
            z_m=nominal[0],
            vz_mps=nominal[1],
            source_n=source_n,
            source_rate_nps=np.append(0.0, np.diff(source_n) / DT_S),
            sufferer_n=sufferer_n,
            charge_s=charge_s,
        )
        rail = tuple(
            constants[f"rail.{c}"] for c in ("coulomb_n", "viscous_n_per_mps", "stiction_n")
        )
        acting = tuple(_key(effects.acting(quantity)) for quantity in _PUSHING)
        form = tuple(v for n, v in constants.items() if n.startswith("discrepancy.friction."))
        key = (id(source_n), id(sufferer_n), id(wake[0]), rail, form)

        def compute() -> _Sum:
            # Half of a log is before take-off and after touch-down, where nobody needs the forces.
            flown, air = _part(motion, self._flown), (wake[0][self._flown], wake[1][self._flown])
            at = _Motions(self._rig, self._setting, flown, air, self._bends)
            middle = at.acceleration(constants, effects, 0.0, 0.0)
            higher = at.acceleration(constants, effects, _DZ_M, 0.0)[0]
            faster = at.acceleration(constants, effects, 0.0, _DV_MPS)[0]
            slower = at.acceleration(constants, effects, 0.0, -_DV_MPS)[0]
            slopes = (higher - middle[0]) / _DZ_M, (faster - slower) / (2 * _DV_MPS)
            linear = np.stack([self._held(values) for values in (middle[0], *slopes)])
            thrust_n, air_mps, wake_n, inertia_kg = (self._held(values) for values in middle[1:])
            made_of = (source_n, sufferer_n, wake)
            return _Sum(linear, thrust_n, air_mps, wake_n, inertia_kg, made_of)

        found = self._remembered("sum", (*key, acting), compute)
        return Forces(
            source_n,
            found.sufferer_n,
            found.wake_mps,
            found.wake_n,
            found.inertia_kg,
            found.acceleration,
            *self._reading(constants, effects, motion),
        )

    def _held(self, flown: FloatArray) -> FloatArray:
        """Values known in the air, (n,), on the whole grid (N,); outside, the nearest of them."""
        whole = np.empty(len(self._flight.grid_s))
        first, last = self._flown.start, self._flown.stop
        whole[:first], whole[first:last], whole[last:] = flown[0], flown, flown[-1]
        return whole

    def _reading(
        self, constants: Constants, effects: Chain, motion: Motion
    ) -> tuple[FloatArray, FloatArray, Held]:
        flight = self._flight
        hold_s = constants["range.hold_s"]
        pattern = self._remembered(
            "held", hold_s, lambda: held(flight.sample_s, flight.repeated, hold_s, self._chance)
        )
        # Ages are means over what is possible: a reading may seem older than the one before it.
        made_s = np.maximum.accumulate(flight.sample_s - pattern.age_s)
        taken_s = made_s - constants["range.delay_s"]
        z = np.interp(taken_s, flight.grid_s, flight.nominal[0])
        expected = []
        for dz in (0.0, _DZ_M):
            at = _with(motion, time_s=taken_s - flight.take_off_s, z_m=z + dz)
            value = seen_m(z + dz, constants["range.bias_m"], constants["range.scale"])
            expected.append(np.asarray(effects.range_m(value, at, self._setting)))
        slope = (expected[1] - expected[0]) / _DZ_M
        return taken_s, np.stack([expected[0], slope]), pattern

    def at_rest(self, constants: Constants, effects: Chain) -> FloatArray:
        """The readings (r,) expected at rest on the stop, before and after the flight."""
        time_s = np.maximum(self._flight.rest[:, 2] - self._flight.take_off_s, 0.0)
        stop_m = np.zeros(len(time_s))
        value = seen_m(stop_m, constants["range.bias_m"], constants["range.scale"])
        return np.asarray(effects.range_m(value, Motion(time_s=time_s), self._setting))

    def _remembered(self, stage: str, key: Hashable, compute: Callable[[], Result]) -> Result:
        kept = self._kept.setdefault(stage, OrderedDict())
        if key in kept:
            kept.move_to_end(key)
            return kept[key]  # type: ignore[return-value]
        result = compute()
        kept[key] = result
        if len(kept) > _KEPT:
            kept.popitem(last=False)
        return result


class _Sum(NamedTuple):
    """All that acts on the sufferer, and what it was made from: ids of that are the key."""

    acceleration: FloatArray
    sufferer_n: FloatArray
    wake_mps: FloatArray
    wake_n: FloatArray
    inertia_kg: FloatArray
    made_of: object


@dataclass(frozen=True, eq=False)
class _Motions:
    """The forces along a flight, at motions near the nominal one."""

    rig: Rig
    setting: Setting
    nominal: Motion
    wake: tuple[FloatArray, FloatArray]
    bends: dict[tuple[float, float], FloatArray]  # of the friction, at motions that were asked for

    def acceleration(
        self, constants: Constants, effects: Chain, dz_m: float, dv_mps: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Acceleration [m/s²], the sufferer's thrust, the wake's speed and force, the inertia."""
        air = self.wake[0] + self.wake[1] * dz_m
        m = _with(
            self.nominal,
            z_m=self.nominal.z_m + dz_m,
            vz_mps=self.nominal.vz_mps + dv_mps,
        )
        air_mps = np.asarray(blow(effects, m, self.setting, air))
        wake_n = drag_force(self.rig.wake, 0.0, air_mps)
        extra_n, added_kg = push(effects, m, self.setting, wake_n)
        inertia = np.full(len(wake_n), self.setting.mass_kg) + added_kg
        driving = np.asarray(m.sufferer_n + wake_n + extra_n - self.setting.weight_n)
        total = driving - rail_friction(
            np.asarray(m.vz_mps),
            driving,
            constants["rail.coulomb_n"],
            constants["rail.viscous_n_per_mps"],
            constants["rail.stiction_n"],
            _SLIDING_MPS,
            _RESTING_MPS,
        )
        if (dz_m, dv_mps) not in self.bends:
            heights = heights_of(self.setting.travel_m, np.asarray(m.z_m))
            self.bends[dz_m, dv_mps] = friction_basis(np.asarray(m.vz_mps), heights)
        total = total - friction_n(self.rig, constants, self.bends[dz_m, dv_mps])
        return total / inertia, np.asarray(m.sufferer_n), air_mps, wake_n, inertia


def _in_the_air(flight: Flight) -> tuple[int, int]:
    """The grid's first and last steps whose forces matter; all if it never flew."""
    if not len(flight.start):
        return 0, len(flight.grid_s)
    return max(int(flight.start.min()) - 1, 0), min(int(flight.stop.max()) + 1, len(flight.grid_s))


def _part(motion: Motion, steps: slice) -> Motion:
    """The same motion over some of its steps."""
    return Motion(**{n: v[steps] if np.ndim(v) else v for n, v in vars(motion).items()})


def _of_wake(constants: Constants) -> dict[str, float]:
    """The wake's constants at unit strength, by their names in its section."""
    return {name: constants[f"wake.{name}"] for name in _SHAPING} | {"strength": 1.0}


def _key(effects: Parts) -> Hashable:
    return tuple((effect.name, *values.values()) for effect, values in effects)


def _with(motion: Motion, **changed: Any) -> Motion:
    return Motion(**(vars(motion) | changed))
