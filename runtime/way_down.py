"""The way down: by a controller while the height is known, else by a ladder of pulses.

In: each tick's estimate, mode and command. Out: the commands of a failsafe, and with every command
the pulses that the board descends with should it be the last one.
"""

import math

from runtime.blind import BlindPlanner, BlindPulses, Reckoned, ladder_pulse, on_the_stop
from runtime.controller import Command, Terms
from runtime.descent import BLINDING, Descent, descent_reference, has_landed
from runtime.pilot import Pilot, PilotState
from runtime.reference import Reference
from runtime.trim import TrimReader
from wakedeploy.rig import LOOP_RATE_HZ, Rig

DEADMAN_S = 4.0 / LOOP_RATE_HZ  # without commands, after which the board begins its own descent


class WayDown:
    """What a descent needs to know before it begins, and the descent once it has begun."""

    def __init__(self, rig: Rig, pilot: Pilot) -> None:
        self._rig, self._pilot = rig, pilot
        self._trim, self._planner, self._reckoned = TrimReader(rig), BlindPlanner(rig), Reckoned()
        self._source_us = rig.limits.pulse_us[0]
        self._descent: Descent | None = None
        self.pulses = self._planner.idle  # the board's, should the last command be the last one

    def reckon(self, state: PilotState, dt_s: float, *, believe: bool) -> None:
        """Follow a tick's estimate; with `believe` it also tells of thrust and wake."""
        now = state.estimate
        self._trim.step(now, state.wake_n, self._source_us, believe=believe and now.rejected == 0)
        trusted = math.isfinite(now.innovation_m) and now.rejected == 0 and now.jumped_m == 0.0
        self._reckoned = self._planner.reckon(
            self._reckoned, now, self._trim, dt_s, trusted=trusted
        )

    def commanded(self, command: Command, *, flies: bool) -> None:
        """A command is about to go out."""
        self._source_us = command.source_us
        descent = self._descent
        if not flies or on_the_stop(self._reckoned):
            self.pulses = self._planner.idle
        elif descent is not None and descent.blind is not None:
            self.pulses = BlindPulses(command.sufferer_us, command.sufferer_us)
        else:
            self.pulses = self._blind_after(command.sufferer_us, DEADMAN_S)

    def descend(
        self,
        state: PilotState,
        t_s: float,
        faults: tuple[str, ...],
        cause: tuple[str, ...],
        feedforward_n: float | None,
    ) -> tuple[PilotState, Reference, Command, Terms] | None:
        """One tick down, the source idle at once; None once it has landed."""
        limits, descent = self._rig.limits, self._begun(state, t_s, faults)
        aim = descent_reference(descent, t_s, limits.pulse_us[0])
        if has_landed(descent, t_s, state.estimate.z_m, limits):
            return None
        if descent.blind is None:
            gently = "commands_late" in cause
            state, command, terms = self._pilot.control(state, aim, feedforward_n, gently=gently)
        else:
            pulse_us = ladder_pulse(descent.blind, t_s - descent.start_s, limits)
            state, command, terms = self._pilot.held(state, Command(aim.source_us, pulse_us, 0.0))
        return state, aim, command, terms

    def sink(self, t_s: float) -> Command | None:
        """The command of a blind descent that asks no estimator; None once it is over."""
        limits, descent = self._rig.limits, self._descent
        if descent is None or descent.blind is None:
            last = self._reckoned
            descent = self._descent = Descent(t_s, last.z_m, last.x_m, self.pulses)
        assert descent.blind is not None
        if has_landed(descent, t_s, math.nan, limits):
            return None
        pulse_us = ladder_pulse(descent.blind, t_s - descent.start_s, limits)
        self.pulses = BlindPulses(pulse_us, pulse_us)
        return Command(limits.pulse_us[0], pulse_us, 0.0)

    def _begun(self, state: PilotState, t_s: float, faults: tuple[str, ...]) -> Descent:
        """The way down, begun anew when the height gets lost on it."""
        now, descent = state.estimate, self._descent
        is_known = BLINDING.isdisjoint(faults) and math.isfinite(now.z_m)
        if descent is None and is_known:
            descent = Descent(t_s, now.z_m, now.x_m)
        elif not is_known and (descent is None or descent.blind is None):
            last = self._reckoned
            descent = Descent(t_s, last.z_m, last.x_m, self._blind_after(state.last_us, 0.0))
        assert descent is not None
        self._descent = descent
        return descent

    def _blind_after(self, held_us: float, hold_s: float) -> BlindPulses:
        return self._planner.pulses(self._reckoned, self._trim, held_us, hold_s)
