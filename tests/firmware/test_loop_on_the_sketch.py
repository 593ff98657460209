"""A board that restarts in flight, or whose battery goes, with the compiled sketch in the loop."""

import functools
import math

import needs
import pytest
from simulated import the_uno
from world import RIG, World

from runtime.io.protocol import Fault
from runtime.loop.loop import Loop
from runtime.reference import hold_plan
from runtime.virtual.firmware_port import FirmwarePort
from runtime.virtual.simulated_uno import BOOT_S
from wakedeploy.core.errors import UnusableInput

pytestmark = needs.simulator

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


# The sketch makes servo frames of its own.
# The board's descent is over before the loop asks why it fell silent.
WITH_DIVIDER = RIG.changed(
    disturbance={"esc_frame_s": 0.0},
    battery={"has_divider": True},
    limits={"brake_s": 0.0, "sink_s": 0.0},
)


def flown(act, first_fault="link_lost"):
    """A flight at whose tick `AT` something is done to its world."""
    rig = WITH_DIVIDER
    world = World(rig, FirmwarePort(rig, the_uno()), boot_s=BOOT_S)
    rows = Rows(lambda: act(world))
    loop = Loop(rig, world, world, hold_plan(rig, 6.0, 0.5, 1400.0), None, rows, world)
    loop.run()
    assert rows.faults[AT - 1] == ""
    ending = next(f for f in rows.faults if f not in ("", "answers_missing"))
    assert ending.split("+")[0] == first_fault
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


def test_a_battery_that_drains_behind_the_stop_ends_the_flight_at_six_tenths():
    """Measured by the chip's own converter, behind the divider; the motors run on here."""
    began_s = []

    def drain(world):
        began_s.append(world.now_s)
        for tenths in range(1, 40):
            volts = 11.1 * math.exp(-tenths / 10.0)

            sags = functools.partial(setattr, world.port, "battery_v", volts)
            world.later.append((world.now_s + tenths / 10.0, sags))

    loop, world = flown(drain, "battery_lost")
    assert loop.tally.ended == "failsafe: battery_lost"
    ended_s = world.now_s - began_s[0] - RIG.limits.sufferer_descent_s
    assert ended_s == pytest.approx(0.5 + 0.25 + 0.1, abs=0.2)


def test_no_flight_begins_on_the_sketch_without_a_battery():
    port = FirmwarePort(WITH_DIVIDER, the_uno())
    port.battery_v = 0.0
    world = World(WITH_DIVIDER, port, boot_s=BOOT_S)
    loop = Loop(WITH_DIVIDER, world, world, hold_plan(RIG, 6.0, 0.5, 1400.0), clock=world)
    with pytest.raises(UnusableInput, match="measures no battery"):
        loop.run()
    assert world.commands == []
