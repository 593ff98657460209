"""Height and lateral position from range samples and step counts: a Kalman filter.

Pure steps, `(state, input) → state`. Height: z, its speed, and the disturbance force that the known
thrust does not explain. The range sample's age is known and part of the measurement equation; a
missed or repeated sample is predicted through.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from runtime.loop.copies import replace
from runtime.loop.kalman import predict as kalman_predict
from runtime.loop.kalman import update as kalman_update
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.physics.effects.chain import believed, unplaced_constants
from wakedeploy.physics.motor import held_pulse
from wakedeploy.physics.rail import GRAVITY_MPS2, smooth_friction

FloatArray = npt.NDArray[np.float64]

_FORCE_TIME_S = 1.0  # the disturbance is expected to change within a second …
_FORCE_SD_N = 1.0  # … by about the size of a wake's force
_UNFORESEEN_SD_N = 0.25  # … or, with the wake forecast, by what forecasts leave over
_ACCELERATION_SD_MPS2 = 0.3  # what the thrust model leaves open, per tick
_STEP_ACCELERATION_SD_MPS2 = 2.0
_GATE_SD = 5.0
# Samples in a row with the same value in the air. One in a thousand repeats so often by chance;
# a sensor that holds its readings does, too. What it says then is no news.
SAME_TICKS = 3
_PERSISTENT = 4  # that many rejected samples in a row are no outliers …
_SCATTER_M = 0.1  # … unless they go to and fro by this much, as no motion does
_PAUSE_S = 0.1  # without a step: what the commands did meanwhile is not known
_PAUSE_SD_MPS = 1.0  # and so is the speed, by about this much
# For as long as the board waits for commands it holds the last pulse: forces change by a wake only.
_HELD_S, _HELD_SD_MPS2 = 0.14, 3.0
# Differences of neighbouring innovations are squared over their variance and averaged: what a wrong
# model adds to both falls out, and noise remains (von Neumann 1941). A sensor noisier than the rig
# file says is believed the less, down to a 200th.
_SURPRISE_TICKS, _MOST_SURPRISE = 16.0, 9.0
_SURPRISED, _CALM = 3.0, 1.2
_NOISE_UP, _NOISE_DOWN, _MOST_NOISE = 1.5, 1.05, 200.0
_GATED_NOISE = 25.0  # of it in the gate: more would let strays in
# Half of the last seven innovations, and half of the readings' second differences, are off by so
# many times the noise of the rig file: this is noise already, before a mean has told. No motion
# bends so much from one reading to the next, and a stray leaves a median as it is.
_SUDDEN_READINGS, _SUDDEN_SD, _MEDIAN_SD = 7, 4.0, 1.4826
# A sensor with so much noise, or so many strays, is none. One stray in five is not many.
_STRAY_TICKS, _TOO_MANY_STRAYS = 12.0, 0.6
_TOO_NOISY, _MANY_STRAYS = 60.0, 0.45  # together: some 8 times the rig file's noise
_MERE_NOISE, _MERE_TICKS = 190.0, 20  # by itself: 14 times the noise, in most readings for long
_SWING = 2.0  # a stray is off by half as much from the sample before as from the filter, at least
_FEW_STRAYS = 0.1
_CARRIED_SHARE = 0.3  # of the weight: with less a reading off the stop is the sensor's own error
_STARTLED = 9.0  # an innovation's square over its variance, after which a forecast is not believed
# Innovations that add up to one side are a push that began a tenth of a second ago (Page 1954;
# Willsky and Jones 1976): force, speed and height change together. A single stray is not enough.
# Wakes as in the rig file do this once in three hundred ticks, and the filter is less sure then.
_PUSH_SUM_SD, _PUSH_DRIFT_SD, _PUSH_MOST_SD = 3.5, 1.0, 3.5
_FAR_SD, _PUSH_GROWTH, _WARY_TICKS, _PUSH_SIDE = 8.0, (1.3, 3.0), 8, 3
_PUSH_SD_N, _PUSH_AGO_S, _PUSH_ABOVE_M = 3.0, 0.1, 0.03
# Noise and strays can add up, too: for some ticks a filter that knows of no push goes on beside.
# Where it foresees the readings better, there was none.
_UNPUSHED_TICKS, _NO_PUSH, _PUSH = 8, 2.0, -6.0
_UNSURE_MPS = 0.5  # with so little known of the speed, one goes on without the first reading, too
_MOST_SD = 6.0  # as which an innovation counts at most in a log likelihood


@dataclass(frozen=True, slots=True)
class Measurement:
    """What one tick read: newest range sample (NaN: none), its age, its repeats; step count.

    The steps are as old as the newest answer; `steps_repeats` counts ticks without a new one.
    `same` counts samples in a row that say what the one before said, off the stop; `alike` counts
    them there, too. `acts_known`: the board has told of the last commands in time.
    """

    t_s: float
    range_m: float
    range_age_s: float
    range_repeats: int
    steps: int
    steps_repeats: int = 0
    same: int = 0
    alike: int = 0
    acts_known: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Filter state after one tick; `height` is (z [m], vz [m/s], disturbance [N])."""

    t_s: float
    height: FloatArray  # (3,)
    height_cov: FloatArray  # (3, 3)
    lateral: FloatArray  # (2,)
    lateral_cov: FloatArray  # (2, 2)
    rotor_speed: float = 0.0  # of the sufferer, √N
    rejected: int = 0
    innovation_m: float = math.nan
    innovation_var_m2: float = math.nan
    off_m: float = math.inf  # the least that any sample was off, of those rejected in a row
    rejects: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of those: first, last, path [m]
    jumped_m: float = 0.0  # the least, when the next is taken in because so many were rejected
    surprise: float = 1.0  # mean of innovations' differences, squared, over what noise gives
    last_innovation_m: float = math.nan
    stale_s: float = 0.0  # since a new sample says the same again and again
    noise_scale: float = 1.0  # of the sensor's variance over the rig file's
    stray_share: float = 0.0  # of the latest samples, those that the rig file's noise cannot give
    rejected_s: float = 0.0  # since the last sample that was taken in, of those that were rejected
    pushed: tuple[float, float] = (0.0, 0.0)  # innovations that add up downwards and upwards, in sd
    side: int = 0  # innovations in a row to one side, with its sign
    wary_ticks: int = 0  # since a stray; with a second one nothing adds up for as long
    # Of the last readings, oldest first: when each was taken [s], what it said [m], its innovation.
    lately: tuple[tuple[float, float, float], ...] = ()
    sudden_ticks: int = 0  # since they are noisier than a mean has told
    # What it would be without the push that was told last, or the first reading after a pause.
    unpushed: "Estimate | None" = None
    unpushed_more: float = 0.0  # log likelihood of that over this, since then
    unpushed_ticks: int = 0

    @property
    def is_noisy(self) -> bool:
        """Whether too little is left of what the sensor says to fly by it."""
        most = _MANY_STRAYS if self.noise_scale > _TOO_NOISY else _TOO_MANY_STRAYS
        is_mere = self.noise_scale > _MERE_NOISE and self.sudden_ticks > _MERE_TICKS
        return self.stray_share > most or is_mere

    @property
    def is_calm(self) -> bool:
        """Whether the sensor says what the filter expects, as nearly always."""
        return self.noise_scale == 1.0 and not self.has_strays

    @property
    def has_strays(self) -> bool:
        """Whether more of the latest samples were strays than a sensor of this rig has."""
        return self.stray_share >= _FEW_STRAYS

    @property
    def z_m(self) -> float:
        """Height [m]."""
        return float(self.height[0])

    @property
    def vz_mps(self) -> float:
        """Vertical speed [m/s]."""
        return float(self.height[1])

    @property
    def disturbance_n(self) -> float:
        """The force [N] that known thrust, weight, friction and forecast leave over."""
        return float(self.height[2])

    @property
    def x_m(self) -> float:
        """Lateral position [m]."""
        return float(self.lateral[0])

    @property
    def vx_mps(self) -> float:
        """Lateral speed [m/s]."""
        return float(self.lateral[1])


