"""One tick of the gantry's loop as pure steps: estimate → observe → (predict) → control.

`runtime.loop.loop` calls them in this order, at the rig and in simulated flights; only where
measurements come from and how long a prediction may take differ. A tick's row of the run log is
made here, too.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from runtime.loop.controller import Command, Controller, ControlState, Terms
from runtime.loop.copies import replace
from runtime.loop.estimate import Estimate, Measurement, initial_estimate
from runtime.loop.estimator import Estimator
from runtime.reference import Reference
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.physics.effects.chain import default_lead_s

OBSERVATION = (
    ("dx_m", "m"),
    ("dz_m", "m"),
    ("vx_mps", "m/s"),
    ("vz_mps", "m/s"),
    ("source_command", "1"),
)
FORCE = (("force_z_n", "N"),)

LogValue = float | int | str | None


@dataclass(frozen=True, slots=True, eq=False)
class PilotState:
    """What is carried from tick to tick: the estimate, the controller, the last two commands."""

    estimate: Estimate
    control: ControlState
    last_us: float  # the sufferer's pulse widths of the last tick …
    before_last_us: float  # … and of the one before
    forecasts: tuple[
        tuple[float, float], ...
    ] = ()  # (when it acts [s], wake force [N]), oldest first
    wake_n: float | None = None  # the wake's force that was forecast for now and fed forward

    @property
    def unexplained_n(self) -> float:
        """The force [N] that neither thrust, weight nor friction explains."""
        return self.estimate.disturbance_n + (self.wake_n or 0.0)


class Pilot:
    """The steps of a tick for one rig; `lead_s` is how far ahead its forecasts reach."""

    def __init__(self, rig: Rig, lead_s: float = 0.0) -> None:
        self.rig, self.lead_s = rig, lead_s
        self.preview_s = default_lead_s(rig)  # an acceleration is wanted when its command acts
        self._estimator = Estimator(rig)
        self._controller = Controller(rig, 1.0 / LOOP_RATE_HZ)

    def initial(self, t_s: float) -> PilotState:
        """The state at rest on the stop: carriage homed, motors idle."""
        idle_us = self.rig.limits.pulse_us[0]
        return PilotState(initial_estimate(t_s), self._controller.initial(), idle_us, idle_us)

    def estimate(self, state: PilotState, measured: Measurement) -> PilotState:
        """Take in a measurement, with the commands and the wake forecast for this time."""
        pulses = (state.before_last_us, state.last_us)
        acting = [force_n for due_s, force_n in state.forecasts if due_s <= measured.t_s]
        wake_n = acting[-1] if acting else None
        estimate = self._estimator.step(state.estimate, measured, pulses, wake_n)
        return replace(
            state,
            estimate=estimate,
            forecasts=state.forecasts[max(len(acting) - 1, 0) :],
            wake_n=wake_n,
        )

    def spared(self, state: PilotState, aim: Reference) -> Reference:
        """The aim, with an idle source while thrust is too little beside its wake."""
        if not state.control.spared_ticks:
            return aim
        return replace(aim, source_us=self.rig.limits.pulse_us[0])

    def observe(self, state: PilotState, aim: Reference) -> npt.NDArray[np.float32]:
        """What the predictor sees, (5,) float32: `OBSERVATION`, source minus sufferer."""
        now = state.estimate
        return observation(self.rig, now.x_m, now.z_m, now.vx_mps, now.vz_mps, aim.source_us)

    def control(
        self,
        state: PilotState,
        aim: Reference,
        feedforward_n: float | None,
        *,
        gently: bool = False,
        acts_known: bool = True,
    ) -> tuple[PilotState, Command, Terms]:
        """The command for this tick, with `feedforward_n` added to the thrust demand.

        The feedforward is the opposite of the wake force expected `lead_s` from now. None flies by
        PID alone and makes the estimator expect any wake. For `gently` and `acts_known` see the
        controller.
        """
        control, command, terms = self._controller.step(
            state.control,
            state.estimate,
            aim,
            feedforward_n or 0.0,
            other_n=state.unexplained_n,
            gently=gently,
            acts_known=acts_known,
        )
        forecasts = (
            ()
            if feedforward_n is None
            else (
                *state.forecasts,
                (state.estimate.t_s + self.lead_s, -feedforward_n),
            )
        )
        return self._sent(replace(state, forecasts=forecasts), control, command), command, terms

    def rest(self, state: PilotState) -> tuple[PilotState, Command, Terms]:
        """The command of a tick at rest: motors idle, the carriage on its way home."""
        command = self.homing(state)
        after = self._sent(replace(state, forecasts=()), self._controller.initial(), command)
        return after, command, Terms(0.0, 0.0, 0.0, 0.0)

    def homing(self, state: PilotState) -> Command:
        """Motors idle, the carriage on its way home."""
        idle_us = self.rig.limits.pulse_us[0]
        homing_mps = -self.rig.control.carriage_gain_per_s * state.estimate.x_m
        return Command(idle_us, idle_us, homing_mps)

    def drive(self, state: PilotState, aim: Reference) -> tuple[PilotState, Command, Terms]:
        """The command of a tick in which only the carriage moves: motors idle."""
        idle_us = self.rig.limits.pulse_us[0]
        command = Command(idle_us, idle_us, self._controller.carriage_mps(state.estimate, aim))
        after = self._sent(replace(state, forecasts=()), self._controller.initial(), command)
        return after, command, Terms(0.0, 0.0, 0.0, 0.0)

    def held(self, state: PilotState, command: Command) -> tuple[PilotState, Command, Terms]:
        """A command that no controller made, as on a blind way down."""
        after = self._sent(replace(state, forecasts=()), self._controller.initial(), command)
        return after, command, Terms(0.0, 0.0, 0.0, 0.0)

    def _sent(self, state: PilotState, control: ControlState, command: Command) -> PilotState:
        return replace(
            state,
            control=control,
            last_us=command.sufferer_us,
            before_last_us=state.last_us,
        )


def observation(
    rig: Rig, x_m: float, z_m: float, vx_mps: float, vz_mps: float, source_us: float
) -> npt.NDArray[np.float32]:
    """One observation, (5,) float32, from estimated motion and the source's command."""
    throttle = rig.thrust.source.throttle(source_us)
    return np.array([-x_m, rig.source.height_m - z_m, vx_mps, vz_mps, throttle], dtype=np.float32)


