"""One flight in virtual time: the rig's loop, plan and recorder, frames on the wire, and a board.

The board is the one in Python or the compiled sketch of the project that is imported. A process
can have one simulated UNO, so that each flight is one: no computer is too busy for it.

    python tests/firmware/flight_in_virtual_time.py {python,sketch} RIG SECONDS SEED LOG
"""

import sys
from pathlib import Path

from runtime.link import Answer
from runtime.loop import Loop
from runtime.protocol import Disarm, Frame, FrameDecoder, Hello, Message, Status, encode_frame
from runtime.recorder import Recorder
from runtime.reference import random_plan
from runtime.simulated import COMPUTE_S, SimulatedGantry
from runtime.virtual.firmware_port import FirmwarePort
from runtime.virtual.mcu_port import McuPort
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig import Rig, read_rig

BOOTED_S = 2.0


class WiredGantry(SimulatedGantry):
    """The simulated gantry, whose decisions are made at the other end of a wire."""

    def __init__(self, rig: Rig, port: McuPort | FirmwarePort, seed: int) -> None:
        # The sketch makes servo frames of its own; the plant must not wait for others.
        frames = {} if isinstance(port, McuPort) else {"esc_frame_s": 0.0}
        plant = GantryPlant(rig.changed(disturbance=frames), seed=seed)
        super().__init__(plant, model=rig, truth=rig, seed=seed)
        self._port, self._decoder = port, FrameDecoder()
        self._unsent: list[tuple[float, bytes]] = []
        self._port.opened(0.0)
        self.sleep(BOOTED_S)
        self._ask(Hello())

    @property
    def answer(self) -> Answer:
        return self._answer

    def arm(self, limits) -> Status:
        self._ask(limits)
        assert self._answer.status.armed
        return self._answer.status

    def disarm(self) -> None:
        self._ask(Disarm())

    def send(self, message: Message) -> int:
        self._sequence += 1
        sent_s = self._sent_s[self._sequence] = self._now_s + COMPUTE_S
        frame = Frame(self._sequence, int(1e6 * sent_s), message)
        self._unsent.append((sent_s, encode_frame(frame)))
        return self._sequence

    def _ask(self, message: Message) -> None:
        asked = self.send(message)
        end_s = self._now_s + 0.5
        while asked in self._sent_s:
            assert self._now_s < end_s, f"no answer to {message}"
            self.sleep(0.01)

    def _step(self) -> None:
        plant = self.plant
        while self._unsent and self._unsent[0][0] <= plant.t_s:
            self._port.receive(plant.t_s, self._unsent.pop(0)[1])
        for frame in self._decoder.feed(self._port.answer(plant.t_s, plant)):
            trip_s = plant.t_s - self._sent_s.pop(frame.sequence)
            if isinstance(frame.message, Status):
                self._answer = Answer(frame.message, frame.time_us, plant.t_s, trip_s)
        out = self._port.advance(plant.t_s, plant.dt_s)
        plant.step(out.source_us, out.sufferer_us, out.carriage_mps)


def main(board: str, rig_file: str, seconds: str, seed: str, log: str) -> None:
    rig = read_rig(Path(rig_file))
    port = FirmwarePort(rig) if board == "sketch" else McuPort(rig)
    world = WiredGantry(rig, port, int(seed))
    recorder = Recorder(Path(log), {"rig_toml": rig.text})
    loop = Loop(
        rig, world, world, random_plan(rig, float(seconds), int(seed)), None, recorder, world
    )
    try:
        print(loop.run().ended)
    finally:
        recorder.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