def initial_estimate(t_s: float) -> Estimate:
    """At rest on the stop, carriage homed."""
    return Estimate(
        t_s,
        np.zeros(3),
        np.diag([0.02**2, 0.01**2, 0.05**2]),
        np.zeros(2),
        np.diag([0.001**2, 0.01**2]),
    )


class Estimator:
    """The filter's constants for one rig, and its two pure steps.

    What the rig file's effects say of its constants, of delays and of the range sensor is believed.
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
        this time, if it was; the disturbance is what that leaves over.
        """
        after = self._stepped(before, measured, pulses_us, wake_n)
        if before.unpushed is None or after.unpushed is not before.unpushed:
            return after
        unaware = replace(measured, acts_known=False)  # where no push is told
        without = self._stepped(before.unpushed, unaware, pulses_us, wake_n)
        return _judged(after, replace(without, unpushed=None))

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
        """On the stop with too little thrust to leave it: the stop carries the weight.

        Unless it is seen to leave although the motor carries a part only: something else lifts it.
        """
        weight_n = self._rig.sufferer.mass_kg * GRAVITY_MPS2
        is_near = now.z_m < 0.02 and now.vz_mps < 0.05 and thrust_n < 0.98 * weight_n
        lifts = now.innovation_m > 0.0 and now.innovation_m**2 > _STARTLED * now.innovation_var_m2
        return is_near and not (lifts and thrust_n > _CARRIED_SHARE * weight_n)

    def _after_a_push(self, now: Estimate) -> Estimate:
        """The state as it may be if something has begun to push, of which nothing is known yet."""
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
        # What it moved while the sensor stood still is not known.
        now = unseen = replace(_after_a_pause(unseen, unseen.stale_s), stale_s=0.0)
        age = measured.range_age_s + self._range_delay_s
        range_m = (measured.range_m - self._range_bias_m) / self._range_scale
        row = np.array([[1.0, -age, 0.5 * age * age / self._rig.sufferer.mass_kg]])
        innovation = range_m - float((row @ now.height)[0])
        noise_var = self._range_var * now.noise_scale
        variance = float((row @ now.height_cov @ row.T)[0, 0]) + noise_var
        if now.height_cov[1, 1] > _UNSURE_MPS**2 and now.unpushed is None:
            # After a pause a single reading would tell the speed, and it may be a stray.
            unseen = _apart(unseen, unseen)
        lately = (
            *unseen.lately[-_SUDDEN_READINGS - 1 :],
            (measured.t_s - age, range_m, innovation),
        )
        sudden_var = _sudden_m(lately) ** 2
        is_sudden = sudden_var > _SUDDEN_SD**2 * self._range_var
        seen = replace(
            unseen,
            innovation_m=innovation,
            innovation_var_m2=variance,
            lately=lately,
            sudden_ticks=unseen.sudden_ticks + 1 if is_sudden else 0,
        )
        seen = _surprised(_added_up(seen, acts_known=measured.acts_known))
        # Nearer, the stop itself pushes; and the same reading again is no news.
        is_clear = now.z_m > _PUSH_ABOVE_M and measured.alike == 0
        if is_sudden:
            seen = replace(seen, pushed=(0.0, 0.0))
            variance += max(sudden_var - noise_var, 0.0)
            noise_var = max(sudden_var, noise_var)
        elif max(seen.pushed) > _PUSH_SUM_SD and abs(seen.side) >= _PUSH_SIDE and is_clear:
            now = seen = self._after_a_push(_apart(seen, unseen))
            variance = float((row @ now.height_cov @ row.T)[0, 0]) + noise_var
        excess_var = max(noise_var - _GATED_NOISE * self._range_var, 0.0)
        is_far = innovation**2 > _GATE_SD**2 * (variance - excess_var)
        off_m = min(now.off_m, abs(innovation))
        first_m, last_m, path_m = now.rejects if now.rejected else (range_m, range_m, 0.0)
        rejects = (first_m, range_m, path_m + abs(range_m - last_m))
        is_scattered = rejects[2] - abs(range_m - first_m) > _SCATTER_M
        is_same = now.rejected > 0 and measured.alike > 0  # the same again is no news
        is_stray = is_same or (is_far and (now.rejected < _PERSISTENT or is_scattered))
        out_var = _GATE_SD**2 * (variance - noise_var + self._range_var)
        # To and fro: a model that is wrong about the motion is off, too, but by nearly the same.
        swing_m = innovation - before_m if math.isfinite(before_m := now.last_innovation_m) else 0.0
        is_out = min(innovation**2, (_SWING * swing_m) ** 2) > out_var
        share = now.stray_share + (float(is_out) - now.stray_share) / _STRAY_TICKS
        seen = replace(seen, stray_share=share)
        if is_stray:
            if now.rejected >= _PERSISTENT:
                return replace(seen, rejected=1, off_m=off_m, rejects=(range_m, range_m, 0.0))
            return replace(seen, rejected=now.rejected + 1, off_m=off_m, rejects=rejects)
        height, cov = kalman_update(
            now.height, now.height_cov, np.array([range_m]), np.array([[noise_var]]), row
        )
        return replace(
            seen,
            height=height,
            height_cov=cov,
            rejected=0,
            off_m=math.inf,
            jumped_m=off_m if now.rejected >= _PERSISTENT else 0.0,
            rejected_s=0.0,
        )


