"""Motor and ESC: from pulse width to thrust, through the ESC's frame and the rotor's inertia."""

import math
from dataclasses import dataclass

from wakedeploy.core.rig_sections import SpoolLag, ThrustCurve


def kept(lag_s: float, dt_s: float) -> float:
    """The share of its distance to the target that a first-order lag keeps over `dt_s`."""
    return math.exp(-dt_s / lag_s) if lag_s > 0.0 else 0.0


def approached(speed: float, target: float, keep: float) -> float:
    """Rotor speed [√N] after a step over which it keeps this share of its distance."""
    return target + (speed - target) * keep


def spooled(speed: float, target: float, lag: SpoolLag, dt_s: float) -> float:
    """Rotor speed [√N] after `dt_s` of a first-order lag, slower down than up as the rig says.

    Speeds are in √N, so that thrust = speed². Exact for a target held over the step.
    """
    lag_s = lag.up_s if target > speed else lag.down_s
    return approached(speed, target, kept(lag_s, dt_s))


def mean_thrust(before: float, after: float, lag: SpoolLag) -> float:
    """Mean thrust [N] of a short step between two rotor speeds [√N]; without lag, the latter's.

    The thrust at the step's end would act half a step too early. The speed is taken as linear over
    the step; `exact_mean_thrust` differs from it by (step / lag)² / 6 of the change.
    """
    lag_s = lag.up_s if after > before else lag.down_s
    if lag_s <= 0.0:
        return after * after
    return (before * before + before * after + after * after) / 3.0


def exact_mean_thrust(before: float, target: float, lag_steps: float, keep: float) -> float:
    """Mean thrust [N] of a step of any length: the square of an exponential approach, integrated.

    `lag_steps` is the lag in steps. A fit tries lags that are shorter than its steps, where a
    linear speed would be far off.
    """
    gap = before - target
    mean_gap = gap * lag_steps * (1.0 - keep)
    mean_gap2 = gap * gap * 0.5 * lag_steps * (1.0 - keep * keep)
    return target * target + 2.0 * target * mean_gap + mean_gap2


def held_pulse(
    curve: ThrustCurve, lag: SpoolLag, speed: float, pulse_us: float, span_s: float
) -> tuple[float, float]:
    """Rotor speed [√N] after a pulse [µs] was held for `span_s`, and the mean thrust [N]."""
    after = spooled(speed, math.sqrt(curve.thrust(pulse_us)), lag, span_s)
    return after, mean_thrust(speed, after, lag)


@dataclass
class Motor:
    """One motor with its ESC; `speed` is the rotor's, in √N, `thrust_n` the last step's mean."""

    curve: ThrustCurve
    lag: SpoolLag
    speed: float = 0.0
    target: float = 0.0
    thrust_n: float = 0.0

    def set_pulse(self, pulse_us: float) -> None:
        """The ESC takes over a new pulse width [us]."""
        self.target = math.sqrt(self.curve.thrust(pulse_us))

    def step(self, dt_s: float) -> float:
        """Mean thrust [N] over the next `dt_s`."""
        before = self.speed
        self.speed = spooled(before, self.target, self.lag, dt_s)
        self.thrust_n = mean_thrust(before, self.speed, self.lag)
        return self.thrust_n


class EscFrame:
    """The servo frame: a command waits for the next pulse, 0…`period_s` later.

    A period of zero passes every command on at once.
    """

    def __init__(self, period_s: float, phase_s: float) -> None:
        self._period_s = period_s
        self._next_s = phase_s

    def due(self, t_s: float) -> bool:
        """Whether a pulse starts at or before `t_s` that has not been asked for yet."""
        if self._period_s <= 0.0:
            return True
        if t_s < self._next_s - 1e-9:
            return False
        self._next_s += self._period_s * (1 + int((t_s - self._next_s) / self._period_s))
        return True
