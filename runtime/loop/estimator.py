"""Height and lateral position from range samples and step counts: a Kalman filter.

Pure steps, `(state, input) → state`. Height: z, its speed, and the disturbance force that the known
thrust does not explain. The range sample's age is known and part of the measurement equation; a
missed or repeated sample is predicted through.
"""

import math

import numpy as np

from runtime.loop.copies import replace
from runtime.loop.estimate import Estimate, FloatArray, Measurement
from runtime.loop.innovations import (
    SUDDEN_SD,
    added_up,
    judged,
    set_apart,
    sudden_m,
    surprised,
    tells_of_a_push,
    with_another,
)
from runtime.loop.kalman import predict as kalman_predict
from runtime.loop.kalman import update as kalman_update
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.physics.effects.chain import believed, unplaced_constants
from wakedeploy.physics.motor import held_pulse
from wakedeploy.physics.rail import GRAVITY_MPS2, smooth_friction

_FORCE_TIME_S = 1.0  # the disturbance is expected to change within a second …
_FORCE_SD_N = 1.0  # … by about the size of a wake's force
_UNFORESEEN_SD_N = 0.25  # … or, with the wake forecast, by what forecasts leave over
_ACCELERATION_SD_MPS2 = 0.3  # what the thrust model leaves open, per tick
_STEP_ACCELERATION_SD_MPS2 = 2.0
_GATE_SD = 5.0
# Samples in a row with the same value in the air. One in a thousand repeats this often by chance;
# a sensor that holds its readings does so, too. A further sample of that value is no news.
SAME_TICKS = 3
_PERSISTENT = 4  # this many rejected samples in a row are no outliers …
_SCATTER_M = 0.1  # … unless they go to and fro by this much, as no motion does
_PAUSE_S = 0.1  # without a step: what the commands did meanwhile is not known …
_PAUSE_SD_MPS = 1.0  # … nor is the speed, by about this much
# While the board waits for commands it holds the last pulse: only a wake changes forces.
_HELD_S, _HELD_SD_MPS2 = 0.14, 3.0
_GATED_NOISE = 25.0  # times the sensor's variance: more in the gate would let strays in
_STRAY_TICKS = 12.0  # a share of strays is averaged over this
_SWING = 2.0  # a stray is off by at least half as much from the sample before as from the filter
_CARRIED_SHARE = 0.3  # of the weight: with less, a reading off the stop is the sensor's own error
_STARTLED = 9.0  # an innovation's square over its variance; above it a forecast is not believed
_PUSH_SD_N, _PUSH_AGO_S, _PUSH_ABOVE_M = 3.0, 0.1, 0.03  # a push of which nothing else is known
_UNSURE_MPS = 0.5  # sd of the speed above which a filter also goes on without the first reading


