"""A simulated gantry with slots for faults: in plant, board, wire, sensor, clock and predictor.

An empty slot changes nothing: a flight without a fault is one of `runtime.simulated`.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from runtime.io.protocol import Command, FrameDecoder, Status, encode_frame
from runtime.io.range_source import RangeReading
from runtime.loop.pilot import LogValue
from runtime.loop.prediction_worker import Predictions, Result
from runtime.simulated import SimulatedGantry
from runtime.virtual.mcu import Outputs
from runtime.virtual.mcu_port import BOOT_S, McuPort
from wakedeploy.core.manifest import FloatArray
from wakedeploy.core.rig import Rig
from wakedeploy.core.rig_sections import SpoolLag
from wakedeploy.physics.gantry import GantryPlant

LONGEST_S = 150.0  # of simulated time; a loop that has not ended by then never will

Delayed = list[tuple[float, bytes]]  # pieces of a wire's bytes, each with its delay [s]


class Endless(BaseException):
    """The loop did not end; no handler of the loop's own may catch this."""


@dataclass(frozen=True, slots=True)
class Contact:
    """The sufferer met a stop: when [s], which one, how fast [m/s]."""

    t_s: float
    stop: str
    speed_mps: float


class FaultyPlant(GantryPlant):
    """A plant whose parts can change in flight, and that keeps all contacts with stops."""

    def __init__(self, rig: Rig, *, seed: int, wake_factor: float = 1.0) -> None:
        super().__init__(rig, seed=seed, force_hook=self._pushed, command_hook=self._driven)
        self._usual_wake_factor = wake_factor
        self.contacts: list[Contact] = []
        self.before_step: Callable[[float], None] = lambda t_s: None
        self.after_step: Callable[[float], None] = lambda t_s: None
        self._whole = (self._body.mass_kg, self._body.rail, self._sufferer.lag)
        self.reach_m = 0.0
        self.restore()

    def restore(self) -> None:
        """Empty every slot."""
        self.push_n = 0.0
        self.wake_factor = self._usual_wake_factor
        self.source_share: Callable[[float], float] = lambda t_s: 1.0  # of the thrust that is asked
        self.sufferer_share: Callable[[float], float] = lambda t_s: 1.0
        self.drive: Callable[[float, float], tuple[float, float]] | None = None
        self._body.mass_kg, self._body.rail, self._sufferer.lag = self._whole

    def scale_friction(self, factor: float) -> None:
        """All of the rail's friction changes by a factor."""
        rail = self._body.rail
        self._body.rail = rail.model_copy(
            update={name: factor * value for name, value in rail.model_dump().items()}
        )

    def scale_mass(self, factor: float) -> None:
        """The sufferer's mass changes by a factor."""
        self._body.mass_kg *= factor

    def scale_lag(self, factor: float) -> None:
        """The sufferer's motor follows more slowly by a factor."""
        lag = self._sufferer.lag
        self._sufferer.lag = SpoolLag(up_s=factor * lag.up_s, down_s=factor * lag.down_s)

    def step(self, source_us: float, sufferer_us: float, carriage_mps: float) -> None:
        """One inner step, and a look whether a stop was met in it."""
        self.before_step(self.t_s)
        z_m, vz_mps = self.z_m, self.vz_mps
        super().step(source_us, sufferer_us, carriage_mps)
        self.reach_m = max(self.reach_m, abs(self.x_m))
        if self.z_m <= 0.0 < z_m:
            self.contacts.append(Contact(self.t_s, "lower", -vz_mps))
        elif self.z_m >= self._body.travel_m > z_m:
            self.contacts.append(Contact(self.t_s, "upper", vz_mps))
        self.after_step(self.t_s)

    def _pushed(self, t_s: float, state: Mapping[str, float]) -> float:
        return self.push_n

    def _driven(
        self, t_s: float, source_us: float, sufferer_us: float, dt_s: float
    ) -> tuple[float, float]:
        return (
            (source_us, sufferer_us) if self.drive is None else self.drive(source_us, sufferer_us)
        )

    def _apply(self, source_us: float, sufferer_us: float) -> None:
        super()._apply(source_us, sufferer_us)
        self._source.target *= math.sqrt(self.source_share(self.t_s))
        self._sufferer.target *= math.sqrt(self.sufferer_share(self.t_s))

    def _wake_force(self) -> float:
        return self.wake_factor * super()._wake_force()


class FaultyPort(McuPort):
    """A board and its wire: bytes can be lost, late or damaged, statuses wrong, pins stuck."""

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig, boot_s=0.0)
        self._coming: deque[tuple[float, bytes]] = deque()
        self.restore()

    def restore(self) -> None:
        """Empty every slot."""
        self.to_board: Callable[[bytes], Delayed] = untouched
        self.to_host: Callable[[bytes], Delayed] = untouched
        self.status: Callable[[Status], Status] | None = None
        self.outputs: Callable[[Outputs, float], Outputs] | None = None

    def reboot(self, t_s: float) -> None:
        """Restart as an UNO does: no pulses, and deaf until its bootloader is done."""
        self.opened(t_s + BOOT_S)

    def receive(self, t_s: float, data: bytes, *, at_once: bool = False) -> None:
        """Bytes from the host, as the wire leaves them."""
        for late_s, piece in self.to_board(data):
            super().receive(t_s + late_s, piece, at_once=at_once)

    @property
    def due_s(self) -> float:
        """When the next frame or the next answer arrives."""
        return min(super().due_s, self._coming[0][0] if self._coming else math.inf)

    def answer(self, t_s: float, plant: GantryPlant) -> bytes:
        """The answers that arrive at the host by now."""
        if data := super().answer(t_s, plant):
            changed = data if self.status is None else self._changed(data, self.status)
            self._coming += [(t_s + late_s, piece) for late_s, piece in self.to_host(changed)]
        arrived = b""
        while self._coming and self._coming[0][0] <= t_s:
            arrived += self._coming.popleft()[1]
        return arrived

    def advance(self, t_s: float, dt_s: float) -> Outputs:
        """What the pins do over the next step."""
        out = super().advance(t_s, dt_s)
        return out if self.outputs is None else self.outputs(out, dt_s)

    @staticmethod
    def _changed(data: bytes, change: Callable[[Status], Status]) -> bytes:
        frames = [
            replace(frame, message=change(frame.message))
            if isinstance(frame.message, Status)
            else frame
            for frame in FrameDecoder().feed(data)
        ]
        return b"".join(encode_frame(frame) for frame in frames)


