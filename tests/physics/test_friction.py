"""Dry friction within a sample, against the same in thousands of small steps."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from wakedeploy.physics.friction import borne

SPEEDS = st.floats(-1.0, 1.0, allow_nan=False)
STRENGTHS = st.floats(0.05, 1.0)
TINY = st.floats(-20.0, -2.0).map(lambda power: 10.0**power)
TURNINGS = st.floats(0.01, 0.3)
HARD = 1e-7  # a turning speed of next to nothing


def integrated(before: float, after: float, most: float, turning: float) -> float:
    """The speed after the sample: an equation of motion, in small steps."""
    pull = after - before
    held = min(max(pull / most, -1.0), 1.0)

    def rate(_, speed):
        return pull - most * min(max(speed[0] / turning + held, -1.0), 1.0)

    return solve_ivp(lambda t, v: [rate(t, v)], (0.0, 1.0), [before], max_step=0.01).y[0, -1]


def stuck_or_slid(before: float, after: float, most: float, steps: int = 2000) -> float:
    """The same of friction that turns at once: it stops where it would turn, and may stay."""
    pull, dt, speed = after - before, 1.0 / steps, before
    for _ in range(steps):
        if speed == 0.0:
            stays = abs(pull) <= most
            speed = 0.0 if stays else (pull - math.copysign(most, pull)) * dt
            continue
        further = speed + (pull - math.copysign(most, speed)) * dt
        speed = 0.0 if further * speed < 0.0 else further
    return speed


@given(SPEEDS, SPEEDS, STRENGTHS, TURNINGS)
def test_a_motion_slows_stands_and_turns_as_its_equation_says(before, after, most, turning):
    share, _, _ = borne(before, after, most, turning)
    assert abs(share) <= 1.0 + 1e-12
    assert after + most * share == pytest.approx(integrated(before, after, most, turning), abs=3e-3)


@given(SPEEDS, SPEEDS, STRENGTHS)
def test_hard_friction_stops_what_turns_and_lets_go_of_what_pulls_more(before, after, most):
    share, _, _ = borne(before, after, most, HARD)
    assert after + most * share == pytest.approx(stuck_or_slid(before, after, most), abs=3e-3)


@given(STRENGTHS, TURNINGS, st.floats(-1.0, 1.0))
def test_what_stands_is_held_by_no_more_than_pulls(most, turning, pull):
    share, _, _ = borne(0.0, pull * most, most, turning)
    assert share == pytest.approx(-pull, abs=1e-12)


@given(SPEEDS, SPEEDS, STRENGTHS, TURNINGS)
def test_slopes_are_those_of_the_force(before, after, most, turning):
    step = 1e-4
    share, by_before, by_after = borne(before, after, most, turning)
    ahead = [borne(before + step, after, most, turning), borne(before, after + step, most, turning)]
    behind = [
        borne(before - step, after, most, turning), borne(before, after - step, most, turning)
    ]  # fmt: skip
    for told, high, low in zip((by_before, by_after), ahead, behind, strict=True):
        slopes = sorted(((high[0] - share) / step, (share - low[0]) / step))  # two at a corner
        near = 0.03 * (1.0 + abs(told)) / turning * 0.01 + 1e-2 / most
        assert slopes[0] - near <= told <= slopes[1] + near


@given(SPEEDS, SPEEDS, TINY, TURNINGS)
def test_next_to_no_friction_does_next_to_nothing(before, after, most, turning):
    share, by_before, by_after = borne(before, after, most, turning)
    rounding = 1e-15 * (abs(before) + abs(after)) / most  # of a difference of two speeds
    assert abs(share) <= 1.0 + 2.0 * rounding
    assert abs(most * share) <= most + 1e-15
    assert most * max(abs(by_before), abs(by_after)) <= 2.0 + 1e-3
