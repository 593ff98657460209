"""Effects along a motion: what they may look at, what is remembered for them, and their order.

In: a motion, step by step, or a whole flight's at once. Out: thrusts, air, forces and readings as
the effects leave them.
"""

import math
from collections import deque

import numpy as np

from wakedeploy.core.rig import Rig
from wakedeploy.physics.effects.base import FloatArray, Motion, Number, Setting
from wakedeploy.physics.effects.chain import Chain, setting_of

TAKEN_OFF = 0.5  # of its weight: the sufferer's thrust at which `Motion.time_s` begins to count
LEAST_MOTION_MPS = 0.005  # a slower carriage keeps its direction: step counts cannot tell


def in_steps(delay_s: float, dt_s: float) -> tuple[int, float]:
    """A delay as whole steps and the share of one more."""
    whole = int(math.floor(delay_s / dt_s + 1e-9))  # noqa: RUF046  an exported model needs the int
    return whole, max(delay_s / dt_s - whole, 0.0)


class DelayLine:
    """A value as it was `delay_s` ago, in steps of `dt_s`, linear between them."""

    def __init__(self, delay_s: float, dt_s: float, initial: float) -> None:
        whole, self._share = in_steps(delay_s, dt_s)
        self._past = deque([initial] * (whole + 2), maxlen=whole + 2)  # oldest first

    def passed(self, value: float) -> float:
        """Put in the present value, take out the old one; called once per step."""
        self._past.append(value)
        return (1.0 - self._share) * self._past[1] + self._share * self._past[0]


def motion_along(
    t_s: FloatArray, take_off_s: float, x_m: FloatArray, vx_mps: FloatArray, dt_s: float
) -> Motion:
    """What effects may look at of time and carriage, over a flight's steps (N,) of `dt_s`.

    The same as `ActingEffects` notes step by step.
    """
    moving = np.abs(vx_mps) >= LEAST_MOTION_MPS
    last = np.maximum.accumulate(np.where(moving, np.arange(len(vx_mps)), -1))
    return Motion(
        time_s=np.maximum(t_s - take_off_s, 0.0),
        x_m=x_m,
        vx_mps=vx_mps,
        travelled_m=np.cumsum(np.abs(vx_mps)) * dt_s,
        direction=np.where(last >= 0, np.sign(vx_mps[np.maximum(last, 0)]), 0.0),
    )


def blow(chain: Chain, m: Motion, setting: Setting, air_mps: Number) -> Number:
    """The air's vertical speed [m/s] at the sufferer after effects, which is noted in `m`."""
    m.wake_mps = air_mps
    m.wake_mps = chain.wake_mps(m, setting)
    return m.wake_mps


def push(chain: Chain, m: Motion, setting: Setting, wake_n: Number) -> tuple[Number, Number]:
    """The effects' extra force [N] and inertia [kg] on a sufferer in a wake of this force.

    `m` gets the wake's force and the sufferer's thrust in it, which forces and inertia may depend
    on.
    """
    m.wake_n = wake_n
    m.sufferer_n = chain.sufferer_n(m, setting)
    return chain.force_n(m, setting), chain.added_mass_kg(m, setting)


class ActingEffects:
    """A chain of effects along one run of the plant; called in the order of its methods.

    `charge_s` counts the thrust after spool and before any effect on it; `time_s` counts from when
    that thrust first reaches half the weight; the carriage's direction changes with motions of
    5 mm/s or more.
    """

    def __init__(self, chain: Chain, rig: Rig, dt_s: float) -> None:
        self._chain, self._dt_s = chain, dt_s
        self._setting = setting_of(rig)
        self._idle_us = rig.limits.pulse_us[0]
        self._accepted_us = {"source": self._idle_us, "sufferer": self._idle_us}
        self._taken_off_s = math.inf
        self._carriage_m: float | None = None
        self.motion = Motion()

    def look(self, t_s: float, x_m: float, vx_mps: float, z_m: float, vz_mps: float) -> None:
        """A step begins at this time and with this motion."""
        m = self.motion
        m.time_s = max(t_s - self._taken_off_s, 0.0)
        m.x_m, m.vx_mps, m.z_m, m.vz_mps = x_m, vx_mps, z_m, vz_mps
        if abs(vx_mps) >= LEAST_MOTION_MPS:
            m.direction = math.copysign(1.0, vx_mps)
        self._carriage_m = self._chain.carriage_m(x_m, self._carriage_m)

    def range_m(self, range_m: float) -> float:
        """The range [m] that the sensor sees."""
        return float(self._chain.range_m(range_m, self.motion, self._setting))

    def pulse_us(self, pulse_us: float, motor: str) -> float:
        """The pulse [µs] that a motor's ESC takes over in this servo frame."""
        accepted_us = self._accepted_us[motor]
        self._accepted_us[motor] = self._chain.pulse_us(pulse_us, accepted_us, motor, self._idle_us)
        return self._accepted_us[motor]

    def source_n(self, t_s: float, source_n: float, sufferer_n: float) -> float:
        """The source's thrust [N], of both motors' thrusts after spool."""
        m, before_n = self.motion, self.motion.source_n
        if sufferer_n >= TAKEN_OFF * self._setting.weight_n:
            self._taken_off_s = min(self._taken_off_s, t_s)
        m.charge_s = m.charge_s + sufferer_n / self._setting.weight_n * self._dt_s
        m.source_n, m.sufferer_n = source_n, sufferer_n
        m.source_n = self._chain.source_n(m, self._setting)
        m.source_rate_nps = (m.source_n - before_n) / self._dt_s
        return float(m.source_n)

    def wake_x_m(self, x_m: float) -> float:
        """Where in the wake [m] a sufferer is whose carriage's drive is, or will be, at `x_m`."""
        carriage_m = self._chain.carriage_m(x_m, self._carriage_m)
        return carriage_m - float(self._chain.wake_offset_m(self.motion, self._setting))

    def wake_mps(self, wake_mps: float) -> float:
        """The air's vertical speed [m/s] at the sufferer."""
        return float(blow(self._chain, self.motion, self._setting, wake_mps))

    def push(self, wake_n: float) -> tuple[float, float, float]:
        """The sufferer's thrust [N] in a wake of this force, extra force [N] and inertia [kg]."""
        force_n, added_kg = push(self._chain, self.motion, self._setting, wake_n)
        return float(self.motion.sufferer_n), float(force_n), float(added_kg)

    def travel(self, carriage_mps: float) -> None:
        """A step ends in which the carriage went at this speed."""
        self.motion.travelled_m = self.motion.travelled_m + abs(carriage_mps) * self._dt_s