def resting_reference(rig: Rig) -> Reference:
    """The aim of a tick at rest."""
    return Reference(0.0, 0.0, 0.0, 0.0, 0.0, rig.limits.pulse_us[0])


def tick_row(
    tick: int,
    measured: Measurement,
    state: PilotState,
    aim: Reference,
    command: Command,
    terms: Terms,
) -> dict[str, LogValue]:
    """The run log's columns that the pure steps know; the caller adds link, timing and mode."""
    now = state.estimate
    return {
        "tick": tick,
        "t_s": measured.t_s,
        "range_m": finite_or_none(measured.range_m),
        "range_age_s": finite_or_none(measured.range_age_s),
        "range_repeats": measured.range_repeats,
        "steps": measured.steps,
        "x_m": now.x_m,
        "vx_mps": now.vx_mps,
        "z_est_m": now.z_m,
        "vz_est_mps": now.vz_mps,
        "innovation_m": finite_or_none(now.innovation_m),
        "innovation_var_m2": finite_or_none(now.innovation_var_m2),
        "z_ref_m": aim.z_m,
        "x_ref_m": aim.x_m,
        "feedforward_n": terms.feedforward_n,
        "pid_p_n": terms.p_n,
        "pid_i_n": terms.i_n,
        "pid_d_n": terms.d_n,
        "source_cmd_us": command.source_us,
        "sufferer_cmd_us": command.sufferer_us,
    }


def finite_or_none(value: float) -> float | None:
    """A number of a row; None in the place of NaN and infinity."""
    return value if math.isfinite(value) else None
