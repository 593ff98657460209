"""Every force along one flight, from the logged commands: arrays on the flight's grid.

The stages of the plant, one after another, each over the whole flight: command, actuator, wake,
force, body, sensor. A stage's result is kept while its constants and effects stay the same, because
a fit moves one parameter at a time.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np

from wakedeploy.core.rig import Rig
from wakedeploy.gap.systems.gantry.discrepancy import (
    FRICTION_TERMS,
    WAKE_TERMS,
    friction_basis,
    friction_n,
    heights_of,
    places_of,
    wake_basis,
    wake_factor,
)
from wakedeploy.gap.systems.gantry.flight import DT_S, Flight, FloatArray, IntArray, Line, placed
from wakedeploy.gap.systems.gantry.repeated_readings import Held, chance_of_equals, held
from wakedeploy.gap.systems.gantry.servo_frames import period_s
from wakedeploy.physics.constants import Constants, moved_thrust
from wakedeploy.physics.effects import Motion, Number
from wakedeploy.physics.effects.acting import blow, motion_along, push
from wakedeploy.physics.effects.chain import Chain, Parts, setting_of
from wakedeploy.physics.jet import Floats, drag_force, paces, puff_count, puff_shapes
from wakedeploy.physics.range_sensor import seen_m
from wakedeploy.physics.series import (
    jet_along,
    mean_in_steps,
    puff_weights,
    rail_friction,
    sliding_and_resting,
    spooled_thrust,
)

Result = TypeVar("Result")

_JET_DT_S = 2.0 * DT_S  # puffs at 64 Hz still overlap by more than their width
_DZ_M = 0.005  # step of slopes by height; smaller than anything that varies with height
_DV_MPS = 0.01  # step of slopes by speed
# The motions at which forces are asked, as height [m] and speed [m/s] beside the nominal one.
_NEARBY = np.array([[0.0, 0.0], [_DZ_M, 0.0], [0.0, _DV_MPS], [0.0, -_DV_MPS]])
_SLIDING_MPS = 0.003  # error of a smoothed speed about zero; more bends a steep friction
_RESTING_MPS = 0.006  # at a lower smoothed speed the sufferer stands as often as not
_PASSED_S = 3.0  # a puff is gone by then, however slow the wake
_KEPT = 3
_MOST_WEIGHTS = 200_000  # of puffs, as numbers that are kept, three times for each flight
_SHAPING = ("speed_mps", "speed_exponent", "diffusivity_m2ps", "decay_per_s", "width_m")
_PUSHING = ("sufferer_n", "wake_mps", "force_n", "added_mass_kg")
_PULSES_AVERAGED = 5
_EQUALLY = np.full(_PULSES_AVERAGED, 1.0 / _PULSES_AVERAGED)


@dataclass(frozen=True, eq=False)
class Forces:
    """Along one flight's grid (N,) and samples (n,); see `wakedeploy.physics.series.filtered`.

    `acceleration` (3, N): [m/s²] at the nominal motion, and its slopes by height and by speed.
    `expected` (2, n): the reading at the nominal height, and its slope. `taken_s` (n,): when the
    samples were taken, in step `step_of` (n,) and `into_s` (n,) after it began. `held`: how a
    sensor that repeats itself holds them.
    """

    source_n: FloatArray
    sufferer_n: FloatArray
    wake_mps: FloatArray
    wake_n: FloatArray
    inertia_kg: FloatArray
    acceleration: FloatArray
    taken_s: FloatArray
    step_of: IntArray
    into_s: FloatArray
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
        z_m, vz_mps = (values[self._flown] for values in flight.nominal)
        self._z_m = z_m + _NEARBY[:, :1]  # (4, n)
        self._vz_mps = vz_mps + _NEARBY[:, 1:]  # (4, n)
        near_rest = sliding_and_resting(self._vz_mps, _SLIDING_MPS, _RESTING_MPS)
        self._near_rest = tuple(values.ravel() for values in near_rest)
        self._bends = friction_basis(self._vz_mps, heights_of(rig.sufferer.travel_m, self._z_m))
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
            return line.at(frame_s[:, None] - delay_s - back_s[None, :]) @ _EQUALLY, frame_s

        key = (window_s, delay_s, longer_s, id(frame_s))
        pulse, _ = self._remembered(f"asked.{motor}", key, asked)
        pulse = effects.pulses_us(pulse, motor, self._rig.limits.pulse_us[0])
        idle_us = self._rig.limits.pulse_us[0]
        return np.asarray(mean_in_steps(self._edges, frame_s, pulse, idle_us))

    def _wake(
        self, constants: Constants, effects: Chain, source_n: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """While flown: the air's speed [m/s] at the nominal height, and its slope [1/s], (n,)."""
        # The air's speed is linear in the strength, which therefore needs no new sum over puffs.
        moving = _key(effects.acting("wake_offset_m"))
        carriage_m = self._carriage_m(effects)
        shape = tuple(_of_wake(constants).values())
        key = (id(source_n), shape, id(carriage_m), moving)

        def compute() -> tuple[FloatArray, FloatArray, FloatArray]:
            lateral_m = carriage_m
            if moving:
                motion = _with(self._still, source_n=source_n)
                moved_m = carriage_m - effects.wake_offset_m(motion, self._setting)
                # An offset that the source's thrust leaves alone is the same array for all thrusts.
                lateral_m = self._remembered("lateral", moved_m.tobytes(), lambda: moved_m)
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
        sizes = tuple(constants.get(name, 0.0) for name in WAKE_TERMS)
        if not any(sizes):
            return wake

        def over() -> tuple[FloatArray, object]:
            z_m, x_m = self._flight.nominal[0, self._flown], lateral_m[self._flown]
            places = places_of(constants, self._rig.source.height_m, x_m, z_m)
            return wake_basis(places, heights_of(self._rig.sufferer.travel_m, z_m)), lateral_m

        shape = (id(lateral_m), *(constants[n] for n in names))
        basis, _ = self._remembered("form", shape, over)

        key = (id(basis), sizes)
        factor, _ = self._remembered("factor", key, lambda: (wake_factor(constants, basis), basis))
        formed, *_ = self._remembered(
            "formed",
            (id(wake), id(factor)),
            lambda: ((wake[0] * factor, wake[1] * factor), wake, factor),
        )
        return formed

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
        root = 0.5 * (root[::2] + root[1::2])
        root /= math.sqrt(self._rig.wake.reference_thrust_n)
        ends = air.start + 2 * np.arange(1, count + 1) - 1
        shape = _of_wake(constants)
        ages, *shapes = self._puffs(shape, count)
        speed = np.full(count, shape["speed_mps"])

        def weigh() -> FloatArray:
            above = self._flight.nominal[0, ends] - self._rig.source.height_m
            return np.asarray(puff_weights(x_m[ends], above, speed, ages, *shapes))

        if shape["speed_exponent"] != 0.0:
            speed *= paces(root, shape["speed_exponent"])
            weights = weigh()
        elif count * len(ages) > _MOST_WEIGHTS:
            weights = weigh()
        else:  # all puffs sink alike, so that their weights are the same for all thrusts
            key = (*shape.values(), id(x_m))
            weights, _ = self._remembered("puffs", key, lambda: (weigh(), x_m))
        at_ends = jet_along(root, weights)  # (2, count)
        # Evaluated at the ends of pairs of steps, but wanted at the middle of each step.
        step = 0.25 * np.diff(at_ends)
        in_air = np.stack([at_ends[:, :-1] + step, at_ends[:, 1:] - step], axis=2)  # (2, …, 2)
        at_middles = np.empty((2, len(source_n)))
        at_middles[:, : ends[0] + 1], at_middles[:, ends[-1] + 1 :] = (
            at_ends[:, :1],
            at_ends[:, -1:],
        )
        at_middles[:, ends[0] + 1 : ends[-1] + 1] = in_air.reshape(2, -1)
        return at_middles[0, self._flown], at_middles[1, self._flown]

    def _puffs(self, shape: dict[str, float], most: int) -> tuple[FloatArray, Floats, Floats]:
        """Ages [s], axial speeds [m/s] and widths² [m²] of the puffs in the air, (M,).

        No older ones than the `most` that the flight has made: a fit may ask for a wake that hardly
        sinks, whose puffs would stay in reach for hours.
        """
        wake = self._rig.wake.model_copy(update=shape)
        count = min(puff_count(wake, _JET_DT_S, self._rig.source.height_m), most)
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
        thrusts = (source_n, sufferer_n, charge_s)
        rail = tuple(
            constants[f"rail.{c}"] for c in ("coulomb_n", "viscous_n_per_mps", "stiction_n")
        )
        acting = tuple(_key(effects.acting(quantity)) for quantity in _PUSHING)
        form = tuple(constants.get(name, 0.0) for name in FRICTION_TERMS)
        key = (id(source_n), id(sufferer_n), id(wake[0]), rail, form, acting)
        total, _ = self._remembered(
            "sum",
            key,
            lambda: (
                self._total(constants, effects, self._motion(*thrusts), wake),
                (*thrusts, wake),
            ),
        )
        return Forces(source_n, *total, *self._reading(constants, effects, thrusts))

    def _motion(self, source_n: FloatArray, sufferer_n: FloatArray, charge_s: FloatArray) -> Motion:
        """What effects may look at along the whole flight, (N,)."""
        return _with(
            self._still,
            z_m=self._flight.nominal[0],
            vz_mps=self._flight.nominal[1],
            source_n=source_n,
            source_rate_nps=np.append(0.0, np.diff(source_n) / DT_S),
            sufferer_n=sufferer_n,
            charge_s=charge_s,
        )

    def _total(
        self,
        constants: Constants,
        effects: Chain,
        motion: Motion,
        wake: tuple[FloatArray, FloatArray],
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """The sufferer's thrust, the air's speed, the wake's force, the inertia, the acceleration.

        As `Forces` has them. The acceleration's slopes are differences between motions nearby.
        """
        # Half of a log is before take-off and after touch-down, where nobody needs the forces.
        flown = _part(motion, self._flown)
        air_mps = wake[0] + wake[1] * _NEARBY[:, :1]  # (4, n)
        if any(effects.acts_on(quantity) for quantity in _PUSHING):
            nearby = [
                self._pushed(effects, _with(flown, z_m=z_m, vz_mps=vz_mps), air)
                for z_m, vz_mps, air in zip(self._z_m, self._vz_mps, air_mps, strict=True)
            ]  # one after another: an effect knows a motion's arrays as (n,) alone
            at = _Pushed(*(_stacked(values, air_mps) for values in zip(*nearby, strict=True)))
        else:
            at = self._pushed(effects, _with(flown, vz_mps=self._vz_mps), air_mps)
        driving_n = at.driving_n
        friction = rail_friction(
            self._vz_mps.ravel(),
            *self._near_rest,
            driving_n.ravel(),
            constants["rail.coulomb_n"],
            constants["rail.viscous_n_per_mps"],
            constants["rail.stiction_n"],
        )
        form = tuple(constants.get(name, 0.0) for name in FRICTION_TERMS)
        total_n = driving_n - friction.reshape(driving_n.shape)
        total_n -= self._remembered(
            "friction", form, lambda: friction_n(self._rig, constants, self._bends)
        )
        middle, higher, faster, slower = total_n / at.inertia_kg
        whole = np.empty((7, len(self._flight.grid_s)))
        inner = whole[:, self._flown]
        for row, values in enumerate(at[:4]):
            inner[row] = values if np.ndim(values) < 2 else np.asarray(values)[0]
        inner[4] = middle
        inner[5] = (higher - middle) / _DZ_M
        inner[6] = (faster - slower) / (2 * _DV_MPS)
        whole[:, : self._flown.start] = inner[:, :1]
        whole[:, self._flown.stop :] = inner[:, -1:]
        return whole[0], whole[1], whole[2], whole[3], whole[4:]

    def _pushed(self, effects: Chain, m: Motion, air_mps: FloatArray) -> "_Pushed":
        """What acts on the sufferer at a motion in moving air; `m` is changed."""
        air = np.asarray(blow(effects, m, self._setting, air_mps))
        wake_n = drag_force(self._rig.wake, 0.0, air)
        extra_n, added_kg = push(effects, m, self._setting, wake_n)
        driving_n = np.asarray(m.sufferer_n + wake_n + extra_n - self._weight_n)
        return _Pushed(m.sufferer_n, air, wake_n, self._setting.mass_kg + added_kg, driving_n)

    def _reading(
        self,
        constants: Constants,
        effects: Chain,
        thrusts: tuple[FloatArray, FloatArray, FloatArray],
    ) -> tuple[FloatArray, IntArray, FloatArray, FloatArray, Held]:
        """When the samples were taken, the readings expected, and how they are held."""
        acting = _key(effects.acting("range_m"))
        seen = tuple(constants[f"range.{c}"] for c in ("hold_s", "delay_s", "bias_m", "scale"))
        of_thrusts = tuple(id(values) for values in thrusts) if acting else ()
        found, _ = self._remembered(
            "reading",
            (seen, acting, of_thrusts),
            lambda: (self._read(constants, effects, thrusts), thrusts),
        )
        return found

    def _read(
        self,
        constants: Constants,
        effects: Chain,
        thrusts: tuple[FloatArray, FloatArray, FloatArray],
    ) -> tuple[FloatArray, IntArray, FloatArray, FloatArray, Held]:
        flight = self._flight
        hold_s = constants["range.hold_s"]
        pattern = self._remembered(
            "held", hold_s, lambda: held(flight.sample_s, flight.repeated, hold_s, self._chance)
        )
        # Ages are means over what is possible: a reading may seem older than the one before it.
        made_s = np.maximum.accumulate(flight.sample_s - pattern.age_s)
        taken_s = made_s - constants["range.delay_s"]
        z = np.interp(taken_s, flight.grid_s, flight.nominal[0])
        motion = self._motion(*thrusts)
        motion.time_s = taken_s - flight.take_off_s
        expected = []
        for dz in (0.0, _DZ_M):
            motion.z_m = z + dz
            value = seen_m(z + dz, constants["range.bias_m"], constants["range.scale"])
            expected.append(np.asarray(effects.range_m(value, motion, self._setting)))
        slope = (expected[1] - expected[0]) / _DZ_M
        placed_at = placed(flight.grid_s, taken_s)
        return taken_s, *placed_at, np.stack([expected[0], slope]), pattern

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


class _Pushed(NamedTuple):
    """At one motion (n,) or at several (4, n): thrust, air, wake, inertia, and all but friction."""

    thrust_n: Number
    air_mps: FloatArray
    wake_n: FloatArray
    inertia_kg: Number
    driving_n: FloatArray


def _stacked(values: Sequence[Number], like: FloatArray) -> FloatArray:
    """A quantity at several motions, numbers or arrays (n,), in the shape (4, n) of `like`."""
    whole = np.empty_like(like)
    for row, value in zip(whole, values, strict=True):
        row[:] = value
    return whole


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
