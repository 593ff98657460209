"""A force that swings as no wake does ends a flight; wakes and gusts that do not are flown in."""

import math

import pytest
from simulated_bench import ended_by

from runtime.loop.safety import UNEXPLAINED_S
from runtime.reference import hold_plan
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 0.5, "outlier_probability": 0.0})
BEGINS_S = 3.0


def flown(force_n):
    """A flight of six seconds in which a force [N] acts as a function of time."""
    plan = hold_plan(RIG, 6.0, 0.5, 1000.0)

    def acting(t_s, state):
        return force_n(t_s) if t_s > BEGINS_S else 0.0

    loop, _, rows = ended_by(RIG, plan, -1, lambda *_: None, force_hook=acting)
    return loop, rows


def test_a_force_that_swings_by_far_ends_the_flight_and_is_named():
    loop, rows = flown(lambda t_s: 4.0 * math.sin(2.0 * math.pi * 2.5 * t_s))
    assert loop.failsafe_cause == ("motion_unexplained",)
    began = [row["mode"] for row in rows].index("FAILSAFE")
    assert UNEXPLAINED_S < rows[began]["t_s"] - BEGINS_S < 3.0 * UNEXPLAINED_S


@pytest.mark.parametrize(
    "force_n",
    [lambda t_s: -1.5, lambda t_s: 0.8 * math.sin(2.0 * math.pi * 2.5 * t_s)],
    ids=["a push that stays", "a small swing"],
)
def test_what_a_controller_holds_ends_no_flight(force_n):
    loop, _ = flown(force_n)
    assert loop.failsafe_cause == ()
