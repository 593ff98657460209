"""The way down when nobody knows the height: pulses that let the sufferer sink at a bounded speed.

In: the last estimate that can be trusted, and the trim. Out: two pulses, and a ladder of them over
time. *Brake* takes the present speed away and carries what is left of the wake. *Sink* carries the
weight alone; it is reduced slowly, so that a sufferer with more thrust than thought comes down,
too. The board follows the same ladder when commands stop; each command carries both pulses.
"""

import math
from dataclasses import dataclass

from runtime.loop.copies import replace
from runtime.loop.estimate import Estimate
from runtime.loop.trim import TrimReader
from wakedeploy.core.rig import Rig
from wakedeploy.core.rig_sections import Limits
from wakedeploy.physics.effects.chain import believed
from wakedeploy.physics.motor import held_pulse
from wakedeploy.physics.rail import GRAVITY_MPS2, smooth_friction

SINK_MPS = 0.3  # downwards, when the brake ends
# The speed that a sink from the present height may reach if the thrust is weaker than known by two
# standard deviations. The share of the weight that this leaves to gravity has bounds.
_LANDING_MPS = 0.75
_LEAST_MARGIN, _MOST_MARGIN = 0.005, 0.05
_LEAST_HEIGHT_M = 0.05
_RISE_S = 0.4  # for this long a climb goes on until the brake has ended it
# The wake still to come is looked at in steps; after half a second the air that was on its way has
# passed.
_WAKE_STEP_S, _WAKE_STEPS = 0.1, 5
_SPOOL_DOWN_S = 0.05  # of an idling source, counted as its present thrust
_STILL_M = 0.025  # of height: a sensor that stays within this shows no motion
_NEAR_M = 0.12  # below this, a sensor may say the same for long, and a take-off may go unseen
_SINKING_S = 0.3  # a sink that is seen reaches its speed within this
_RISE_SHARE, _RISE_WAKE = 1.35, 1.5  # weight and wake that a thrust must exceed to count as lifting
# A sensor that says the very same this many times shows nothing. A thrust then counts as lifting
# where it exceeds the weight by this factor: calibration may leave the curve as far off.
_ALIKE, _SILENT_SHARE = 6, 1.08
# The sufferer should have risen by the first, or, with such a sensor, have reached the second.
UNSEEN_RISE_M, SILENT_RISE_MPS = 0.1, 0.25
GROUND_M, GROUND_MPS = 0.03, 0.1  # up to these the sufferer is on the stop
_LEAST_SHARE, _MOST_SHARE = 0.5, 1.9  # of the weight: bounds of what a brake may ask for
_LAG_S = 0.03  # until a pulse acts: the wire and half a servo frame


@dataclass(frozen=True, slots=True)
class Reckoned:
    """Where the sufferer is, without trusting a sample that the filter has not taken in."""

    x_m: float = 0.0
    z_m: float = 0.0
    vz_mps: float = 0.0
    rotor_speed: float = 0.0  # √N

    @property
    def is_finite(self) -> bool:
        """Whether all of it is known."""
        return all(map(math.isfinite, (self.x_m, self.z_m, self.vz_mps, self.rotor_speed)))


@dataclass(frozen=True, slots=True)
class Rise:
    """A rise from the stop that the forces should have brought and the sensor does not show."""

    unseen_m: float = 0.0
    vz_mps: float = 0.0
    likely_mps: float = 0.0  # its speed by the forces as they are believed to be
    since_m: float = 0.0  # the height that the sensor has shown all the time
    silent_mps: float = 0.0  # its least speed, while the sensor says the very same
    held_n: float = 0.0  # thrust above the weight when it was last seen to move

    @property
    def is_unseen(self) -> bool:
        """Whether it is beyond doubt: either nothing lifts, or the sensor does not see the rise."""
        return self.unseen_m > UNSEEN_RISE_M or self.silent_mps > SILENT_RISE_MPS


@dataclass(frozen=True, slots=True)
class BlindPulses:
    """The sufferer's two pulses [µs]."""

    brake_us: float
    sink_us: float