def _added_up(now: Estimate, *, acts_known: bool) -> Estimate:
    """What innovations add up to downwards and upwards with this one, over what noise gives."""
    off_sd = now.innovation_m / math.sqrt(now.innovation_var_m2)
    sign = 1 if off_sd > 0.0 else -1
    now = replace(now, side=now.side + sign if now.side * sign > 0 else sign)
    # Motion grows, with the square of time. What is far off at once is a stray, a jump or noise.
    growth = now.innovation_m / now.last_innovation_m if now.last_innovation_m else math.inf
    if abs(off_sd) > _FAR_SD and not _PUSH_GROWTH[0] < growth < _PUSH_GROWTH[1]:
        again = _WARY_TICKS if now.wary_ticks else 0
        return replace(now, wary_ticks=_WARY_TICKS + again)
    now = replace(now, wary_ticks=max(now.wary_ticks - 1, 0))
    if now.wary_ticks > _WARY_TICKS or now.noise_scale > 1.0 or not acts_known:
        return replace(now, pushed=(0.0, 0.0))
    off_sd = min(max(off_sd, -_PUSH_MOST_SD), _PUSH_MOST_SD)
    down, up = now.pushed
    sums = (max(down - off_sd - _PUSH_DRIFT_SD, 0.0), max(up + off_sd - _PUSH_DRIFT_SD, 0.0))
    return replace(now, pushed=sums)


