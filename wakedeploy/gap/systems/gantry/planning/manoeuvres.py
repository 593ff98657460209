"""The menu of manoeuvres that `gap plan` chooses from, each within the limits of the rig it is for.

In: a rig. Out: flight plans that begin and end at rest on the stop, at home, with the source idle.
Each has the rig's rest before and after it as a part: motors off, the sufferer on the stop, the
carriage at home.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from runtime.reference import PLAN_RATE_HZ, TAKE_OFF_S, FlightPlan, FloatArray
from wakedeploy.core.rig import Rig

NEAR, MIDDLE, FAR = 0.8, 0.5, 0.2  # heights as shares of the rail; near is near the source
_SOURCE = 0.55  # of the source's range, if a manoeuvre leaves the source alone
_SOURCE_RAMP_S = 1.0
_TRIANGLE_TURN_S = 0.4

Build = Callable[[Rig], FlightPlan]


@dataclass(frozen=True)
class Manoeuvre:
    """One entry of the menu; `plan(rig)` is its flight."""

    name: str
    description: str
    plan: Build

    def seconds(self, rig: Rig) -> float:
        """How long it takes, with the rests before and after [s]."""
        return len(self.plan(rig)) / PLAN_RATE_HZ + 2.0 * rig.disturbance.rest_s


def menu() -> tuple[Manoeuvre, ...]:
    """Every manoeuvre, in the order in which tables list them."""
    return (
        Manoeuvre("hover-heights", "hover at five heights in a steady wake", _hover_heights),
        Manoeuvre("still-air", "hover at five heights with the source idle", _still_air),
        Manoeuvre("off-hover-off", "three short hovers, source off, on, off", _off_hover_off),
        Manoeuvre("carriage-slow", "pass the jet slowly, to and fro", _passes(0.3)),
        Manoeuvre("carriage-fast", "pass the jet fast, to and fro", _passes(0.9)),
        Manoeuvre("source-steps-near", "thrust steps close to the source", _source_steps(NEAR)),
        Manoeuvre("source-steps-far", "thrust steps far from the source", _source_steps(FAR)),
        Manoeuvre("source-steps-both", "thrust steps at two separations", _source_steps_both),
        Manoeuvre("source-sines-near", "thrust sines close to the source", _source_sines(NEAR)),
        Manoeuvre("source-sines-far", "thrust sines far from the source", _source_sines(FAR)),
        Manoeuvre("triangles-slow", "rise and sink slowly in still air", _triangles((0.08,))),
        Manoeuvre("triangles-fast", "rise and sink fast in still air", _triangles((0.4,))),
        Manoeuvre("triangles-both", "rise and sink at two speeds", _triangles((0.08, 0.4))),
        Manoeuvre("height-steps", "quick height steps in still air", _height_steps(0.0)),
        Manoeuvre("height-steps-wake", "quick height steps in the wake", _height_steps(_SOURCE)),
        Manoeuvre("height-chirp", "height sine, 0.3 to 1.6 Hz, still air", _height_chirp(0.0)),
        Manoeuvre("height-chirp-wake", "height sine, 0.3 to 1.6 Hz, in the wake",
                  _height_chirp(_SOURCE)),
        Manoeuvre("long-hover", "a minute's hover in a steady wake", _long_hover),
    )  # fmt: skip


def _hover_heights(rig: Rig) -> FlightPlan:
    return _heights(rig, _SOURCE)


def _still_air(rig: Rig) -> FlightPlan:
    return _heights(rig, 0.0)


def _heights(rig: Rig, source: float) -> FlightPlan:
    t = _time(22.0)
    stops = [(2.5 + 3.4 * i, 1.2, share) for i, share in enumerate((0.5, 0.2, 0.65, 0.35), 1)]
    return _assembled(rig, t, _moves(t, NEAR, stops), source=np.full_like(t, source))


def _off_hover_off(rig: Rig) -> FlightPlan:
    """Take off and land three times; on the ground the thrust stays below the weight."""
    t = _time(27.0)
    z, source = np.zeros_like(t), np.zeros_like(t)
    for i, level in enumerate((0.0, 0.8, 0.0)):
        z += MIDDLE * (_rise(t, 9.0 * i, 2.0) - _rise(t, 9.0 * i + 6.0, 2.0))
        source += level * (_rise(t, 9.0 * i + 2.0, 0.5) - _rise(t, 9.0 * i + 5.5, 0.5))
    return _assembled(rig, t, z, source=source, is_enveloped=False)


def _passes(share: float) -> Build:
    """Passes through the jet at this share of the carriage's top speed, at two heights."""

    def plan(rig: Rig) -> FlightPlan:
        reach_m = 0.75 * min(-rig.limits.x_m[0], rig.limits.x_m[1], 0.5)
        speed_mps = share * rig.stepper.max_speed_mps
        pass_s = _carriage_s(rig, 2.0 * reach_m, speed_mps)
        out_s = _carriage_s(rig, reach_m, 0.8 * rig.stepper.max_speed_mps)
        count = max(2, 2 * round(7.0 / pass_s))
        ends = [(TAKE_OFF_S + out_s + (pass_s + 0.3) * i, pass_s, reach_m * (-1) ** (i + 1))
                for i in range(count)]  # fmt: skip
        back_s = ends[-1][0] + pass_s + 0.3
        t = _time(back_s + out_s + TAKE_OFF_S)
        x = _moves(t, 0.0, [(TAKE_OFF_S, out_s, reach_m), *ends, (back_s, out_s, 0.0)])
        halfway_s = ends[count // 2][0] - 0.3
        z = _moves(t, 0.65, [(halfway_s, 1.2, 0.35)])
        return _assembled(rig, t, z, x, np.full_like(t, 0.7))

    return plan


def _source_steps(height: float) -> Build:
    def plan(rig: Rig) -> FlightPlan:
        t = _time(20.0)
        return _assembled(rig, t, np.full_like(t, height), source=_step_train(t))

    return plan


def _source_steps_both(rig: Rig) -> FlightPlan:
    t = _time(26.0)
    z = _moves(t, NEAR, [(12.0, 2.0, FAR)])
    return _assembled(rig, t, z, source=_step_train(t))


def _step_train(t: FloatArray) -> FloatArray:
    """Steps between weak and strong, each after 0.4 to 1.1 s, up and down alike."""
    holds_s = (1.1, 0.6, 0.4, 0.9, 0.5, 0.7)
    level, at_s, i = np.full_like(t, 0.25), TAKE_OFF_S, 0
    while at_s < t[-1] - TAKE_OFF_S:
        level[t >= at_s] = 0.8 if i % 2 == 0 else 0.25
        at_s, i = at_s + holds_s[i % len(holds_s)], i + 1
    return level


def _source_sines(height: float) -> Build:
    def plan(rig: Rig) -> FlightPlan:
        t = _time(20.0)
        frequency_hz = np.select([t < 7.5, t < 12.5], [0.3, 0.8], 2.0)
        phase = 2.0 * np.pi * np.cumsum(frequency_hz) / PLAN_RATE_HZ
        swing = 0.25 * np.sin(phase) * _rise(t, TAKE_OFF_S, 0.5) * (t < t[-1] - TAKE_OFF_S)
        return _assembled(rig, t, np.full_like(t, height), source=0.55 + swing)

    return plan


def _triangles(speeds_mps: Sequence[float]) -> Build:
    """Legs up and down at steady speeds, the source idle: friction by direction and by speed."""

    def plan(rig: Rig) -> FlightPlan:
        legs = [(speed, min(4.0, 0.5 * rig.sufferer.travel_m / speed)) for speed in speeds_mps]
        repeats = max(1, round(16.0 / (2.0 * sum(s for _, s in legs))))
        profile, at_s = [], TAKE_OFF_S + 0.5
        for speed, leg_s in legs * repeats:
            for signed in (speed, -speed):
                profile.append((at_s, _TRIANGLE_TURN_S, signed))
                at_s += leg_s
        profile.append((at_s, _TRIANGLE_TURN_S, 0.0))
        t = _time(at_s + 1.0 + TAKE_OFF_S)
        way_m = np.cumsum(_moves(t, 0.0, profile)) / PLAN_RATE_HZ
        return _assembled(rig, t, 0.22 + way_m / rig.sufferer.travel_m)

    return plan


def _height_steps(source: float) -> Build:
    def plan(rig: Rig) -> FlightPlan:
        t = _time(20.0)
        targets = (0.7, 0.4, 0.6, 0.3, 0.65, 0.45, 0.7, 0.35)
        steps = [(TAKE_OFF_S + 1.7 * i, 0.6, target) for i, target in enumerate(targets, 0)]
        return _assembled(rig, t, _moves(t, 0.4, steps), source=np.full_like(t, source))

    return plan


def _height_chirp(source: float) -> Build:
    """A sine whose frequency rises while its acceleration stays below 3 m/s²."""

    def plan(rig: Rig) -> FlightPlan:
        t = _time(20.0)
        share = np.clip((t - TAKE_OFF_S) / (t[-1] - 2.0 * TAKE_OFF_S), 0.0, 1.0)
        frequency_hz = 0.3 * (1.6 / 0.3) ** share
        phase = 2.0 * np.pi * np.cumsum(frequency_hz * (share > 0.0)) / PLAN_RATE_HZ
        swing_m = np.minimum(0.12 * rig.sufferer.travel_m, 3.0 / (2.0 * np.pi * frequency_hz) ** 2)
        fading = _rise(t, TAKE_OFF_S, 1.0) - _rise(t, t[-1] - TAKE_OFF_S - 1.0, 1.0)
        z = MIDDLE + swing_m / rig.sufferer.travel_m * np.sin(phase) * fading
        return _assembled(rig, t, z, source=np.full_like(t, source))

    return plan


def _long_hover(rig: Rig) -> FlightPlan:
    t = _time(65.0)
    return _assembled(rig, t, np.full_like(t, MIDDLE), source=np.full_like(t, _SOURCE))


def _assembled(
    rig: Rig,
    t: FloatArray,
    z: FloatArray,
    x_m: FloatArray | None = None,
    source: FloatArray | None = None,
    *,
    is_enveloped: bool = True,
) -> FlightPlan:
    """A plan from shares of the rail (T,), carriage positions [m] and shares of the source.

    Take-off and landing are added, and the source is held to its slew.
    """
    top_m = min(rig.sufferer.travel_m, rig.limits.z_m[1])
    low_us, high_us = (
        rig.limits.pulse_us[0],
        min(rig.limits.pulse_us[1], rig.thrust.source.pulse_us[-1]),
    )
    z_m = np.clip(z, 0.0, 0.9) * top_m
    if is_enveloped:
        z_m = z_m * _rise(t, 0.0, TAKE_OFF_S) * (1.0 - _rise(t, t[-1] - TAKE_OFF_S, TAKE_OFF_S))
    running = _rise(t, 0.0, _SOURCE_RAMP_S) - _rise(t, t[-1] - _SOURCE_RAMP_S, _SOURCE_RAMP_S)
    shares = np.zeros_like(t) if source is None else source
    wanted_us = low_us + (high_us - low_us) * np.clip(shares, 0.0, 0.9) * running
    most_us = 0.95 * rig.limits.slew_us_per_s / PLAN_RATE_HZ
    return FlightPlan(z_m, np.zeros_like(t) if x_m is None else x_m, _slewed(wanted_us, most_us))


def _slewed(wanted_us: FloatArray, most_us: float) -> FloatArray:
    """A command within a limit per tick, idle again at the end."""
    forth = wanted_us.copy()
    for i in range(1, len(forth)):
        forth[i] = np.clip(wanted_us[i], forth[i - 1] - most_us, forth[i - 1] + most_us)
    room = forth[0] + most_us * np.arange(len(forth))[::-1]  # what can still come down in time
    return np.asarray(np.minimum(forth, room))


def _moves(t: FloatArray, value: float, moves: Sequence[tuple[float, float, float]]) -> FloatArray:
    """A value (T,) that goes smoothly to each (start_s, length_s, target) in turn."""
    result = np.full_like(t, value)
    for start_s, length_s, target in moves:
        result += (target - value) * _rise(t, start_s, length_s)
        value = target
    return result


def _carriage_s(rig: Rig, distance_m: float, speed_mps: float) -> float:
    """How long a minimum-jerk move takes within a top speed and the carriage's acceleration [s]."""
    by_speed = 15.0 / 8.0 * distance_m / speed_mps
    by_acceleration = (10.0 / 3.0**0.5 * distance_m / (0.9 * rig.stepper.max_accel_mps2)) ** 0.5
    return float(max(by_speed, by_acceleration))


def _rise(t: FloatArray, start_s: float, length_s: float) -> FloatArray:
    """The minimum-jerk rise from 0 to 1: 10 s³ − 15 s⁴ + 6 s⁵."""
    s = np.clip((t - start_s) / length_s, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def _time(seconds: float) -> FloatArray:
    """Times of the ticks up to and including the end, (T,)."""
    return np.asarray(np.arange(round(seconds * PLAN_RATE_HZ) + 1) / PLAN_RATE_HZ)
