"""A board that restarts in flight, with the compiled sketch: the run ends by its name."""

import pytest
from simulated import needs_simulator, the_uno
from world import RIG, World

from runtime.loop import Loop
from runtime.protocol import Fault
from runtime.reference import hold_plan
from runtime.virtual.firmware_port import FirmwarePort
from runtime.virtual.simulated_uno import BOOT_S

pytestmark = needs_simulator

AT = 60  # ticks: on the way up


class Rows:
    """Does something at one tick."""

    error = None

    def __init__(self, act):
        self.count, self._act, self.faults = 0, act, []

    def put(self, row):
        self.count += 1
        self.faults.append(row["faults"])
        if self.count == AT:
            self._act()


def flown(act):
    """A flight at whose tick `AT` something is done to its world."""
    rig = RIG.changed(disturbance={"esc_frame_s": 0.0})  # the sketch makes frames of its own
    world = World(rig, FirmwarePort(rig, the_uno()), boot_s=BOOT_S)
    rows = Rows(lambda: act(world))
    loop = Loop(rig, world, world, hold_plan(rig, 6.0, 0.5, 1400.0), None, rows, world)
    loop.run()
    assert rows.faults[AT - 1] == ""
    assert next(f for f in rows.faults if f) == "link_lost"
    return loop, world


def test_a_main_loop_that_hangs_ends_as_a_restart_by_the_watchdog():
    def hang(world):
        the_uno().hang()
        world.later.append((world.now_s + 1.8, the_uno().mend))  # after the bite, before the next

    loop, world = flown(hang)
    assert loop.tally.ended == "failsafe: mcu_reboot"
    assert loop.last_reset == Fault.WATCHDOG
    assert world.plant.sufferer_applied_us == pytest.approx(1000.0, abs=0.2)


@pytest.mark.parametrize("boot_s", [0.05, BOOT_S])
def test_a_reset_from_outside_ends_as_a_restart_without_a_cause(boot_s):
    loop, _ = flown(lambda world: the_uno().open_port(boot_s))
    assert loop.tally.ended == "failsafe: mcu_reboot"
    assert loop.last_reset == Fault.NONE


@pytest.mark.parametrize("comes_back", [False, True])
def test_a_cut_cable_is_no_restart_whether_or_not_it_comes_back(comes_back):
    def cut(world):
        world.muted = True
        if comes_back:
            world.later.append((world.now_s + 2.0, lambda: setattr(world, "muted", False)))

    loop, world = flown(cut)
    assert loop.tally.ended == "failsafe: link_lost"
    if comes_back:
        assert world.answer.status.faults == Fault.DEADMAN