def _apart(now: Estimate, without: Estimate) -> Estimate:
    """The filter, and beside it from now on the one `without` its news."""
    without = replace(without, unpushed=None)
    return replace(now, unpushed=without, unpushed_more=0.0, unpushed_ticks=0)


def _judged(pushed: Estimate, without: Estimate) -> Estimate:
    """The filter that was told of a push, or the one `without`, if that foresees better."""
    more, ticks = pushed.unpushed_more, pushed.unpushed_ticks + 1
    if math.isfinite(pushed.innovation_m + without.innovation_m):
        more += log_likelihood(without) - log_likelihood(pushed)
    if more > _NO_PUSH:
        return replace(without, lateral=pushed.lateral, lateral_cov=pushed.lateral_cov)
    if more < _PUSH or ticks > _UNPUSHED_TICKS:
        return replace(pushed, unpushed=None)
    return replace(pushed, unpushed=without, unpushed_more=more, unpushed_ticks=ticks)


def log_likelihood(now: Estimate) -> float:
    """How well the filter foresaw its last reading; one that is far off counts as a stray does."""
    square = min(now.innovation_m**2 / now.innovation_var_m2, _MOST_SD**2)
    return -0.5 * (square + math.log(now.innovation_var_m2))


def _sudden_m(lately: tuple[tuple[float, float, float], ...]) -> float:
    """The noise [m] that the last innovations and the readings' second differences both have."""
    if len(lately) < _SUDDEN_READINGS + 2:
        return 0.0
    bends_m = sorted(map(_bent_m, lately, lately[1:], lately[2:]))
    sizes_m = sorted(abs(one[2]) for one in lately[2:])
    middle = _SUDDEN_READINGS // 2
    return _MEDIAN_SD * min(bends_m[middle] / math.sqrt(6.0), sizes_m[middle])


def _bent_m(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    """How far the last of three readings is off the line of the others [m]."""
    share = (c[0] - b[0]) / (b[0] - a[0]) if b[0] > a[0] else 1.0
    return abs(c[1] - b[1] - share * (b[1] - a[1]))


def _surprised(now: Estimate) -> Estimate:
    """The filter after an innovation: how noisy the sensor is."""
    difference_m = now.innovation_m - now.last_innovation_m
    if not math.isfinite(difference_m):
        return replace(now, last_innovation_m=now.innovation_m)
    square = min(0.5 * difference_m**2 / now.innovation_var_m2, _MOST_SURPRISE)
    surprise = now.surprise + (square - now.surprise) / _SURPRISE_TICKS
    scale = now.noise_scale
    if surprise > _SURPRISED:
        scale = min(scale * _NOISE_UP, _MOST_NOISE)
    elif surprise < _CALM:
        scale = max(scale / _NOISE_DOWN, 1.0)
    return replace(now, surprise=surprise, noise_scale=scale, last_innovation_m=now.innovation_m)


def _after_a_pause(now: Estimate, passed_s: float) -> Estimate:
    """The state with what it does not know of a time in which the loop stood still."""
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