class Estimator:
    """The filter's constants for one rig, and its two pure steps.

    It believes what the rig file's effects say of its constants, of delays and of the range sensor.
    """

    def __init__(self, rig: Rig) -> None:
        constants = unplaced_constants(rig)
        self._rig = rig = believed(rig)
        sensor = rig.range_sensor
        quantum = sensor.resolution_m**2 / 12.0
        self._range_var = max(sensor.noise_m**2 + quantum, 1e-8)
        self._step_var = max((1.0 / rig.stepper.steps_per_m) ** 2 / 12.0, 1e-12)
        # Half the round trip is the command's way; a pulse then waits for half a frame on average.
        self.command_delay_s = 0.5 * (rig.latency.round_trip_s + rig.disturbance.esc_frame_s)
        self.command_delay_s += constants["command.delay_s"]
        self._range_bias_m, self._range_scale = constants["range.bias_m"], constants["range.scale"]
        self._range_delay_s = constants["range.delay_s"]

    def step(
        self,
        before: Estimate,
        measured: Measurement,
        pulses_us: tuple[float, float],
        wake_n: float | None = None,
    ) -> Estimate:
        """Predict to `measured.t_s`, then take in what is new.

        `pulses_us`: the sufferer's commands of the tick before last and of the last tick; the later
        one acts from the command delay on. `wake_n`: the wake's force [N] as it was forecast for
        this time, if it was; the disturbance is what the forecast leaves over.
        """
        after = self._stepped(before, measured, pulses_us, wake_n)
        if before.unpushed is None or after.unpushed is not before.unpushed:
            return after
        unaware = replace(measured, acts_known=False)  # then no push is reported
        without = self._stepped(before.unpushed, unaware, pulses_us, wake_n)
        return judged(after, replace(without, unpushed=None))

    def _stepped(
        self,
        before: Estimate,
        measured: Measurement,
        pulses_us: tuple[float, float],
        wake_n: float | None,
    ) -> Estimate:
        predicted = self._predict(before, measured.t_s, pulses_us, wake_n)
        if measured.steps_repeats == 0:
            predicted = self._update_lateral(predicted, measured.steps)
        return self._update_height(predicted, measured)

    def ahead(
        self, now: Estimate, t_s: float, pulses_us: tuple[float, float], wake_n: float | None
    ) -> Estimate:
        """The state at `t_s` by the forces alone."""
        return self._predict(now, t_s, pulses_us, wake_n)

    def _predict(
        self, now: Estimate, t_s: float, pulses_us: tuple[float, float], wake_n: float | None
    ) -> Estimate:
        dt = min(max(t_s - now.t_s, 1e-4), 0.5)
        now = _after_a_pause(now, t_s - now.t_s)
        speed, thrust_n = self._mean_thrust(now.rotor_speed, pulses_us, dt)
        height, height_cov = self._predict_height(now, thrust_n, wake_n, dt)
        xx, xv, vv = _white(_STEP_ACCELERATION_SD_MPS2, dt)
        lateral, lateral_cov = kalman_predict(
            now.lateral,
            now.lateral_cov,
            np.array([[1.0, dt], [0.0, 1.0]]),
            np.array([[xx, xv], [xv, vv]]),
        )
        return replace(
            now,
            t_s=t_s,
            height=height,
            height_cov=height_cov,
            lateral=lateral,
            lateral_cov=lateral_cov,
            rotor_speed=speed,
            rejected_s=now.rejected_s + dt if now.rejected else 0.0,
        )

    def _mean_thrust(
        self, speed: float, pulses_us: tuple[float, float], dt: float
    ) -> tuple[float, float]:
        """The rotor's speed after `dt` and the mean thrust [N] until then."""
        curve, lag = self._rig.thrust.sufferer, self._rig.spool.sufferer
        early_s = min(self.command_delay_s, dt)
        total = 0.0
        for pulse_us, span_s in zip(pulses_us, (early_s, dt - early_s), strict=True):
            speed, mean_n = held_pulse(curve, lag, speed, pulse_us, span_s)
            total += span_s * mean_n
        return speed, total / dt

    def _predict_height(
        self, now: Estimate, thrust_n: float, wake_n: float | None, dt: float
    ) -> tuple[FloatArray, FloatArray]:
        mass_kg = self._rig.sufferer.mass_kg
        if self._resting(now, thrust_n):
            return np.array([now.z_m, 0.0, 0.0]), now.height_cov
        keep = math.exp(-dt / _FORCE_TIME_S)
        transition = np.array(
            [[1.0, dt, 0.5 * dt * dt / mass_kg], [0.0, 1.0, dt / mass_kg], [0.0, 0.0, keep]]
        )
        zz, zv, vv = _white(_ACCELERATION_SD_MPS2, dt)
        is_startled = now.innovation_m**2 > _STARTLED * now.innovation_var_m2
        left_sd_n = _FORCE_SD_N if wake_n is None or is_startled else _UNFORESEEN_SD_N
        left_n2 = left_sd_n**2 * (1.0 - keep**2)
        noise = np.array([[zz, zv, 0.0], [zv, vv, 0.0], [0.0, 0.0, left_n2]])
        known_n = thrust_n + (wake_n or 0.0) - smooth_friction(self._rig.rail, now.vz_mps)
        a = known_n / mass_kg - GRAVITY_MPS2
        height, cov = kalman_predict(
            now.height,
            now.height_cov,
            transition,
            noise,
            np.array([a]),
            np.array([[0.5 * dt * dt], [dt], [0.0]]),
        )
        return height, cov

    def _resting(self, now: Estimate, thrust_n: float) -> bool:
        """Whether the sufferer is on the stop with too little thrust to leave it.

        It is not if it is seen to leave although the motor carries only a part: something else
        lifts it.
        """
        weight_n = self._rig.sufferer.mass_kg * GRAVITY_MPS2
        is_near = now.z_m < 0.02 and now.vz_mps < 0.05 and thrust_n < 0.98 * weight_n
        lifts = now.innovation_m > 0.0 and now.innovation_m**2 > _STARTLED * now.innovation_var_m2
        return is_near and not (lifts and thrust_n > _CARRIED_SHARE * weight_n)

    def _after_a_push(self, now: Estimate) -> Estimate:
        """The state if an unknown push has just begun."""
        ago_s, mass_kg = _PUSH_AGO_S, self._rig.sufferer.mass_kg
        moved = _PUSH_SD_N * np.array([0.5 * ago_s**2 / mass_kg, ago_s / mass_kg, 1.0])
        height_cov = now.height_cov + np.outer(moved, moved)
        return replace(now, height_cov=height_cov, pushed=(0.0, 0.0))

    def _update_lateral(self, now: Estimate, steps: int) -> Estimate:
        position = np.array([(steps + 0.5) / self._rig.stepper.steps_per_m])
        lateral, cov = kalman_update(
            now.lateral, now.lateral_cov, position, np.array([[self._step_var]]), _POSITION_ROW
        )
        return replace(now, lateral=lateral, lateral_cov=cov)

    def _update_height(self, now: Estimate, measured: Measurement) -> Estimate:
        unseen = replace(now, innovation_m=math.nan, innovation_var_m2=math.nan, jumped_m=0.0)
        if not math.isfinite(measured.range_m) or measured.range_repeats > 0:
            return unseen
        if measured.same > SAME_TICKS:
            return replace(unseen, stale_s=unseen.stale_s + 1.0 / LOOP_RATE_HZ)
        # How far it moved while the sensor said the same is not known.
        now = replace(_after_a_pause(unseen, unseen.stale_s), stale_s=0.0)
        age_s = measured.range_age_s + self._range_delay_s
        range_m = (measured.range_m - self._range_bias_m) / self._range_scale
        row = np.array([[1.0, -age_s, 0.5 * age_s * age_s / self._rig.sufferer.mass_kg]])
        seen, noise_var = self._noted(now, measured, measured.t_s - age_s, range_m, row)
        state_var = _along(row, seen.height_cov)
        is_told = seen.height_cov is not now.height_cov  # of a push, which is no swing
        before_m = seen.innovation_m if is_told else now.last_innovation_m
        seen = self._strays_counted(seen, state_var, before_m)
        gate_var = state_var + min(noise_var, _GATED_NOISE * self._range_var)
        is_far = seen.innovation_m**2 > _GATE_SD**2 * gate_var
        if self._is_stray(seen, range_m, is_far=is_far, is_alike=measured.alike > 0):
            return _rejected(seen, range_m)
        height, cov = kalman_update(
            seen.height, seen.height_cov, np.array([range_m]), np.array([[noise_var]]), row
        )
        return replace(
            seen,
            height=height,
            height_cov=cov,
            rejected=0,
            off_m=math.inf,
            jumped_m=_least_off_m(seen) if seen.rejected >= _PERSISTENT else 0.0,
            rejected_s=0.0,
        )

    def _noted(
        self, now: Estimate, measured: Measurement, taken_s: float, range_m: float, row: FloatArray
    ) -> tuple[Estimate, float]:
        """The state with what the innovation says of noise and pushes; the reading's variance."""
        innovation_m = range_m - float((row @ now.height)[0])
        noise_var = self._range_var * now.noise_scale
        variance = _along(row, now.height_cov) + noise_var
        before = now
        if now.height_cov[1, 1] > _UNSURE_MPS**2 and now.unpushed is None:
            # After a pause a single reading would set the speed, and it may be a stray.
            before = set_apart(now, now)
        lately = with_another(now.lately, (taken_s, range_m, innovation_m))
        sudden_var = sudden_m(lately) ** 2
        is_sudden = sudden_var > SUDDEN_SD**2 * self._range_var
        seen = replace(
            before,
            innovation_m=innovation_m,
            innovation_var_m2=variance,
            lately=lately,
            sudden_ticks=now.sudden_ticks + 1 if is_sudden else 0,
        )
        seen = surprised(added_up(seen, acts_known=measured.acts_known))
        if is_sudden:
            return replace(seen, pushed=(0.0, 0.0)), max(sudden_var, noise_var)
        # The stop pushes whatever sinks onto it; and the same reading again is no news.
        is_clear = (now.z_m > _PUSH_ABOVE_M or now.vz_mps > 0.0) and measured.alike == 0
        if tells_of_a_push(seen) and is_clear:
            seen = self._after_a_push(set_apart(seen, before))
        return seen, noise_var

    def _strays_counted(self, seen: Estimate, state_var: float, before_m: float) -> Estimate:
        """The share of strays with this reading; `before_m` is the innovation before it."""
        out_var = _GATE_SD**2 * (state_var + self._range_var)
        # To and fro: a model that is wrong about the motion is off, too, but by nearly the same.
        swing_m = seen.innovation_m - before_m if math.isfinite(before_m) else 0.0
        is_out = min(seen.innovation_m**2, (_SWING * swing_m) ** 2) > out_var
        share = seen.stray_share + (float(is_out) - seen.stray_share) / _STRAY_TICKS
        return replace(seen, stray_share=share)

    def _is_stray(self, seen: Estimate, range_m: float, *, is_far: bool, is_alike: bool) -> bool:
        if seen.rejected > 0 and is_alike:  # the same again is no news
            return True
        first_m, _, path_m = _rejects(seen, range_m)
        is_scattered = path_m - abs(range_m - first_m) > _SCATTER_M
        return is_far and (seen.rejected < _PERSISTENT or is_scattered)