class BlindPlanner:
    """One rig's constants, and the pure step from an estimate to the pulses."""

    def __init__(self, rig: Rig) -> None:
        self._rig = believed(rig)
        self._idle_us = rig.limits.pulse_us[0]
        self._mass_kg = rig.sufferer.mass_kg
        self._weight_n = self._mass_kg * GRAVITY_MPS2

    @property
    def idle(self) -> BlindPulses:
        """The pulses on the stop, where nothing is carried: motors off."""
        return BlindPulses(self._idle_us, self._idle_us)

    def reckon(
        self, before: Reckoned, now: Estimate, trim: TrimReader, dt_s: float, *, trusted: bool
    ) -> Reckoned:
        """One tick on: as estimated if a sample was taken in, else by the forces alone.

        The filter holds the last force that it saw; the wake that caused that may have gone since.
        """
        if trusted:
            return Reckoned(now.x_m, now.z_m, now.vz_mps, now.rotor_speed)
        wake_n = trim.wake_n(before.x_m, before.z_m, 0.0, 0.0)
        force_n = self._force_n(before, trim, now.rotor_speed**2, wake_n)
        vz_mps = before.vz_mps + force_n / self._mass_kg * dt_s
        z_m = before.z_m + 0.5 * (before.vz_mps + vz_mps) * dt_s
        return Reckoned(now.x_m, max(z_m, 0.0), vz_mps, now.rotor_speed)

    def pulses(
        self,
        now: Reckoned,
        trim: TrimReader,
        held_us: float,
        hold_s: float,
        *,
        height_known: bool = True,
    ) -> BlindPulses:
        """The pulses that a descent would begin with once `held_us` was held for `hold_s`."""
        thrust_n, brake_s = trim.trim.thrust_n, self._rig.limits.brake_s
        brake_n = self._weight_n - thrust_n
        if now.is_finite and brake_s > 0.0:
            span_s = hold_s + _LAG_S
            vz_mps = now.vz_mps + self._gained_mps(now, trim, held_us, span_s)
            brake_n += self._mass_kg * (-SINK_MPS - vz_mps) / brake_s
            brake_n -= self._wake_ns(now, trim, span_s) / brake_s
        # Near the stop a fall is over, or soon will be: a brake would only throw the sufferer up.
        most = _MOST_SHARE if now.z_m > _LEAST_HEIGHT_M else 1.0
        least_n, most_n = _LEAST_SHARE * self._weight_n, most * self._weight_n
        sink_n = (1.0 - self._margin(now, trim)) * self._weight_n - thrust_n
        if not height_known:  # the speed is not known either
            sink_n = brake_n = (1.0 - _LEAST_MARGIN) * self._weight_n - thrust_n
        return BlindPulses(self._pulse(min(max(brake_n, least_n), most_n)), self._pulse(sink_n))

    def _wake_ns(self, now: Reckoned, trim: TrimReader, span_s: float) -> float:
        """The impulse [N s] of the wake from `span_s` from now on, the source idle from then."""
        held_s = span_s + _SPOOL_DOWN_S
        ahead_s = (span_s + (i + 0.5) * _WAKE_STEP_S for i in range(_WAKE_STEPS))
        return _WAKE_STEP_S * sum(trim.wakes_n(now.x_m, now.z_m, ahead_s, held_s))

    def _gained_mps(self, now: Reckoned, trim: TrimReader, held_us: float, span_s: float) -> float:
        """The speed [m/s] gained while a pulse is held and the source stays as it is."""
        curve, lag = self._rig.thrust.sufferer, self._rig.spool.sufferer
        _, thrust_n = held_pulse(curve, lag, now.rotor_speed, held_us, span_s)
        wake_n = trim.wake_n(now.x_m, now.z_m, 0.5 * span_s, span_s)
        return self._force_n(now, trim, thrust_n, wake_n) / self._mass_kg * span_s

    def _force_n(self, now: Reckoned, trim: TrimReader, thrust_n: float, wake_n: float) -> float:
        """The force [N] left to accelerate the sufferer."""
        friction_n = smooth_friction(self._rig.rail, now.vz_mps)
        return thrust_n + trim.trim.thrust_n + wake_n - friction_n - self._weight_n

    def _margin(self, now: Reckoned, trim: TrimReader) -> float:
        """The share of the weight left to gravity: the lower the sufferer, the larger."""
        if not now.is_finite:
            return _LEAST_MARGIN
        height_m = max(now.z_m + _RISE_S * max(now.vz_mps, 0.0), _LEAST_HEIGHT_M)
        doubt_mps2 = 2.0 * math.sqrt(trim.trim.thrust_var) / self._mass_kg
        gained_mps2 = (_LANDING_MPS**2 - SINK_MPS**2) / (2.0 * height_m) - doubt_mps2
        return min(max(gained_mps2 / GRAVITY_MPS2, _LEAST_MARGIN), _MOST_MARGIN)

    def carried(self, share: float, other_n: float, hover_n: float) -> float:
        """The pulse [µs] that carries a share of the weight beside other forces [N].

        It is at most that share of what a hover took: the curve may be far off.
        """
        return self._pulse(min(share * self._weight_n - other_n, share * hover_n))

    def sinking(self, now: Estimate, other_n: float) -> float:
        """The pulse [µs] that brings a sink to its speed, if the height is seen."""
        wanted_n = self._weight_n - other_n
        wanted_n += self._mass_kg * (-SINK_MPS - now.vz_mps) / _SINKING_S
        least_n = _LEAST_SHARE * min(max(self._weight_n - other_n, 0.0), self._weight_n)
        most_n = _MOST_SHARE * self._weight_n
        return self._pulse(min(max(wanted_n, least_n), most_n))

    def rise(self, before: Rise, now: Estimate, alike: int, trim: TrimReader, dt_s: float) -> Rise:
        """One tick on: how far the sufferer should have risen near the stop without being seen to.

        Only thrust beyond _RISE_SHARE times the weight and _RISE_WAKE times the wake counts, and
        only while the sensor shows no motion at all. `alike`: samples in a row that said the very
        same.
        """
        if not now.z_m < _NEAR_M or abs(now.z_m - before.since_m) > _STILL_M:
            # What the filter makes of the same sample again is no motion.
            last_mps = before.likely_mps if alike > 0 else 0.0
            # A force that holds it down while it is still seen to move is no fault of the sensor's.
            held_n = max(now.rotor_speed**2 - self._weight_n, 0.0)
            return Rise(since_m=now.z_m, likely_mps=max(last_mps, now.vz_mps, 0.0), held_n=held_n)
        wake_n = _RISE_WAKE * trim.wake_n(now.x_m, now.z_m, 0.0, 0.0)
        carried_n = now.rotor_speed**2 + wake_n - before.held_n
        lifting_n = carried_n - _RISE_SHARE * self._weight_n
        vz_mps = max(before.vz_mps + lifting_n / self._mass_kg * dt_s, 0.0)
        silent_n = carried_n - _SILENT_SHARE * self._weight_n
        silent_mps = max(before.silent_mps + silent_n / self._mass_kg * dt_s, 0.0)
        seen_m = max(now.vz_mps, 0.0) * dt_s
        unseen_m = max(before.unseen_m + vz_mps * dt_s - seen_m, 0.0)
        likely_n = self._force_n(
            replace(Reckoned(), vz_mps=before.likely_mps),
            trim,
            now.rotor_speed**2,
            wake_n / _RISE_WAKE,
        )
        likely_mps = max(before.likely_mps + likely_n / self._mass_kg * dt_s, 0.0)
        return Rise(
            unseen_m,
            vz_mps,
            likely_mps,
            before.since_m,
            silent_mps if alike >= _ALIKE else 0.0,
            before.held_n,
        )

    def _pulse(self, thrust_n: float) -> float:
        low, high = self._rig.limits.pulse_us
        return min(max(self._rig.thrust.sufferer.pulse(thrust_n), low), high)


def on_the_stop(now: Reckoned) -> bool:
    """Whether motors may stop at once, because a fall from here is none."""
    return now.z_m < GROUND_M and abs(now.vz_mps) < GROUND_MPS


def ladder_pulse(pulses: BlindPulses, since_s: float, limits: Limits) -> float:
    """The sufferer's pulse [µs] `since_s` after a blind descent began: brake, sink, ramp."""
    idle_us, full_us = limits.pulse_us
    if since_s < limits.brake_s:
        return pulses.brake_us
    sunk_s = min(since_s - limits.brake_s, limits.sink_s)
    sink_us = pulses.sink_us - limits.sink_rate_us_per_s * sunk_s
    ramp_s = max(since_s - limits.brake_s - limits.sink_s, 0.0)
    ramp_us = ramp_s * (full_us - idle_us) / limits.sufferer_descent_s
    return max(idle_us, sink_us - ramp_us)


def ladder_s(limits: Limits) -> float:
    """How long a blind descent takes [s], from the brake to idle."""
    return limits.brake_s + limits.sink_s + limits.sufferer_descent_s
