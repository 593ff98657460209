"""One flight in virtual time: the rig's loop, plan and recorder, frames on the wire, and a board.

The board is the one in Python or the compiled sketch of the project that is imported. A process
can have one simulated UNO, so that each flight is one: no computer is too busy for it.

    python tests/firmware/flight_in_virtual_time.py {python,sketch} RIG SECONDS SEED LOG
"""

import sys
from pathlib import Path

from world import World

from runtime.io.recorder import Recorder
from runtime.loop.loop import Loop
from runtime.reference import random_plan
from runtime.virtual.firmware_port import FirmwarePort
from runtime.virtual.mcu_port import McuPort
from runtime.virtual.simulated_uno import BOOT_S
from wakedeploy.rig.file import read_rig


def main(board: str, rig_file: str, seconds: str, seed: str, log: str) -> None:
    rig = read_rig(Path(rig_file))
    port = McuPort(rig)
    plant = rig
    if board == "sketch":
        port = FirmwarePort(rig)
        # The sketch makes servo frames of its own; the plant must not wait for others.
        plant = rig.changed(disturbance={"esc_frame_s": 0.0})
    world = World(plant, port, boot_s=BOOT_S)
    recorder = Recorder(Path(log), {"rig_toml": rig.text})
    plan = random_plan(rig, float(seconds), int(seed))
    try:
        print(Loop(rig, world, world, plan, None, recorder, world).run().ended)
    finally:
        recorder.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
