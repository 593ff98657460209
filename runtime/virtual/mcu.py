"""The UNO's decisions in plain Python: limits, slew, carriage planner, deadman.

The virtual gantry answers the wire with it and simulated flights step it directly, so that both fly
behind the same limits. Time is whatever clock the caller counts in seconds.
"""

from dataclasses import dataclass

from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.core.rig_sections import Limits

PERIOD_S = 1.0 / LOOP_RATE_HZ
HOLD_PERIODS = 2.0
DESCEND_PERIODS = 4.0


@dataclass(frozen=True, slots=True)
class Outputs:
    """What the pins do now: pulse widths [µs] and the carriage's speed [m/s]."""

    source_us: float
    sufferer_us: float
    carriage_mps: float


@dataclass(frozen=True, slots=True)
class McuStatus:
    """What the MCU reports back."""

    armed: bool
    latched: bool
    missed_commands: int


def latch_s(limits: Limits) -> float:
    """How long a board hears nothing until its descent is over and it latches off [s]."""
    sufferer_s = limits.brake_s + limits.sink_s + limits.sufferer_descent_s
    return DESCEND_PERIODS * PERIOD_S + max(limits.source_descent_s, sufferer_s)


class Mcu:
    """Follows commands within the rig's limits; without any it holds, descends, latches off.

    The deadman holds the last command after 2 missed periods (and stops the carriage) and descends
    after 4 (125 ms), as that command said: the sufferer brakes, sinks, and ramps to idle within its
    descent time. The source ramps to idle at once. When all that is over it latches until armed.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._idle_us, self._full_us = rig.limits.pulse_us
        self._pulses = [self._idle_us, self._idle_us]  # source, sufferer
        self._targets = [self._idle_us, self._idle_us]
        self._descents_s = (rig.limits.source_descent_s, rig.limits.sufferer_descent_s)
        self._latch_s = latch_s(rig.limits)
        self._brake_us = self._sink_us = self._idle_us
        self._carriage_mps = self._carriage_target_mps = 0.0
        self._last_command_s = 0.0
        self._next_expected_s = 0.0
        self._armed = self._latched = False
        self._ramps = (False, False)  # whether each motor is on its ramp to idle
        self._missed = 0

    @property
    def status(self) -> McuStatus:
        """The report that answers a command."""
        return McuStatus(self._armed, self._latched, self._missed)

    def arm(self, t_s: float) -> None:
        """Start anew from idle; clears the latch."""
        self.disarm()
        self._armed, self._latched = True, False
        self._heard(t_s)

    def disarm(self) -> None:
        """Motors idle and carriage stopped at once."""
        self._armed = False
        self._pulses = [self._idle_us, self._idle_us]
        self._targets = [self._idle_us, self._idle_us]
        self._brake_us = self._sink_us = self._idle_us
        self._carriage_mps = self._carriage_target_mps = 0.0

    def command(
        self,
        t_s: float,
        source_us: float,
        sufferer_us: float,
        carriage_mps: float,
        brake_us: float,
        sink_us: float,
    ) -> None:
        """Take a command that arrived at `t_s`; ignored unless armed and not latched.

        With `brake_us` and `sink_us` the sufferer descends, should no other command come.
        """
        if not self._armed or self._latched:
            return
        self._heard(t_s)
        self._targets = [self._limited(source_us), self._limited(sufferer_us)]
        self._brake_us, self._sink_us = self._limited(brake_us), self._limited(sink_us)
        top = self._rig.stepper.max_speed_mps
        self._carriage_target_mps = min(max(carriage_mps, -top), top)

    def advance(self, t_s: float, dt_s: float) -> Outputs:
        """What the pins do over the step from `t_s` to `t_s + dt_s`."""
        if self._armed and not self._latched:
            self._watch(t_s)
        self._pulses = [
            _towards(now, target, self._slew(i) * dt_s)
            for i, (now, target) in enumerate(zip(self._pulses, self._targets, strict=True))
        ]
        self._carriage_mps = _towards(
            self._carriage_mps, self._carriage_target_mps, self._rig.stepper.max_accel_mps2 * dt_s
        )
        return Outputs(self._pulses[0], self._pulses[1], self._carriage_mps)

    def _heard(self, t_s: float) -> None:
        self._last_command_s, self._ramps = t_s, (False, False)
        # Half a period of grace: a command that is merely late has not been missed.
        self._next_expected_s = t_s + 1.5 * PERIOD_S

    def _watch(self, t_s: float) -> None:
        """The deadman's ladder."""
        if t_s >= self._next_expected_s:
            self._missed += 1
            self._next_expected_s += PERIOD_S
        silent_s = t_s - self._last_command_s
        if silent_s > HOLD_PERIODS * PERIOD_S:
            self._carriage_target_mps = 0.0
        descending_s = silent_s - DESCEND_PERIODS * PERIOD_S
        if descending_s > 0.0:
            self._descend(descending_s)
            self._latched = silent_s > self._latch_s

    def _descend(self, since_s: float) -> None:
        """Where the motors go without commands."""
        limits = self._rig.limits
        sinking_s = since_s - limits.brake_s
        if sinking_s <= 0.0:
            sufferer_us = self._brake_us
        elif sinking_s <= limits.sink_s:
            sufferer_us = self._limited(self._sink_us - limits.sink_rate_us_per_s * sinking_s)
        else:
            sufferer_us = self._idle_us
        self._targets = [self._idle_us, sufferer_us]
        self._ramps = (True, sinking_s > limits.sink_s)

    def _slew(self, motor: int) -> float:
        """Allowed change [µs/s]: the rig's slew, or that of a ramp to idle."""
        if self._ramps[motor]:
            return (self._full_us - self._idle_us) / self._descents_s[motor]
        return self._rig.limits.slew_us_per_s

    def _limited(self, pulse_us: float) -> float:
        return min(max(pulse_us, self._idle_us), self._full_us)


def _towards(now: float, target: float, most: float) -> float:
    return min(max(target, now - most), now + most)
