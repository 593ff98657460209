"""What a flight is meant to do, tick by tick: altitude, carriage and the source's command.

In: a rig, a duration, a seed. Out: a `FlightPlan` that starts and ends at rest on the stop.
"""

import functools
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig

FloatArray = npt.NDArray[np.float64]
TAKE_OFF_S = 2.5
HEADROOM_M, HEADROOM_SHARE = 0.05, 0.1  # below the upper limit: gusts push, the loop overshoots
FOOTROOM_M = 0.01  # of the lower limit below the stop: estimates at rest scatter about it
_ROUNDING_M = 1e-6
PLAN_RATE_HZ = LOOP_RATE_HZ


@dataclass(frozen=True, slots=True)
class Reference:
    """One tick's aim, in SI units; the source's pulse width in µs."""

    z_m: float
    vz_mps: float
    az_mps2: float
    x_m: float
    vx_mps: float
    source_us: float


@dataclass(frozen=True, eq=False)
class FlightPlan:
    """References of every tick between take-off and touch-down, arrays of equal length (T,).

    With `motors_off` only the carriage moves, and the board is armed with no pulse above idle.
    """

    z_m: FloatArray
    x_m: FloatArray
    source_us: FloatArray
    motors_off: bool = False

    def __len__(self) -> int:
        return len(self.z_m)

    def at(self, tick: int, preview_s: float = 0.0) -> Reference:
        """The aim of one tick, 0-based; the last one is held.

        The acceleration is that of `preview_s` later: a command takes that long to act.
        """
        i = min(tick, len(self) - 1)
        acting = min(i + preview_s * PLAN_RATE_HZ, len(self) - 1.0)
        return Reference(
            z_m=float(self.z_m[i]),
            vz_mps=float(self._vz_mps[i]),
            az_mps2=_between(self._az_mps2, acting),
            x_m=float(self.x_m[i]),
            vx_mps=float(self._vx_mps[i]),
            source_us=float(self.source_us[i]),
        )

    def without_wake(self, idle_us: float) -> "FlightPlan":
        """The same heights and carriage with the source at `idle_us` all the time."""
        return replace(self, source_us=np.full_like(self.source_us, idle_us))

    @functools.cached_property
    def _vz_mps(self) -> FloatArray:
        return np.asarray(np.gradient(self.z_m, 1.0 / PLAN_RATE_HZ))

    @functools.cached_property
    def _vx_mps(self) -> FloatArray:
        return np.asarray(np.gradient(self.x_m, 1.0 / PLAN_RATE_HZ))

    @functools.cached_property
    def _az_mps2(self) -> FloatArray:
        padded = np.pad(self.z_m, 1, mode="edge")
        return np.asarray(np.diff(padded, 2) * PLAN_RATE_HZ**2)


def _between(values: FloatArray, at: float) -> float:
    """A value between two neighbours, in a time that does not grow with how many there are."""
    before = int(at)
    if before == len(values) - 1:
        return float(values[before])
    return float(values[before] + (values[before + 1] - values[before]) * (at - before))


def ceiling_m(rig: Rig) -> float:
    """How high a plan may go, so that a flight that follows it stays below `limits.z_m`."""
    top_m = rig.limits.z_m[1]
    return top_m - min(HEADROOM_M, HEADROOM_SHARE * abs(top_m))


def require_plan_fits(plan: FlightPlan, rig: Rig) -> None:
    """UnusableInput for a plan that would end in a failsafe at the rig's position limits."""
    if len(plan) == 0:
        return
    limits, top_m = rig.limits, float(np.max(plan.z_m))
    if top_m > ceiling_m(rig) + _ROUNDING_M:
        raise UnusableInput(
            f"The plan rises to {top_m:.3g} m, and below limits.z_m = {limits.z_m[1]:g} m a flight "
            f"needs room for control, so that {ceiling_m(rig):.3g} m are allowed: raise the limit "
            "or fly lower."
        )
    low_m = min(0.0, float(np.min(plan.z_m)))
    if low_m < -_ROUNDING_M or limits.z_m[0] > low_m - FOOTROOM_M:
        raise UnusableInput(
            f"The plan goes down to {low_m:.3g} m; it must end on the stop, at 0, and limits.z_m "
            f"begin {FOOTROOM_M:g} m below that or lower, not at {limits.z_m[0]:g} m."
        )
    left_m, right_m = float(np.min(plan.x_m)), float(np.max(plan.x_m))
    if left_m < limits.x_m[0] - _ROUNDING_M or right_m > limits.x_m[1] + _ROUNDING_M:
        raise UnusableInput(
            f"The plan drives the carriage from {left_m:.3g} to {right_m:.3g} m, and limits.x_m "
            f"allows {limits.x_m[0]:g} to {limits.x_m[1]:g} m: widen it or drive less far."
        )


