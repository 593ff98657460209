"""Motor and ESC: from pulse width to thrust, through the ESC's frame and the rotor's inertia."""

import math
from dataclasses import dataclass

from wakedeploy.core.rig import SpoolLag, ThrustCurve


def spooled(speed: float, target: float, lag: SpoolLag, dt_s: float) -> float:
    """Rotor speed after `dt_s` of a first-order lag, slower down than up as the rig says.

    Speeds are in √N, so that thrust = speed². Exact for a target held over the step.
    """
    time_constant_s = lag.up_s if target > speed else lag.down_s
    if time_constant_s <= 0.0:
        return target
    return target + (speed - target) * math.exp(-dt_s / time_constant_s)


def mean_thrust(before: float, after: float, lag: SpoolLag) -> float:
    """Mean thrust [N] of a step from one rotor speed [√N] to another; without lag, the latter's.

    The thrust at the step's end would act half a step too early.
    """
    lag_s = lag.up_s if after > before else lag.down_s
    if lag_s <= 0.0:
        return after * after
    return (before * before + before * after + after * after) / 3.0


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
