"""The gantry in simulated time: what the loop asks of a clock, a link and a range source.

Behind them stand the board and the plant, stepped in lockstep with the loop whenever it sleeps or
waits. The loop is the one that flies at the rig, and so are the bytes on the wire; only threads and
waiting are left out. What happens is a function of rig, seed and package.
"""

import math
from collections.abc import Callable

import numpy as np

from runtime.flyable import Predicting
from runtime.io.conversation import Conversation
from runtime.io.protocol import Command, Message
from runtime.io.range_source import STATUS_NO_TARGET, RangeReading
from runtime.loop.pilot import OBSERVATION
from runtime.loop.prediction_worker import Result, predicted
from runtime.virtual.firmware_port import FirmwarePort
from runtime.virtual.mcu_port import McuPort
from wakedeploy.core.manifest import FloatArray
from wakedeploy.core.rig import Rig
from wakedeploy.physics.gantry import GantryPlant

COMPUTE_S = 0.001  # from reading to writing, as the loop has been timed
_MOST_JITTER_S = 0.003


class SimulatedGantry(Conversation):
    """Clock, link and range source in one, around a plant; time starts at 0 with the plant's.

    `truth` is the plant's rig, `port` the board (default: the one in Python, ready at once). The
    board has been greeted and may be armed; the one in Python takes no time for that, so that the
    plant has not moved yet.
    """

    def __init__(
        self,
        plant: GantryPlant,
        *,
        truth: Rig,
        seed: int,
        port: McuPort | FirmwarePort | None = None,
    ) -> None:
        super().__init__("the virtual gantry")
        self.plant = plant
        self._jitter_s = truth.disturbance.clock_jitter_s
        self._board = port if port is not None else McuPort(truth, boot_s=0.0)
        self._present_s = 0.0
        self._late = np.random.default_rng(np.random.SeedSequence([seed, 2]))
        self._board.opened(0.0)
        self.handshake()

    # A clock. Computing takes no time; waking up is late by the rig's clock jitter.

    def monotonic(self) -> float:
        """The present [s]."""
        return self._present_s

    def sleep(self, seconds: float, /) -> None:
        """Let the world go on."""
        jitter_s = self._jitter_s * abs(float(self._late.standard_normal()))
        self._let_pass(seconds + min(jitter_s, _MOST_JITTER_S))

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

    # A wire.

    def _now_s(self) -> float:
        return self._present_s

    def _leaves_s(self, message: Message) -> float:
        return self._present_s + (COMPUTE_S if isinstance(message, Command) else 0.0)

    def _transmit(self, data: bytes, message: Message) -> None:
        # Between flights nobody waits for the wire, so that a log begins with its plant.
        at_once = not isinstance(message, Command)
        self._board.receive(self._leaves_s(message), data, at_once=at_once)

    def _wait(self, until: Callable[[], object], limit_s: float) -> None:
        end_s = self._present_s + limit_s
        self._hear(self._present_s)
        while not until() and self._present_s < end_s:
            self._let_pass(self.plant.dt_s)
            self._hear(self._present_s)

    def _let_pass(self, seconds: float) -> None:
        plant = self.plant
        self._present_s += seconds
        while plant.t_s + 0.5 * plant.dt_s < self._present_s:
            self._hear(plant.t_s)
            out = self._board.advance(plant.t_s, plant.dt_s)
            plant.step(out.source_us, out.sufferer_us, out.carriage_mps)

    def _hear(self, t_s: float) -> None:
        """What the board has said by now; the way back takes no time."""
        while (due_s := self._board.due_s) < t_s:
            self._heard(self._board.answer(due_s, self.plant), due_s)
        if data := self._board.answer(t_s, self.plant):
            self._heard(data, t_s)


class PackageForecast:
    """A package's predictions without a thread: they are there at once."""

    def __init__(self, predictor: Predicting) -> None:
        channels = predictor.manifest.observation
        self._predictor, self.lead_s = predictor, predictor.manifest.lead_s
        self.low: FloatArray = np.array([c.min for c in channels], np.float32)  # (d,)
        self.high: FloatArray = np.array([c.max for c in channels], np.float32)  # (d,)

    def step(self, observation: FloatArray, deadline_s: float) -> Result | None:
        """The force for an observation (d,)."""
        return predicted(self._predictor, observation)

    def is_possible(self, force_n: float) -> bool:
        """Whether training has shown that a force [N] can be."""
        return self._predictor.manifest.force[0].is_possible(force_n)

    def reset(self) -> None:
        """Forget what was observed."""
        self._predictor.reset()


class OracleForecast:
    """The wake's true force, `lead_s` from now; it knows no bounds and needs no memory."""

    low: FloatArray = np.full(len(OBSERVATION), -np.inf, np.float32)
    high: FloatArray = np.full(len(OBSERVATION), np.inf, np.float32)

    def __init__(self, plant: GantryPlant, lead_s: float) -> None:
        self._plant, self.lead_s = plant, lead_s

    def step(self, observation: FloatArray, deadline_s: float) -> Result | None:
        """The true force; the observation is not looked at."""
        return Result(self._plant.wake_force_ahead(self.lead_s), ready=True)

    def is_possible(self, force_n: float) -> bool:
        """The truth always is."""
        return True

    def reset(self) -> None:
        """There is nothing to forget."""
