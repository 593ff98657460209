"""The gantry in simulated time: what the loop asks of a clock, a link and a range source.

Behind them stand the MCU's decisions and the plant, stepped whenever the loop sleeps. The loop is
the one that flies at the rig; only frames and threads are left out.
"""

import math
from collections import deque

import numpy as np

from runtime.link import Answer
from runtime.mcu import Mcu
from runtime.prediction import Result
from runtime.predictor import PackagePredictor
from runtime.protocol import Arm, Command, Status
from runtime.range_source import STATUS_NO_TARGET, RangeReading
from runtime.virtual.mcu_port import battery_v, mcu_time_us, status_of
from wakedeploy.package import FloatArray
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig import Rig

COMPUTE_S = 0.001  # from reading to writing, as the loop has been timed
_MOST_JITTER_S = 0.003


class SimulatedGantry:
    """Clock, link and range source in one, around a plant; time starts at 0 with the plant's.

    `model` is the rig file of the loop, whose limits the MCU is armed with; `truth` the plant's.
    """

    failure: str | None = None

    def __init__(self, plant: GantryPlant, *, model: Rig, truth: Rig, seed: int) -> None:
        self.plant = plant
        self._model, self._truth = model, truth
        self._mcu = Mcu(model)
        self._now_s = 0.0
        self._late = np.random.default_rng(np.random.SeedSequence([seed, 2]))
        self._under_way: deque[tuple[float, int, Command]] = deque()
        self._sent_s: dict[int, float] = {}
        self._sequence = 0
        self._answer = self._answered(0, 0.0, math.nan)

    # A clock. Computing takes no time; waking up is late by the rig's clock jitter.

    def monotonic(self) -> float:
        """The present [s]."""
        return self._now_s

    def sleep(self, seconds: float, /) -> None:
        """Let the world go on."""
        jitter_s = self._truth.disturbance.clock_jitter_s * abs(float(self._late.standard_normal()))
        self._now_s += seconds + min(jitter_s, _MOST_JITTER_S)
        while self.plant.t_s + 0.5 * self.plant.dt_s < self._now_s:
            self._step()

    # A link.

    @property
    def answer(self) -> Answer:
        """The MCU's newest status."""
        return self._answer

    def arm(self, limits: Arm) -> Status:
        """Arm at once, within these pulses; the other limits are the model's, which the MCU has."""
        pulses = {"pulse_us": (limits.low_us, limits.high_us)}
        within = {"limits": self._model.limits.model_copy(update=pulses)}
        self._mcu = Mcu(self._model.model_copy(update=within))
        self._mcu.arm(self._now_s)
        self._answer = self._answered(self._sequence, self._now_s, math.nan)
        return self._answer.status

    def disarm(self) -> None:
        """Motors idle."""
        self._mcu.disarm()

    def send(self, message: Command) -> int:
        """Put a command on its way; it arrives after computing and half the round trip."""
        self._sequence += 1
        sent_s = self._now_s + COMPUTE_S
        self._sent_s[self._sequence] = sent_s
        arrives_s = sent_s + 0.5 * self._truth.latency.round_trip_s
        self._under_way.append((arrives_s, self._sequence, message))
        return self._sequence

    def greet_again(self) -> Status | None:
        """The board answers as before: it has not restarted."""
        return self._answer.status

    # A range source.

    @property
    def newest(self) -> RangeReading:
        """The newest range sample, and the truth of now."""
        sample, plant = self.plant.range_sample(), self.plant
        good = math.isfinite(sample.range_m)
        return RangeReading(
            1e3 * sample.range_m,
            int(1e6 * max(sample.sensor_time_s, 0.0)),
            0 if good else STATUS_NO_TARGET,
            plant.wake_force_n,
            plant.hook_force_n,
            plant.z_m,
        )

    def close(self) -> None:
        """Nothing to close."""

    def _step(self) -> None:
        plant = self.plant
        while self._under_way and self._under_way[0][0] <= plant.t_s:
            arrived_s, sequence, command = self._under_way.popleft()
            speed_mps = command.carriage_steps_per_s / self._truth.stepper.steps_per_m
            self._mcu.command(arrived_s, command.source_us, command.sufferer_us, speed_mps)
            trip_s = arrived_s - self._sent_s.pop(sequence)
            self._answer = self._answered(sequence, plant.t_s, trip_s)
        out = self._mcu.advance(plant.t_s, plant.dt_s)
        plant.step(out.source_us, out.sufferer_us, out.carriage_mps)

    def _answered(self, sequence: int, t_s: float, round_trip_s: float) -> Answer:
        volts = battery_v(self._truth)
        status = status_of(self._mcu.status, self.plant, sequence=sequence, boot=1, battery_v=volts)
        return Answer(status, mcu_time_us(t_s), t_s, round_trip_s)


class PackageForecast:
    """A package's predictions without a thread: they are there at once."""

    def __init__(self, predictor: PackagePredictor) -> None:
        channels = predictor.manifest.observation
        self._predictor, self.lead_s = predictor, predictor.manifest.lead_s
        self.low: FloatArray = np.array([c.min for c in channels], np.float32)  # (d,)
        self.high: FloatArray = np.array([c.max for c in channels], np.float32)  # (d,)

    def step(self, observation: FloatArray, deadline_s: float) -> Result | None:
        """The force for an observation (d,)."""
        force_n = float(self._predictor.step(observation)[0])
        return Result(force_n, self._predictor.ready)

    def reset(self) -> None:
        """Forget what was observed."""
        self._predictor.reset()


class OracleForecast:
    """The wake's true force, `lead_s` from now; it knows no bounds and needs no memory."""

    low: FloatArray = np.full(1, -np.inf, np.float32)
    high: FloatArray = np.full(1, np.inf, np.float32)

    def __init__(self, plant: GantryPlant, lead_s: float) -> None:
        self._plant, self.lead_s = plant, lead_s

    def step(self, observation: FloatArray, deadline_s: float) -> Result | None:
        """The true force; the observation is not looked at."""
        return Result(self._plant.wake_force_ahead(self.lead_s), ready=True)

    def reset(self) -> None:
        """There is nothing to forget."""
