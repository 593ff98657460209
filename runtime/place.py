"""Where a run takes place: its wire, its range samples, its clock, its predictions.

Three places: a rig at a port, the virtual gantry as a process in real time, and the virtual gantry
in lockstep, in simulated time. The loop does not know which it is.
"""

import functools
import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING

from runtime.flyable import Flyable, is_bounded, predictor_of
from runtime.io.conversation import Conversation
from runtime.io.link import Link
from runtime.io.range_source import I2cRangeSource, RangeSource, SocketRangeSource
from runtime.io.realtime import Clock, Priority, become_ordinary, quieten_interpreter, take_priority
from runtime.loop.loop import PERIOD_S
from runtime.loop.prediction_worker import Predictions, PredictionWorker
from runtime.request import RunRequest
from wakedeploy.core.failsafes import LATE_GANTRY

if TYPE_CHECKING:
    from runtime.simulated import SimulatedGantry
    from runtime.virtual.simulated_uno import SimulatedUno

# A simulation is imported where one is flown: it takes megabytes that a Pi need not give.


@dataclass(frozen=True)
class Place:
    """Everything around the loop of one run; `priority` is None where time is simulated."""

    link: Conversation
    ranges: RangeSource
    clock: Clock
    priority: Priority | None = None

    @property
    def is_simulated_time(self) -> bool:
        """Whether computing takes no time."""
        return self.priority is None

    @property
    def is_realtime(self) -> bool:
        """Whether the loop has real-time priority."""
        return self.priority is not None and self.priority.is_realtime

    def predictions(self, package: Flyable, opened: ExitStack) -> Predictions:
        """The package at work: in a thread with deadlines, or at once where time is simulated."""
        if self.is_simulated_time:
            from runtime.simulated import PackageForecast

            return PackageForecast(predictor_of(package))
        worker = PredictionWorker(predictor_of(package), PERIOD_S, bounded=is_bounded(package))
        opened.callback(worker.close)
        return worker

    def settle(self) -> None:
        """Keep the interpreter's own work out of a flight in real time."""
        if not self.is_simulated_time:
            quieten_interpreter()


def opened_place(request: RunRequest, opened: ExitStack) -> Place:
    """Open what the request names; `opened` closes it again.

    Raises UnusableInput for what is not there or cannot be used.
    """
    if request.in_lockstep:
        world = _lockstep(request)
        return Place(world, world, world)
    port, range_socket, silence = request.port, request.range_socket, ""
    if port is None:
        from runtime.virtual.process import VirtualGantryProcess

        gantry = VirtualGantryProcess(
            request.truth,
            seed=request.truth_seed,
            hooks=request.hooks,
            firmware=request.firmware,
            spacer_m=request.spacer_m,
        )
        opened.callback(gantry.close)
        port, range_socket = gantry.port, gantry.range_socket
        silence = f"{LATE_GANTRY[0].upper()}{LATE_GANTRY[1:]}."
    priority = take_priority(request.realtime)  # after the plant, which would inherit it
    if priority.is_realtime:
        opened.callback(become_ordinary)
    link = opened.enter_context(Link(port, silence))
    ranges = SocketRangeSource(range_socket) if range_socket else I2cRangeSource()
    opened.callback(ranges.close)
    return Place(link, ranges, time, priority)


def _lockstep(request: RunRequest) -> "SimulatedGantry":
    from runtime.simulated import SimulatedGantry
    from runtime.virtual.firmware_port import FirmwarePort
    from runtime.virtual.hooks import load_hooks
    from wakedeploy.physics.gantry import GantryPlant

    truth, board = request.truth, None
    if request.firmware:
        board = FirmwarePort(truth, _the_uno())
        # The sketch makes servo frames of its own; the plant must not wait for others.
        truth = truth.changed(disturbance={"esc_frame_s": 0.0})
    hooks = load_hooks(request.hooks) if request.hooks else {}
    plant = GantryPlant(truth, seed=request.truth_seed, spacer_m=request.spacer_m, **hooks)
    return SimulatedGantry(plant, truth=truth, seed=request.truth_seed, port=board)


@functools.cache
def _the_uno() -> "SimulatedUno":
    """A process can have one; opening its port resets it, as a board on the table."""
    from runtime.virtual.simulated_uno import SimulatedUno

    return SimulatedUno()
