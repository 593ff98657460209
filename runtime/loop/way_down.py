"""The way down: by a controller while the height is known, else by a ladder of pulses.

In: each tick's estimate, mode and command. Out: the commands of a failsafe, and with every command
the pulses for the board's own descent, should that command be the last one.
"""

import math

import numpy as np

from runtime.loop.blind import (
    UNSEEN_RISE_M,
    BlindPlanner,
    BlindPulses,
    Reckoned,
    Rise,
    ladder_pulse,
    ladder_s,
    on_the_stop,
)
from runtime.loop.controller import Command, Terms
from runtime.loop.copies import replace
from runtime.loop.descent import (
    BLINDING,
    HEIGHTLESS,
    SWINGING,
    Descent,
    descent_reference,
    has_landed,
    is_down,
    limit_s,
)
from runtime.loop.estimate import Measurement
from runtime.loop.pilot import Pilot, PilotState
from runtime.loop.safety import UNEXPLAINED_SD_N
from runtime.loop.settling import TEST_SHARE, Settling, Stage, begun, is_off, settled
from runtime.loop.silent_faults import may_repeat
from runtime.loop.trim import TrimReader
from runtime.reference import Reference
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.physics.effects.chain import unplaced_constants

OFF_THE_LINE_M = 0.15  # from a descent's line: after a pause, a descent this far off begins anew
HOVER_S = 1.0  # the thrust of a flight is averaged over this
FREE_M, LIFTING_S = 0.1, 0.3  # above the first, what lifts is averaged over the second
# The very same for longer than any sensor holds a reading, while the forces moved it this far: the
# sensor is frozen, and what the forces say is still good.
FROZEN_TICKS, FROZEN_MOVED_M = 8, 0.05
# Faults of a noisy sensor. For this long the forces alone say where the sufferer is.
NOISE, LONG_UNCALM_S = frozenset({"sensor_noisy", "sensor_jump"}), 1.5
# Commands that act this much too late control nothing: the forces alone say where the sufferer is
# by then, and no height is waited for.
BLIND_LATE_S = 0.12
UNSEEN_SHARE = 0.99  # of the weight: between two tests of a touch-down, if no motion is seen
DEADMAN_S = 4.0 / LOOP_RATE_HZ  # without commands, after which the board begins its own descent