def random_plan(rig: Rig, seconds: float, seed: int) -> FlightPlan:
    """A flight whose altitude, carriage and source all vary at random within the rig's limits.

    Altitude: smooth moves between heights, held 1.5–4 s. Carriage: smooth moves through the jet at
    up to 80 % of its top speed. Source: steps, ramps and a sine, between 15 % and 90 % of its
    range, at times faster than the motor can follow (the paper, § Real tethered monocopters).
    """
    altitude, carriage, source = np.random.SeedSequence([seed, 1]).spawn(3)
    ticks = max(round(seconds * PLAN_RATE_HZ), 2)
    t = np.arange(ticks) / PLAN_RATE_HZ
    air_s = max(seconds - 2.0 * TAKE_OFF_S, 0.0)
    z = _altitude(rig, t, seconds, air_s, np.random.default_rng(altitude))
    x = _carriage(rig, t, seconds, np.random.default_rng(carriage))
    return FlightPlan(z, x, _source(rig, t, seconds, np.random.default_rng(source)))


def hold_plan(rig: Rig, seconds: float, z_m: float, source_us: float) -> FlightPlan:
    """A flight that holds one height under the jet's axis with a constant source."""
    t = np.arange(max(round(seconds * PLAN_RATE_HZ), 2)) / PLAN_RATE_HZ
    envelope = smooth_rise(t / TAKE_OFF_S) * smooth_rise((seconds - t) / TAKE_OFF_S)
    idle_us = rig.limits.pulse_us[0]
    return FlightPlan(z_m * envelope, np.zeros_like(t), idle_us + (source_us - idle_us) * envelope)


def _altitude(
    rig: Rig, t: FloatArray, seconds: float, air_s: float, rng: "np.random.Generator"
) -> FloatArray:
    high = min(0.7 * rig.sufferer.travel_m, ceiling_m(rig))
    low = min(0.3 * rig.sufferer.travel_m, 0.5 * high)
    z = np.full_like(t, rng.uniform(low, high))
    start = TAKE_OFF_S + rng.uniform(1.0, 3.0)
    while start < TAKE_OFF_S + air_s - 2.0:
        target = rng.uniform(low, high)
        move_s = rng.uniform(1.2, 2.5)
        z += (target - z[-1]) * smooth_rise((t - start) / move_s)
        start += move_s + rng.uniform(1.5, 4.0)
    return np.asarray(z * smooth_rise(t / TAKE_OFF_S) * smooth_rise((seconds - t) / TAKE_OFF_S))


def _carriage(rig: Rig, t: FloatArray, seconds: float, rng: "np.random.Generator") -> FloatArray:
    reach_m = 0.5 * min(-rig.limits.x_m[0], rig.limits.x_m[1])
    top_mps = 0.8 * rig.stepper.max_speed_mps
    x = np.zeros_like(t)
    start = rng.uniform(0.5, 2.0)
    while True:
        target = rng.uniform(-reach_m, reach_m)
        # A smooth move's top speed is 15/8 of its mean speed.
        move_s = max(0.4, 15.0 / 8.0 * abs(target - x[-1]) / rng.uniform(0.3, 1.0) / top_mps)
        if start + move_s > seconds - 3.0:
            break
        x += (target - x[-1]) * smooth_rise((t - start) / move_s)
        start += move_s + rng.uniform(0.0, 1.0)
    home_s = max(1.0, 15.0 / 8.0 * abs(x[-1]) / top_mps)
    return np.asarray(x - x[-1] * smooth_rise((t - (seconds - home_s)) / home_s))


def _source(rig: Rig, t: FloatArray, seconds: float, rng: "np.random.Generator") -> FloatArray:
    level = _steps_and_ramps(t, rng)
    swing = rng.uniform(0.05, 0.15) * np.sin(
        2.0 * np.pi * rng.uniform(0.2, 1.2) * t + rng.uniform(0.0, 2.0 * np.pi)
    )
    share = np.clip(level + swing, 0.15, 0.9)
    low, high = rig.thrust.source.pulse_us[0], rig.thrust.source.pulse_us[-1]
    running = smooth_rise(t / 1.0) * smooth_rise((seconds - t) / 1.0)
    return np.asarray(low + (high - low) * share * running)


def _steps_and_ramps(t: FloatArray, rng: "np.random.Generator") -> FloatArray:
    """A level that moves every 0.3–1.2 s, half of the times at once, else within 0.1–0.6 s."""
    level = np.full_like(t, rng.uniform(0.2, 0.85))
    start = rng.uniform(0.5, 1.0)
    while start < t[-1]:
        ramp_s = 1.0 / PLAN_RATE_HZ if rng.random() < 0.5 else rng.uniform(0.1, 0.6)
        level += (rng.uniform(0.2, 0.85) - level[-1]) * np.clip((t - start) / ramp_s, 0.0, 1.0)
        start += ramp_s + rng.uniform(0.3, 1.2)
    return level


def smooth_rise(share: FloatArray) -> FloatArray:
    """The minimum-jerk rise from 0 to 1: 10 s³ − 15 s⁴ + 6 s⁵."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
