"""Controller and references: signs, limits, windup, and plans that stay within the rig."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.loop.controller import Controller, ControlState
from runtime.loop.estimate import Estimate, initial_estimate
from runtime.reference import Reference, hold_plan, random_plan
from wakedeploy.rig.file import default_rig

RIG = default_rig()
DT_S = 1.0 / 32.0
HOVER_N = RIG.sufferer.mass_kg * 9.81
AIM = Reference(0.5, 0.0, 0.0, 0.0, 0.0, 1500.0)


def at(z_m: float, vz_mps: float = 0.0, x_m: float = 0.0) -> Estimate:
    return dataclasses.replace(
        initial_estimate(0.0), height=np.array([z_m, vz_mps, 0.0]), lateral=np.array([x_m, 0.0])
    )


def settled(thrust_n: float) -> ControlState:
    return ControlState(0.0, RIG.thrust.sufferer.pulse(thrust_n))


def test_hovering_on_target_needs_the_weight_and_a_wake_its_opposite() -> None:
    controller = Controller(RIG, DT_S)
    for feedforward_n in (0.0, 0.7):
        _, command, terms = controller.step(
            settled(HOVER_N + feedforward_n), at(0.5), AIM, feedforward_n
        )
        thrust_n = RIG.thrust.sufferer.thrust(command.sufferer_us)
        assert thrust_n == pytest.approx(HOVER_N + feedforward_n, abs=1e-9)
        assert terms.feedforward_n == feedforward_n


def test_it_pushes_up_when_low_and_brakes_when_rising() -> None:
    controller = Controller(RIG, DT_S)
    _, low, _ = controller.step(settled(HOVER_N), at(0.48), AIM, 0.0)
    _, rising, _ = controller.step(settled(HOVER_N), at(0.5, vz_mps=0.1), AIM, 0.0)
    hover_us = settled(HOVER_N).sufferer_us
    assert rising.sufferer_us < hover_us < low.sufferer_us


@given(st.floats(-2.0, 3.0), st.floats(-3.0, 3.0), st.floats(-20.0, 20.0))
def test_pulses_stay_within_limits_and_slew(z_m: float, vz: float, feedforward_n: float) -> None:
    controller, state = Controller(RIG, DT_S), settled(HOVER_N)
    for _ in range(5):
        before = state.sufferer_us
        state, command, _ = controller.step(state, at(z_m, vz), AIM, feedforward_n)
        assert 1000.0 <= command.sufferer_us <= 2000.0
        assert abs(command.sufferer_us - before) <= RIG.limits.slew_us_per_s * DT_S + 1e-6


def test_the_integral_stops_while_the_motor_is_at_its_end() -> None:
    controller, state = Controller(RIG, DT_S), ControlState()
    for _ in range(320):
        state, command, _ = controller.step(state, at(-5.0), AIM, 0.0)
    assert command.sufferer_us == 2000.0
    assert state.integral_n == 0.0


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31), seconds=st.floats(8.0, 40.0))
def test_random_plans_stay_within_the_rig(seed: int, seconds: float) -> None:
    plan = random_plan(RIG, seconds, seed)
    aims = [plan.at(tick) for tick in range(len(plan))]
    assert len(plan) == round(seconds * 32)
    assert all(0.0 <= a.z_m <= RIG.sufferer.travel_m for a in aims)
    assert all(RIG.limits.x_m[0] < a.x_m < RIG.limits.x_m[1] for a in aims)
    assert all(abs(a.vx_mps) <= RIG.stepper.max_speed_mps for a in aims)
    assert all(1000.0 <= a.source_us <= 2000.0 for a in aims)
    assert aims[0].z_m == aims[0].x_m == 0.0
    assert abs(aims[-1].z_m) < 1e-3
    assert abs(aims[-1].x_m) < 1e-3


def test_plans_differ_by_seed_and_repeat() -> None:
    first, again, other = (random_plan(RIG, 20.0, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.z_m, again.z_m)
    assert not np.array_equal(first.source_us, other.source_us)


def test_speed_and_acceleration_are_those_of_the_height() -> None:
    plan = hold_plan(RIG, 10.0, 0.6, 1600.0)
    aims = [plan.at(tick) for tick in range(len(plan))]
    speeds = np.array([a.vz_mps for a in aims])
    assert np.allclose(np.cumsum(speeds) * DT_S, [a.z_m for a in aims], atol=0.01)
    previewed = plan.at(20, preview_s=4 * DT_S).az_mps2
    assert previewed == pytest.approx(plan.at(24).az_mps2)


def test_between_two_ticks_the_acceleration_is_interpolated_and_at_the_end_held() -> None:
    plan = random_plan(RIG, 8.0, 3)
    at_ticks = [aim.az_mps2 for aim in map(plan.at, range(len(plan)))]
    for tick, preview_s in ((0, 0.0), (0, 0.098), (100, 0.0312), (len(plan) - 2, 0.02)):
        acting = tick + preview_s / DT_S
        previewed = plan.at(tick, preview_s).az_mps2
        assert previewed == np.interp(acting, np.arange(len(plan)), at_ticks)
    assert plan.at(len(plan) - 1, 0.5).az_mps2 == plan.at(len(plan) + 7).az_mps2 == at_ticks[-1]