class WayDown:
    """What a descent needs to know before it begins, and the descent once it has begun."""

    def __init__(self, rig: Rig, pilot: Pilot) -> None:
        self._rig, self._pilot = rig, pilot
        self._trim, self._planner, self._reckoned = TrimReader(rig), BlindPlanner(rig), Reckoned()
        self._calm, self._uncalm_s = Reckoned(), 0.0  # by the forces since the sensor surprises
        self._source_us = self._last_us = rig.limits.pulse_us[0]
        self._descent: Descent | None = None
        self._rise, self._settling = Rise(), Settling(0.0, 0.0)
        self._range_bias_m = unplaced_constants(rig)["range.bias_m"]
        self._may_repeat, self._ladder = may_repeat(rig), self._planner.idle
        self._is_settling, self._lifting_n = False, 0.0
        self._seen_n = 0.0  # what lifted it when it was last seen off the stop in a touch-down
        self._hover_n = math.inf
        self.late_s = 0.0  # by which commands act late
        self.unexplained_s = 0.0  # since an unexplained force began to swing
        self._froze_m = 0.0  # where the sufferer was when the sensor began to say the same
        self._moves_unseen = False
        self.pulses = self._planner.idle  # the board's own, should the last command be the last one

    @property
    def unexplained_sd_n(self) -> float:
        """How much an unexplained force [N] swings."""
        return self._trim.unexplained_sd_n

    @property
    def rises_unseen(self) -> bool:
        """Whether it should have risen from the stop but is not seen to."""
        return self._rise.is_unseen

    @property
    def moves_unseen(self) -> bool:
        """Whether it should have moved in the air while the sensor said the very same."""
        return self._moves_unseen

    def without_the_last_samples(self, state: PilotState) -> PilotState:
        """The state by the forces alone, if samples have only been repeated."""
        now, reckoned, trim = state.estimate, self._reckoned, self._trim
        force_n = trim.trim.thrust_n + trim.wake_n(reckoned.x_m, reckoned.z_m, 0.0, math.inf)
        height = np.array([reckoned.z_m, reckoned.vz_mps, force_n - (state.wake_n or 0.0)])
        return replace(state, estimate=replace(now, height=height))

    def reckon(
        self, state: PilotState, measured: Measurement, dt_s: float, *, believe: bool
    ) -> None:
        """Follow a tick's estimate; with `believe`, learn thrust and wake from it, too."""
        now = state.estimate
        self._trim.step(now, state.wake_n, self._source_us, believe=believe and now.rejected == 0)
        trusted = math.isfinite(now.innovation_m) and now.rejected == 0 and now.jumped_m == 0.0
        trusted &= measured.same == 0
        self._reckoned = self._planner.reckon(
            self._reckoned, now, self._trim, dt_s, trusted=trusted
        )
        is_calm = trusted and now.is_calm
        self._calm = self._planner.reckon(self._calm, now, self._trim, dt_s, trusted=is_calm)
        self._uncalm_s = 0.0 if is_calm else self._uncalm_s + dt_s
        if measured.same == 0:
            self._froze_m = self._reckoned.z_m
        moved_m = abs(self._reckoned.z_m - self._froze_m)
        self._moves_unseen |= believe and measured.same >= FROZEN_TICKS and moved_m > FROZEN_MOVED_M
        swings = self._trim.unexplained_sd_n > UNEXPLAINED_SD_N
        self.unexplained_s = self.unexplained_s + dt_s if swings else 0.0
        if now.z_m > FREE_M:
            # On the stop, the stop's own push would count. A wake leaves with the source.
            share = -math.expm1(-dt_s / LIFTING_S)
            self._lifting_n += share * (state.unexplained_n - self._lifting_n)
            self._lifting_n = max(self._lifting_n, self._trim.trim.thrust_n)
            thrust_n = now.rotor_speed**2
            before_n = self._hover_n if math.isfinite(self._hover_n) else thrust_n
            self._hover_n = before_n - math.expm1(-dt_s / HOVER_S) * (thrust_n - before_n)
        if believe:
            self._rise = self._planner.rise(self._rise, now, measured.alike, self._trim, dt_s)

    def commanded(self, command: Command, *, flies: bool) -> None:
        """Note a command that is about to go out."""
        self._source_us, self._last_us = command.source_us, command.sufferer_us
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
        measured: Measurement,
        faults: tuple[str, ...],
        cause: tuple[str, ...],
        feedforward_n: float | None,
    ) -> tuple[PilotState, Reference, Command, Terms] | None:
        """One tick down, the source idle at once; None once it has landed."""
        limits, t_s = self._rig.limits, measured.t_s
        descent = self._begun(state, t_s, faults)
        aim = descent_reference(descent, t_s, limits.pulse_us[0])
        if descent.blind is not None:
            if has_landed(descent, t_s, limits):
                return None
            pulse_us = ladder_pulse(descent.blind, t_s - descent.start_s, limits)
        elif self._is_settling or is_down(descent, t_s, state.estimate.z_m):
            settling_us = self.settle(state, measured)
            if settling_us is None:
                return None
            pulse_us = settling_us
        elif "link_lost" in faults:
            # What gets through has to agree with what the board does by itself.
            pulse_us = self._planner.sinking(state.estimate, state.unexplained_n)
        else:
            gently = not SWINGING.isdisjoint(cause)
            state, command, terms = self._pilot.control(
                state,
                aim,
                feedforward_n,
                gently=gently,
                acts_known="commands_late" not in cause,
            )
            return state, aim, command, terms
        state, command, terms = self._pilot.held(state, Command(aim.source_us, pulse_us, 0.0))
        return state, aim, command, terms

    def settle(self, state: PilotState, measured: Measurement) -> float | None:
        """The pulse [µs] of one tick of a touch-down; None once the sufferer stands."""
        if not self._is_settling:
            self._is_settling, self._settling = True, begun(state.estimate, measured.t_s)
        limits, before = self._rig.limits, self._settling.stage
        is_new = measured.range_repeats == 0
        self._settling = now = settled(
            self._settling,
            measured.t_s,
            measured.range_m - self._range_bias_m if is_new else math.nan,
            ladder_s=ladder_s(limits),
            may_repeat=self._may_repeat,
            off=is_off(state.estimate),
        )
        if before is Stage.TEST and now.stage is Stage.SINK and is_off(state.estimate):
            # It left the stop in a test: something lifts that no flight before has shown.
            self._lifting_n = max(self._lifting_n, state.unexplained_n)
        if now.stage is Stage.STANDS:
            return None
        if now.stage is Stage.BLIND:
            if before is not Stage.BLIND:
                self._ladder = self._planner.pulses(
                    self._reckoned, self._trim, self._last_us, 0.0, height_known=False
                )
            return ladder_pulse(self._ladder, measured.t_s - now.stage_s, limits)
        if self._settling.stage is Stage.TEST:
            return self._planner.carried(TEST_SHARE, self._lifting_n, self._hover_n)
        if not is_off(state.estimate):
            # Nothing shows its speed: if a sensor drifted to the stop it may already be falling.
            other_n = max(self._lifting_n, self._seen_n)
            return self._planner.carried(UNSEEN_SHARE, other_n, self._hover_n)
        share = -math.expm1(-1.0 / (LIFTING_S * LOOP_RATE_HZ))
        self._seen_n += share * (state.unexplained_n - self._seen_n)
        return self._planner.sinking(state.estimate, max(self._lifting_n, state.unexplained_n))

    def sink(self, t_s: float) -> Command | None:
        """The command of a blind descent that asks no estimator; None once it is over."""
        limits, descent = self._rig.limits, self._descent
        if descent is None or descent.blind is None:
            last = self._reckoned
            ends_s = t_s + ladder_s(limits)
            descent = self._descent = Descent(t_s, last.z_m, last.x_m, ends_s, self.pulses)
        assert descent.blind is not None
        if has_landed(descent, t_s, limits):
            return None
        pulse_us = ladder_pulse(descent.blind, t_s - descent.start_s, limits)
        self.pulses = BlindPulses(pulse_us, pulse_us)
        return Command(limits.pulse_us[0], pulse_us, 0.0)

    def _begun(self, state: PilotState, t_s: float, faults: tuple[str, ...]) -> Descent:
        """The way down; it begins anew if the height gets lost on it, or after a pause."""
        now, descent = state.estimate, self._descent
        is_known = BLINDING.isdisjoint(faults) and math.isfinite(now.z_m)
        is_known &= not self._is_too_late(faults)
        if descent is not None and descent.blind is not None:
            return descent
        if not is_known:
            self._descent = descent = self._blind_descent(state, t_s, faults)
        elif descent is None or abs(descent.line_m(t_s) - now.z_m) > OFF_THE_LINE_M:
            ends_s = limit_s(t_s, now.z_m) if descent is None else descent.limit_s
            self._descent = descent = Descent(t_s, now.z_m, now.x_m, ends_s)
        return descent

    def _is_too_late(self, faults: tuple[str, ...]) -> bool:
        return "commands_late" in faults and self.late_s > BLIND_LATE_S

    def _blind_descent(self, state: PilotState, t_s: float, faults: tuple[str, ...]) -> Descent:
        last = self._reckoned
        if "height_impossible" in faults:  # what carries it now goes on carrying it
            held = BlindPulses(state.last_us, state.last_us)
            return Descent(t_s, last.z_m, last.x_m, t_s + ladder_s(self._rig.limits), held)
        if not NOISE.isdisjoint(faults) and self._uncalm_s < LONG_UNCALM_S:
            last = self._calm
        has_risen = self._rise.is_unseen
        if has_risen:
            last = replace(last, z_m=last.z_m + UNSEEN_RISE_M, vz_mps=self._rise.likely_mps)
        blind = self._planner.pulses(
            last,
            self._trim,
            state.last_us,
            self.late_s if self._is_too_late(faults) else 0.0,
            height_known=has_risen or self._moves_unseen or HEIGHTLESS.isdisjoint(faults),
        )
        return Descent(t_s, last.z_m, last.x_m, t_s + ladder_s(self._rig.limits), blind)

    def _blind_after(self, held_us: float, hold_s: float) -> BlindPulses:
        return self._planner.pulses(self._reckoned, self._trim, held_us, hold_s)