def _along(row: FloatArray, cov: FloatArray) -> float:
    return float((row @ cov @ row.T)[0, 0])


def _least_off_m(seen: Estimate) -> float:
    return min(seen.off_m, abs(seen.innovation_m))


def _rejects(seen: Estimate, range_m: float) -> tuple[float, float, float]:
    """First, last and path [m] of the rejected readings, this one included."""
    first_m, last_m, path_m = seen.rejects if seen.rejected else (range_m, range_m, 0.0)
    return first_m, range_m, path_m + abs(range_m - last_m)


def _rejected(seen: Estimate, range_m: float) -> Estimate:
    """The state without this reading; after too many scattered ones the count begins anew."""
    off_m = _least_off_m(seen)
    if seen.rejected >= _PERSISTENT:
        return replace(seen, rejected=1, off_m=off_m, rejects=(range_m, range_m, 0.0))
    rejects = _rejects(seen, range_m)
    return replace(seen, rejected=seen.rejected + 1, off_m=off_m, rejects=rejects)


def _after_a_pause(now: Estimate, passed_s: float) -> Estimate:
    """The state after a time in which the loop stood still, with what it cannot know of that."""
    if passed_s <= _PAUSE_S:
        return now
    if passed_s <= _HELD_S:
        moved = _HELD_SD_MPS2 * np.array([0.5 * passed_s**2, passed_s, 0.0])
        return replace(now, height_cov=now.height_cov + np.outer(moved, moved))
    unknown = np.diag([(_PAUSE_SD_MPS * passed_s) ** 2, _PAUSE_SD_MPS**2, 0.0])
    return replace(now, height_cov=now.height_cov + unknown)


_POSITION_ROW = np.array([[1.0, 0.0]])


def _white(acceleration_sd: float, dt: float) -> tuple[float, float, float]:
    """What an acceleration held over `dt` adds: variance, covariance, variance of the speed."""
    moved, variance = 0.5 * dt * dt, acceleration_sd**2
    return moved * moved * variance, moved * dt * variance, dt * dt * variance
