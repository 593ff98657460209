"""From a flight's log to the force that the wake put on the sufferer, measured after the fact.

In: run logs and the rig. Out: smoothed flights, and an episode set to train on. The thrust is what
the motor gave after its spool lag, from the pulses as they were applied; weight and rail friction
are taken off too.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from runtime.loop.estimator import Estimator
from runtime.smoother import (
    MAX_STEP_S,
    Flight,
    ForceModel,
    Smoothed,
    fit,
    known_motion,
    smooth,
)
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.physics.effects.chain import believed, unplaced_constants
from wakedeploy.physics.motor import spooled
from wakedeploy.physics.rail import GRAVITY_MPS2

FloatArray = npt.NDArray[np.float64]

FINE_S = 0.001  # the grid on which rotor and known motion are integrated
AIRBORNE_M = 0.04  # above the stop by more than range noise
TRIM_S = 0.25  # left out after lift-off and before touch-down: bounces, ropes, the stop's push
SHORTEST_S = 2.0
FITTED_FLIGHTS = 6  # the most flights that the model is fitted on, evenly chosen
_ROUNDS = 3
LOCAL_S = 0.4  # over how long friction and the force's liveliness are averaged
_FIRST_GUESS = (0.3, 0.4)  # time [s] and size [N] for the first look at speed and liveliness


@dataclass(frozen=True, eq=False)
class MeasuredForce:
    """One airborne stretch of a log: which ticks, and what was measured at them, (T,) each.

    `thrust_n` is the sufferer's after spool, `acceleration_mps2` its own, upward: what thrust,
    weight, friction and the force together give. `force_sd_n` contains the smoother's own
    uncertainty, that of the friction where the speed's sign is uncertain, and the turbulence that
    the rig file states: it is part of the force, but faster than range samples can show.
    """

    ticks: npt.NDArray[np.intp]
    smoothed: Smoothed
    thrust_n: FloatArray
    force_n: FloatArray
    force_sd_n: FloatArray
    acceleration_mps2: FloatArray


@dataclass(frozen=True, eq=False)
class _Stretch:
    """One airborne stretch on its way through the rounds."""

    ticks: npt.NDArray[np.intp]
    t_s: FloatArray
    sample_s: FloatArray
    height_m: FloatArray
    fine_s: FloatArray
    thrust_n: FloatArray  # on the fine grid


def measure(
    logs: Sequence[RunLog], rig: Rig, progress: Callable[[int, int], None] | None = None
) -> tuple[ForceModel, list[list[MeasuredForce]]]:
    """Smooth all logs under one fitted model; one list of airborne stretches for each log.

    `progress(done, total)` is called as the fit, then the smoothing, gets on. Raises UnusableInput
    when no log has an airborne stretch of `SHORTEST_S`.
    """
    stretches = [_stretches(log, rig) for log in logs]
    flat = [stretch for of_log in stretches for stretch in of_log]
    if not flat:
        raise UnusableInput(
            f"No log has {SHORTEST_S:g} s in the air with range samples; nothing can be smoothed."
        )
    rig = believed(rig)
    fitted_on = min(len(flat), FITTED_FLIGHTS)
    total = 2 * fitted_on + len(logs)  # the fit passes over its flights twice
    chosen = [flat[round(i)] for i in np.linspace(0, len(flat) - 1, fitted_on)]
    model = _fitted(chosen, rig, lambda done, _: progress(done, total) if progress else None)
    measured = []
    for done, of_log in enumerate(stretches, 1):
        measured.append([_measured(stretch, model, rig) for stretch in of_log])
        if progress is not None:
            progress(2 * fitted_on + done, total)
    return model, measured


def thrust_after_spool(log: RunLog, rig: Rig, fine_s: FloatArray) -> FloatArray:
    """The sufferer's thrust [N] at rising times (N,), from the pulses as applied.

    Where the log does not say when a pulse was applied, it is taken to act half a round trip and
    half a servo frame after it was commanded.
    """
    onset_s, pulse_us = _applied_pulses(log, rig)
    rig = believed(rig)
    held = np.maximum(np.searchsorted(onset_s, fine_s, side="right") - 1, 0)
    curve, lag = rig.thrust.sufferer, rig.spool.sufferer
    targets = np.sqrt(curve.thrusts(pulse_us))[held]
    speeds, speed = np.empty(len(fine_s)), float(targets[0])
    for i, dt in enumerate(np.diff(fine_s, prepend=fine_s[0])):
        speed = spooled(speed, float(targets[i - 1 if i else 0]), lag, float(dt))
        speeds[i] = speed
    return speeds**2


def range_offset(log: RunLog, rig: Rig) -> float:
    """What the range sensor reads at rest on the stop [m], the rig's bias if the log has no rest.

    The median, because a reading cannot be negative and half of them may sit at zero.
    """
    idle = log["sufferer_cmd_us"] <= rig.thrust.sufferer.pulse_us[0] + 1.0
    resting = (log["mode"] == "ARMED") & idle & np.isfinite(log["range_m"])
    readings = log["range_m"][resting & (log["t_s"] < log["t_s"][0] + 10.0)]
    if len(readings) < 16:
        return unplaced_constants(rig)["range.bias_m"]
    return float(np.median(readings))


def _applied_pulses(log: RunLog, rig: Rig) -> tuple[FloatArray, FloatArray]:
    """When each pulse width began to act, and the pulse widths [µs]; times rise."""
    if log.has("applied_time_s") and log.has("sufferer_applied_us"):
        onset_s, pulse_us = _reported_pulses(log, believed(rig))
        return onset_s + unplaced_constants(rig)["command.delay_s"], pulse_us
    return log["t_s"] + Estimator(rig).command_delay_s, log["sufferer_cmd_us"]


def _reported_pulses(log: RunLog, rig: Rig) -> tuple[FloatArray, FloatArray]:
    """From the MCU's reports: the pulse in effect, and the time of its latest servo frame.

    A report answers a command as it arrives, so every frame since the report before carried the
    same pulse: it began one frame after the one that was reported then.
    """
    known = np.isfinite(log["applied_time_s"]) & np.isfinite(log["sufferer_applied_us"])
    time_s, pulse_us = log["applied_time_s"][known], log["sufferer_applied_us"][known]
    newer = np.concatenate([[True], np.diff(time_s) > 1e-4])
    time_s, pulse_us = time_s[newer], pulse_us[newer]
    frame_s = rig.disturbance.esc_frame_s
    onset_s = time_s.copy()
    if frame_s > 0.0:
        # After a lost report the frame before the reported one is as far as this argument goes.
        onset_s[1:] = np.minimum(
            np.maximum(time_s[:-1] + frame_s, time_s[1:] - frame_s), time_s[1:]
        )
    return onset_s, pulse_us


def _stretches(log: RunLog, rig: Rig) -> list[_Stretch]:
    """The airborne stretches of a log with their samples and their thrust."""
    if len(log) < 2:
        return []
    sample_s, height_m = _samples(log, rig)
    fine_s = np.arange(log["t_s"][0] - 0.2, log["t_s"][-1] + FINE_S, FINE_S)
    thrust_n = thrust_after_spool(log, rig, fine_s)
    cut = [
        _stretch(log, span, sample_s, height_m, fine_s, thrust_n)
        for span in _airborne(log, rig, sample_s, height_m)
    ]
    return [stretch for stretch in cut if len(stretch.sample_s) >= 16]


def _samples(log: RunLog, rig: Rig) -> tuple[FloatArray, FloatArray]:
    """When each new range sample was taken [s], and the height it gives [m]; none twice."""
    known = unplaced_constants(rig)
    time_s = log["t_s"] - log["range_age_s"] - known["range.delay_s"]
    usable = np.isfinite(time_s) & np.isfinite(log["range_m"]) & ~(log["range_repeats"] > 0)
    height_m = (log["range_m"][usable] - range_offset(log, rig)) / known["range.scale"]
    time_s = time_s[usable]
    # A repeated sample whose age was read a little differently is still the same sample.
    newest = np.maximum.accumulate(np.concatenate([[-np.inf], time_s[:-1]]))
    new = time_s > newest + 0.25 * rig.range_sensor.period_s
    return time_s[new], height_m[new]


def _airborne(
    log: RunLog, rig: Rig, sample_s: FloatArray, height_m: FloatArray
) -> list[npt.NDArray[np.intp]]:
    """Runs of ticks in controlled flight, clear of both stops, without gaps, trimmed."""
    if len(sample_s) < 5:
        return []
    padded = np.pad(height_m, 2, mode="edge")
    calm = np.median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
    near = np.interp(log["t_s"], sample_s, calm)
    in_air = log.flying & (near > AIRBORNE_M) & (near < rig.sufferer.travel_m - 0.02)
    in_air &= _seen_often(log["t_s"], sample_s)
    at = np.flatnonzero(in_air)
    breaks = (np.diff(at) > 1) | (np.diff(log["t_s"][at]) > MAX_STEP_S)
    runs = np.split(at, np.flatnonzero(breaks) + 1)
    return [run for run in (_trimmed(log, run) for run in runs) if len(run)]


def _seen_often(t_s: FloatArray, sample_s: FloatArray) -> npt.NDArray[np.bool_]:
    """Ticks with a range sample within half a second before and after."""
    at = np.searchsorted(sample_s, t_s)
    before = np.concatenate([[-np.inf], sample_s])[at]
    after = np.concatenate([sample_s, [np.inf]])[at]
    return np.asarray((t_s - before < 0.5) & (after - t_s < 0.5))


def _trimmed(log: RunLog, run: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    if len(run) == 0:
        return run
    t_s = log["t_s"][run]
    inside = run[(t_s >= t_s[0] + TRIM_S) & (t_s <= t_s[-1] - TRIM_S)]
    long_enough = len(inside) and log["t_s"][inside[-1]] - log["t_s"][inside[0]] >= SHORTEST_S
    return np.asarray(inside if long_enough else inside[:0])


def _stretch(
    log: RunLog,
    run: npt.NDArray[np.intp],
    sample_s: FloatArray,
    height_m: FloatArray,
    fine_s: FloatArray,
    thrust_n: FloatArray,
) -> _Stretch:
    t_s = log["t_s"][run]
    seen = (sample_s >= t_s[0]) & (sample_s <= t_s[-1])
    fine = (fine_s >= t_s[0] - 2 * FINE_S) & (fine_s <= t_s[-1] + 2 * FINE_S)
    return _Stretch(run, t_s, sample_s[seen], height_m[seen], fine_s[fine], thrust_n[fine])


def _fitted(
    stretches: Sequence[_Stretch], rig: Rig, progress: Callable[[int, int], None]
) -> ForceModel:
    """The model that makes the samples of these stretches most likely."""
    quantum = rig.range_sensor.resolution_m**2 / 12.0
    range_sd = math.sqrt(max(rig.range_sensor.noise_m**2 + quantum, 1e-8))
    guess = ForceModel(*_FIRST_GUESS, range_sd)
    looks = [_look(stretch, guess, rig) for stretch in stretches]
    flights = [
        _flight(stretch, look.friction_n, look.activity, rig)
        for stretch, look in zip(stretches, looks, strict=True)
    ]
    return fit(flights, range_sd, rig.sufferer.mass_kg, progress)


def _flight(stretch: _Stretch, friction_n: FloatArray, activity: FloatArray, rig: Rig) -> Flight:
    """What the smoother needs: the known motion under thrust, weight and friction (N,)."""
    acceleration = (stretch.thrust_n + friction_n) / rig.sufferer.mass_kg - GRAVITY_MPS2
    speed, height = known_motion(stretch.fine_s, acceleration)
    return Flight(
        stretch.t_s, stretch.sample_s, stretch.height_m, stretch.fine_s, speed, height, activity
    )


@dataclass(frozen=True, eq=False)
class _Look:
    """Friction (N,) on the fine grid, its sd (T,), activity (T,), and what they rest on."""

    friction_n: FloatArray
    friction_sd_n: FloatArray
    activity: FloatArray
    result: Smoothed


def _look(stretch: _Stretch, model: ForceModel, rig: Rig) -> _Look:
    """Friction needs the speed, and the speed the friction: each round takes the one before.

    So does the activity: how lively the force is about each time.
    """
    friction_n, activity = np.zeros_like(stretch.fine_s), np.ones_like(stretch.t_s)
    for _ in range(_ROUNDS):
        flight = _flight(stretch, friction_n, activity, rig)
        result = smooth(flight, model, rig.sufferer.mass_kg)
        at_ticks, sd_n = _rail_friction(stretch.t_s, result, rig)
        friction_n = np.interp(stretch.fine_s, stretch.t_s, at_ticks)
        activity = _activity(stretch.t_s, result.force_n)
    return _Look(friction_n, sd_n, activity, result)


def _activity(t_s: FloatArray, force_n: FloatArray) -> FloatArray:
    """How lively the force is about each time, (T,), 1 on average: by its size and by its change.

    Where the wake is strong its turbulence is, and where it changes a steady process falls behind.
    """
    parts = [np.square(force_n), np.square(np.gradient(force_n, t_s))]
    local = [_local_mean(t_s, part) / max(float(np.mean(part)), 1e-12) for part in parts]
    return np.asarray(0.5 * (local[0] + local[1]))


def _local_mean(t_s: FloatArray, values: FloatArray) -> FloatArray:
    """Weighted mean over `LOCAL_S` before and after each time, (T,)."""
    reach = max(1, round(LOCAL_S / float(np.median(np.diff(t_s)))))
    kernel = np.hanning(2 * reach + 3)
    weight = np.convolve(np.ones_like(values), kernel, "same")
    return np.asarray(np.convolve(values, kernel, "same") / weight)


def _rail_friction(t_s: FloatArray, result: Smoothed, rig: Rig) -> tuple[FloatArray, FloatArray]:
    """Expected friction force and its sd (T,), for a speed that is normally distributed.

    The smoother spreads an error of the friction over time, so its variance is spread likewise.
    """
    sign = erf(result.speed_mps / (math.sqrt(2.0) * np.maximum(result.speed_sd_mps, 1e-9)))
    rail = rig.rail
    force = -rail.coulomb_n * sign - rail.viscous_n_per_mps * result.speed_mps
    variance = rail.coulomb_n**2 * (1.0 - sign**2)
    variance = variance + (rail.viscous_n_per_mps * result.speed_sd_mps) ** 2
    return force, np.sqrt(_local_mean(t_s, variance))


def _measured(stretch: _Stretch, model: ForceModel, rig: Rig) -> MeasuredForce:
    look = _look(stretch, model, rig)
    result = look.result
    thrust_n = np.interp(stretch.t_s, stretch.fine_s, stretch.thrust_n)
    friction_at = np.interp(stretch.t_s, stretch.fine_s, look.friction_n)
    turbulence_n = rig.disturbance.turbulence_fraction * result.force_n
    total_n = thrust_n + friction_at + result.force_n
    return MeasuredForce(
        stretch.ticks,
        result,
        thrust_n,
        result.force_n,
        np.sqrt(result.force_sd_n**2 + look.friction_sd_n**2 + turbulence_n**2),
        total_n / rig.sufferer.mass_kg - GRAVITY_MPS2,
    )
