"""Whatever ends a run in which nothing flies, no motor is started by it.

The sufferer lies half a metre up on a spacer that a person may be holding: a loop that "brings it
down under control" would give it the thrust of a hover.
"""

import math
from dataclasses import replace

import pytest
from simulated_bench import ended_by

from runtime.calibration.session import resting
from runtime.calibration.steps_per_metre import driving
from runtime.loop import safety
from runtime.loop.arming import arm_limits
from runtime.loop.safety import Mode
from runtime.reference import hold_plan
from wakedeploy.core.failsafes import HINTS
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 1.0})
IDLE_US = RIG.limits.pulse_us[0]
SPACER_M = 0.5


PLANS = {
    "resting": (*resting(RIG, 8.0), 40),
    "driving, at rest": (*driving(RIG, 0.4, 3.0), 20),
    "driving": (*driving(RIG, 0.4, 3.0), 100),
    "before a flight": (RIG, hold_plan(RIG, 6.0, 0.4, 1400.0), 20),
}


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("fault", HINTS)
def test_no_fault_of_a_run_at_rest_starts_a_motor(plan, fault, monkeypatch):
    rig, flight, at = PLANS[plan]

    def comes(loop, bench, rows):
        monkeypatch.setattr(safety, "fatal_faults", lambda found, limits: (fault,))

    loop, bench, rows = ended_by(rig, flight, at, comes, spacer_m=SPACER_M)
    assert loop.failsafe_cause == (fault,)
    assert set(bench.commands) == {(IDLE_US, IDLE_US)}
    assert len(rows) == at + 1  # it finishes at once
    assert rows[-1]["mode"] == Mode.FAILSAFE
    assert loop.tally.ended in (f"failsafe: {fault}", "stopped by hand")


def stop(loop, bench, rows):
    loop.stop_asked = True


def disk_full(loop, bench, rows):
    rows.error = "disk full"


def mute(loop, bench, rows):
    bench.muted = True


def latched(loop, bench, rows):
    bench.changes = {"armed": False}


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        (stop, "operator_stop"),
        (disk_full, "recorder_failed"),
        (mute, "link_lost"),
        (latched, "mcu_fault"),
    ],
)
def test_a_fault_that_the_loop_finds_itself_starts_no_motor(plan, fault, cause):
    rig, flight, at = PLANS[plan]
    loop, bench, _ = ended_by(rig, flight, at, fault, spacer_m=SPACER_M)
    assert cause in loop.failsafe_cause
    assert set(bench.commands) == {(IDLE_US, IDLE_US)}


@pytest.mark.parametrize(
    ("hook", "cause"),
    [
        (lambda t, z, steps: (z, steps + (9000 if t > 2.0 else 0)), "x_limit"),
        (lambda t, z, steps: (z if t < 2.0 else math.nan, steps), "sensor_lost"),
    ],
)
def test_a_sensor_that_goes_wrong_while_a_person_holds_spacers_starts_no_motor(hook, cause):
    rig, plan, _ = PLANS["resting"]
    loop, bench, _ = ended_by(rig, plan, -1, stop, spacer_m=SPACER_M, sensor_hook=hook)
    assert loop.failsafe_cause == (cause,)
    assert set(bench.commands) == {(IDLE_US, IDLE_US)}


def test_a_stop_by_hand_after_the_landing_starts_no_motor():
    plan = hold_plan(RIG, 8.0, 0.4, 1400.0)
    _, _, whole = ended_by(RIG, plan, -1, stop)
    landed = len(whole) - 16  # in the rest after the touch-down
    loop, bench, rows = ended_by(RIG, plan, landed, stop)
    assert loop.failsafe_cause == ("operator_stop",)
    assert max(sufferer_us for _, sufferer_us in bench.commands) > 1400.0
    assert bench.commands[landed:] == [(IDLE_US, IDLE_US)]
    assert rows[-1]["mode"] == Mode.FAILSAFE


def test_in_flight_a_stop_still_comes_down_under_control():
    loop, bench, _ = ended_by(RIG, hold_plan(RIG, 8.0, 0.4, 1400.0), 140, stop)
    assert loop.failsafe_cause == ("operator_stop",)
    down_us = [sufferer_us for _, sufferer_us in bench.commands[140:]]
    assert len(down_us) > 32
    assert down_us[0] > 1400.0


@pytest.mark.parametrize("plan", ["resting", "driving"])
def test_the_board_of_a_run_without_motors_refuses_every_pulse(plan):
    rig, flight, at = PLANS[plan]

    def asks_for_thrust(loop, bench, rows):
        send = bench.send
        bench.send = lambda message: send(replace(message, source_us=2000.0, sufferer_us=2000.0))

    loop, bench, _ = ended_by(rig, flight, at, asks_for_thrust, spacer_m=SPACER_M)
    assert loop.failsafe_cause == ()
    assert (2000.0, 2000.0) in bench.commands
    assert bench.limits == arm_limits(rig, motors_off=True)
    assert max(bench.applied_us) <= IDLE_US + 1.0
    assert bench.plant.source_applied_us <= IDLE_US + 1.0
    assert bench.plant.z_m == SPACER_M