class FaultyGantry(SimulatedGantry):
    """Clock, link and range source in one; each use of them is a stage at which a fault can act."""

    plant: FaultyPlant

    def __init__(self, truth: Rig, *, seed: int, wake_factor: float = 1.0) -> None:
        self._samples: deque[tuple[float, RangeReading]] = deque()
        self.board = FaultyPort(truth)
        self._restore_own()
        self.ranges = FaultyRanges(self)
        plant = FaultyPlant(truth, seed=seed, wake_factor=wake_factor)
        super().__init__(plant, truth=truth, seed=seed, port=self.board)
        self._last_sample = plant.range_sample()
        self.sample = self._sensed = super().newest
        self.on_step: Callable[[float], None] = lambda t_s: None
        plant.before_step, plant.after_step = self._before_step, self._look

    def restore(self) -> None:
        """Empty every slot, those of board and plant too."""
        self._restore_own()
        self.board.restore()
        self.ranges.failure = None
        self.plant.restore()

    def _restore_own(self) -> None:
        self.before: dict[str, Callable[[], None]] = {}  # what comes before a stage of the tick
        self.sense: Callable[[RangeReading, float], list[tuple[float, RangeReading]]] | None = None
        self.wakes_late_s = 0.0

    def stage(self, name: str) -> None:
        """A stage of the tick begins."""
        if name in self.before:
            self.before[name]()

    def stand_still(self, seconds: float) -> None:
        """The computer does nothing while the world goes on."""
        super().sleep(seconds)

    def sleep(self, seconds: float, /) -> None:
        """Let the world go on; a computer that is late wakes up late."""
        super().sleep(seconds + self.wakes_late_s)

    def break_port(self) -> None:
        """The port is gone, as when a cable is pulled."""
        self._failure = "the connection to the board was lost"

    @property
    def newest(self) -> RangeReading:
        """The newest sample as the sensor gives it, and the truth of now."""
        self.stage("read")
        truth, seen = super().newest, self._sensed
        return replace(
            truth, range_mm=seen.range_mm, sensor_time_us=seen.sensor_time_us, status=seen.status
        )

    def send(self, command: Command) -> int:
        """Send a command without waiting."""
        self.stage("write")
        return super().send(command)

    def _before_step(self, t_s: float) -> None:
        if t_s > LONGEST_S:
            raise Endless
        self.on_step(t_s)

    def _look(self, t_s: float) -> None:
        """Take in a sample as soon as the plant has one, as a sensor with this fault reports it."""
        if self.plant.range_sample() is not self._last_sample:
            self._last_sample = self.plant.range_sample()
            self.sample = reading = super().newest
            made = [(0.0, reading)] if self.sense is None else self.sense(reading, t_s)
            self._samples += [(t_s + late_s, sensed) for late_s, sensed in made]
        while self._samples and self._samples[0][0] <= t_s:
            self._sensed = self._samples.popleft()[1]


class FaultyRanges:
    """The range sensor by itself: a broken port is not its failure."""

    def __init__(self, world: "FaultyGantry") -> None:
        self._world = world
        self.failure: str | None = None

    @property
    def newest(self) -> RangeReading:
        """The newest sample."""
        return self._world.newest

    def close(self) -> None:
        """Nothing to close."""


class FaultyForecast:
    """Predictions that can be wrong or late; one that is late keeps the loop until its deadline."""

    def __init__(self, inner: Predictions, world: FaultyGantry) -> None:
        self._inner, self._world = inner, world
        self.last_n = 0.0
        self.restore()

    def restore(self) -> None:
        """Empty the slot."""
        self.alter: Callable[[Result], Result | None] | None = None

    def step(self, observation: FloatArray, deadline_s: float) -> Result | None:
        """The force for an observation (d,)."""
        self._world.stage("predict")
        result = self._inner.step(observation, deadline_s)
        if result is not None and math.isfinite(result.force_n):
            self.last_n = result.force_n
        if result is None or self.alter is None:
            return result
        altered = self.alter(result)
        if altered is None:
            self._world.stand_still(max(0.0, deadline_s - self._world.monotonic()))
        return altered

    def __getattr__(self, name: str) -> Any:
        """What a fault does not touch: the lead, the trained ranges, a reset."""
        return getattr(self._inner, name)


class Rows:
    """Where the loop's rows go, each with the time at which it came [s]."""

    def __init__(self, world: FaultyGantry) -> None:
        self.rows: list[tuple[float, Mapping[str, LogValue]]] = []
        self.error: str | None = None
        self._world = world

    def put(self, row: Mapping[str, LogValue]) -> None:
        """Keep one row."""
        self._world.stage("record")
        self.rows.append((self._world.monotonic(), row))


def untouched(data: bytes) -> Delayed:
    """A wire without a fault."""
    return [(0.0, data)]
