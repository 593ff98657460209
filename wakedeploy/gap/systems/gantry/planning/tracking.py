"""What ignoring an effect costs in tracking: simulated flights with it and without it.

In: a rig, an effect's values. Out: the height error's RMSE. The controller flies as at the rig: PID
on height and, fed forward, the wake force that the rig file predicts from the source's commands.
The rig file does not know the effect; the plant has it.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np

from runtime.loop.loop import Loop
from runtime.loop.pilot import OBSERVATION
from runtime.loop.prediction_worker import Result
from runtime.reference import random_plan
from runtime.simulated import SimulatedGantry
from wakedeploy.core.manifest import FloatArray
from wakedeploy.core.rig import LOOP_RATE_HZ, EffectParameter, Rig
from wakedeploy.core.rig import Effect as Entry
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.physics.jet import VerticalJet, drag_force
from wakedeploy.physics.motor import Motor

CONTROLLER = "PID with the wake force that the rig file predicts from the source's commands"
_STEPS_PER_TICK = 2  # puffs this close still overlap


class RigForecast:
    """The wake force that a rig file predicts, as feedforward: a predictor without training."""

    low: FloatArray = np.full(len(OBSERVATION), -np.inf, np.float32)
    high: FloatArray = np.full(len(OBSERVATION), np.inf, np.float32)

    def __init__(self, rig: Rig) -> None:
        self._rig, self.lead_s = rig, default_lead_s(rig)
        self.reset()

    def is_possible(self, force_n: float) -> bool:
        """Always true: the rig file's predictions are possible forces."""
        return True

    def reset(self) -> None:
        """Start from still air and an idle source."""
        dt_s = 1.0 / LOOP_RATE_HZ / _STEPS_PER_TICK
        self._motor = Motor(self._rig.thrust.source, self._rig.spool.source)
        self._jet = VerticalJet(self._rig.wake, self._rig.source.height_m, dt_s)
        self._dt_s = dt_s
        # A command reaches the source in the middle of its tick: the way, then the servo frame.
        self._commands = deque([0.0, 0.0], maxlen=2)

    def step(self, observation: FloatArray, deadline_s: float) -> Result | None:
        """The force [N] `lead_s` from now for an observation (5,) of `runtime.loop.pilot`."""
        for throttle in self._commands:
            low, high = self._rig.thrust.source.pulse_us[0], self._rig.thrust.source.pulse_us[-1]
            self._motor.set_pulse(low + throttle * (high - low))
            self._jet.inject(self._motor.step(self._dt_s))
        self._commands.append(float(observation[4]))
        x_m, z_m = -float(observation[0]), self._rig.source.height_m - float(observation[1])
        x_m += self.lead_s * float(observation[2])
        z_m = max(0.0, z_m + self.lead_s * float(observation[3]))
        air_mps = self._jet.velocity_ahead(x_m, z_m, self.lead_s)
        return Result(drag_force(self._rig.wake, 0.0, air_mps), ready=True)


def with_effect(rig: Rig, name: str, values: Sequence[float]) -> Rig:
    """The rig with a library effect at these values, ordered as its parameters."""
    parameters = {
        p.name: EffectParameter(value=value, unit=p.unit)
        for p, value in zip(LIBRARY[name].parameters, values, strict=True)
    }
    kept = tuple(entry for entry in rig.effect if entry.name != name)
    return rig.model_copy(update={"effect": (*kept, Entry(name=name, parameters=parameters))})


def tracking_rmse_m(truth: Rig, rig: Rig, *, seconds: float, seed: int) -> float:
    """RMSE of the true height [m] over one random flight of `rig` on the plant `truth`.

    Infinite if a failsafe ends the flight.
    """
    plant = GantryPlant(truth, seed=seed)
    world = SimulatedGantry(plant, truth=truth, seed=seed)
    plan = random_plan(rig, seconds, seed)
    loop = Loop(rig, world, world, plan, RigForecast(rig), None, world)
    tally = loop.run()
    return tally.true_rmse_m if tally.ended == "whole" else float("inf")
