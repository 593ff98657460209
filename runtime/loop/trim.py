"""How far the sufferer's thrust is off its curve, told apart from the wake while it flies.

In: what the estimator cannot explain, and the wake that the rig file expects. Out: the force by
which the thrust that carries the weight differs from the curve's, and the push that the air already
on its way will give. A descent without height needs both: the wake leaves with the source, an error
of the thrust stays.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from runtime.loop.copies import replace
from runtime.loop.estimate import Estimate
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.physics.effects.chain import believed
from wakedeploy.physics.jet import VerticalJet, drag_force
from wakedeploy.physics.motor import spooled
from wakedeploy.physics.rail import GRAVITY_MPS2

THRUST_SD_SHARE = 0.03  # of the weight: how well a thrust curve is known before a flight
WAKE_SD = 0.6  # of the wake's force over the rig file's
_THRUST_DRIFT_N = 0.03  # standard deviation after a second, as batteries sag
_WAKE_DRIFT = 0.05
# The estimator's disturbance is off by about this much, and stays so for about ten ticks.
_FORCE_SD_N = 0.25
_FORCE_TICKS = 10.0
# It follows a force with a lag [s] and, since it expects forces to fade, by a share only: first by
# PID alone (first pair), or with the wake forecast. Read from the filter's response to a step.
_ALONE = (0.13, 0.86)
_FORECAST = (0.22, 0.80)
_MOST_OFF_N = 2.0  # of a single measurement
_TRIM_OFF_N = 1.0  # a measurement beyond it is of the wake at most: lost thrust is no trim
_MOST_SHARE = 0.06  # of the weight, for the same reason
_SWING_S = 0.7  # the swing of what is left unexplained is averaged over this
_AIRBORNE_M = 0.05
_PUFFS_PER_TICK = 2
_TICK_S = 1.0 / LOOP_RATE_HZ


@dataclass(frozen=True, slots=True)
class Trim:
    """Excess of the thrust [N], the wake's force over the rig file's, and their covariance."""

    thrust_n: float
    strength: float
    thrust_var: float
    strength_var: float
    covariance: float = 0.0


class TrimReader:
    """One flight's trim: `step` once a tick. Two regressors, updated as a Kalman filter does."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig = believed(rig)
        self._dt_s = _TICK_S / _PUFFS_PER_TICK
        self._jet = VerticalJet(rig.wake, rig.source.height_m, self._dt_s)
        self._source_speed = 0.0  # √N
        self._lagged_n = 0.0  # the wake that no forecast has, as the estimator follows it
        weight_n = rig.sufferer.mass_kg * GRAVITY_MPS2
        self._most_n = _MOST_SHARE * weight_n
        self._left_n = self._swing_n2 = 0.0
        self.trim = Trim(0.0, 1.0, (THRUST_SD_SHARE * weight_n) ** 2, WAKE_SD**2)

    @property
    def unexplained_sd_n(self) -> float:
        """How much the force [N] swings that thrust, trim and wake leave unexplained."""
        return math.sqrt(self._swing_n2)

    def step(
        self, now: Estimate, forecast_n: float | None, source_us: float, *, believe: bool
    ) -> Trim:
        """Take in one tick's estimate, made with the wake forecast [N] for it, if there was one.

        `source_us`: the command of the tick before, which acts by now. With `believe` False only
        the air moves on: on the stop, and while the height is in doubt.
        """
        self._inject(source_us)
        lag_s, share = _ALONE if forecast_n is None else _FORECAST
        strength = self.trim.strength
        model_n = self._model_n(now.x_m, now.z_m, 0.0)
        left_n = strength * model_n - (forecast_n or 0.0)
        self._lagged_n += (left_n - self._lagged_n) * -math.expm1(-_TICK_S / lag_s)
        off_n = now.disturbance_n / share - self.trim.thrust_n - self._lagged_n
        if believe and now.z_m > _AIRBORNE_M and math.isfinite(off_n):
            self._swing(off_n)
            after = _updated(self.trim, off_n, model_n)
            self.trim = replace(
                after,
                thrust_n=min(max(after.thrust_n, -self._most_n), self._most_n),
                strength=max(after.strength, 0.0),
            )
        return self.trim

    def wake_n(self, x_m: float, z_m: float, ahead_s: float, held_s: float) -> float:
        """The wake's force [N] at a place, `ahead_s` from now, once the source is off.

        The source keeps its present thrust for `held_s` and is idle from then on.
        """
        return self.trim.strength * self._model_n(x_m, z_m, ahead_s, held_s)

    def wakes_n(
        self, x_m: float, z_m: float, aheads_s: Iterable[float], held_s: float
    ) -> list[float]:
        """`wake_n` for many times at one place."""
        if not (math.isfinite(x_m) and math.isfinite(z_m)):
            return [0.0 for _ in aheads_s]
        speeds_mps = self._jet.velocities_ahead(x_m, z_m, aheads_s, held_s)
        wake, strength = self._rig.wake, self.trim.strength
        return [strength * drag_force(wake, 0.0, vz_mps) for vz_mps in speeds_mps]

    def _swing(self, off_n: float) -> None:
        share = -math.expm1(-_TICK_S / _SWING_S)
        self._left_n += share * (off_n - self._left_n)
        self._swing_n2 += share * ((off_n - self._left_n) ** 2 - self._swing_n2)

    def _inject(self, source_us: float) -> None:
        target = math.sqrt(self._rig.thrust.source.thrust(source_us))
        lag = self._rig.spool.source
        for _ in range(_PUFFS_PER_TICK):
            self._source_speed = spooled(self._source_speed, target, lag, self._dt_s)
            self._jet.inject(self._source_speed**2)

    def _model_n(self, x_m: float, z_m: float, ahead_s: float, held_s: float = 0.0) -> float:
        """The wake's force [N] by the rig file alone."""
        if not (math.isfinite(x_m) and math.isfinite(z_m)):
            return 0.0
        vz_mps = self._jet.velocity_ahead(x_m, z_m, ahead_s, idle_after_s=held_s)
        return drag_force(self._rig.wake, 0.0, vz_mps)


def _updated(before: Trim, off_n: float, model_n: float) -> Trim:
    """One measurement: `off_n`, beside what was expected, is thrust + strength · model."""
    off_n = min(max(off_n, -_MOST_OFF_N), _MOST_OFF_N)
    a = before.thrust_var + _THRUST_DRIFT_N**2 * _TICK_S
    c = before.strength_var + _WAKE_DRIFT**2 * _TICK_S
    b = before.covariance
    gain_a, gain_c = a + b * model_n, b + c * model_n
    variance = gain_a + model_n * gain_c + _FORCE_SD_N**2 * _FORCE_TICKS
    thrust_off_n = off_n if abs(off_n) < _TRIM_OFF_N else 0.0
    return Trim(
        before.thrust_n + gain_a / variance * thrust_off_n,
        before.strength + gain_c / variance * off_n,
        a - gain_a**2 / variance,
        c - gain_c**2 / variance,
        b - gain_a * gain_c / variance,
    )
