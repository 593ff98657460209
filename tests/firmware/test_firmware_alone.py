"""A USB cable pulled in flight; the compiled sketch at its other end has a supply of its own."""

import time

import needs
import pytest
from cable import Cable

from runtime.io.link import Link
from runtime.io.protocol import Arm, Command, Fault
from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.rig.file import default_rig

LIMITS = Arm(1000, 2000, 20_000, 250, 1000, 2100, 8400, 0, 0, 0)


@pytest.mark.whole
@needs.simulator
def test_a_sketch_whose_cable_is_pulled_idles_both_motors_and_latches():
    with VirtualGantryProcess(default_rig(), seed=0, firmware=True) as gantry:
        cable = Cable(gantry.port)
        with Link(cable.port) as link:
            link.handshake()
            link.arm(LIMITS)
            for _ in range(16):
                link.send(Command(1300.0, 1700.0, 0, 1000, 1000))
                time.sleep(1.0 / 32.0)
            cable.pull()
            time.sleep(0.1)
            assert "connection to the board was lost" in link.failure
        # A simulated chip is slower than real time on a busy machine: wait for what it says itself.
        end_s = time.monotonic() + 60.0
        while not (alone := cable.ask(Command(1700.0, 1700.0, 0, 1000, 1000))).faults:
            assert time.monotonic() < end_s, "the deadman never latched"
            time.sleep(2.0)  # a command feeds the deadman, whose ladder takes 1.125 s
        assert alone.faults == Fault.DEADMAN
        assert not alone.armed
        assert (alone.source_us, alone.sufferer_us) == (1000.0, 1000.0)
        cable.close()
