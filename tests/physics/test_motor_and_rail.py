"""Motor, ESC frame and rail against analytic solutions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wakedeploy.core.rig_sections import Rail, SpoolLag
from wakedeploy.physics.motor import EscFrame, Motor, spooled
from wakedeploy.physics.rail import GRAVITY_MPS2, RailBody
from wakedeploy.rig.file import default_rig

DT_S = 1.0 / 256.0


@given(
    speed=st.floats(0.0, 3.0),
    target=st.floats(0.0, 3.0),
    first=st.floats(1e-3, 0.1),
    second=st.floats(1e-3, 0.1),
)
def test_spool_up_and_down_compose_over_time(
    speed: float, target: float, first: float, second: float
) -> None:
    lag = SpoolLag(up_s=0.06, down_s=0.1)
    in_two = spooled(spooled(speed, target, lag, first), target, lag, second)
    tau = 0.06 if target > speed else 0.1
    expected = target + (speed - target) * math.exp(-(first + second) / tau)
    assert in_two == pytest.approx(expected, abs=1e-9)


def test_thrust_follows_the_square_of_the_rotor_speed() -> None:
    rig = default_rig()
    motor = Motor(rig.thrust.sufferer, SpoolLag(up_s=0.06, down_s=0.1))
    motor.set_pulse(2000.0)
    thrust_n = [motor.step(DT_S) for _ in range(64)][-1]
    assert motor.speed**2 == pytest.approx(9.0 * (1 - math.exp(-0.25 / 0.06)) ** 2, rel=1e-9)
    middle_n = 9.0 * (1 - math.exp((0.5 * DT_S - 0.25) / 0.06)) ** 2
    assert thrust_n == pytest.approx(middle_n, rel=1e-4)  # the mean over the step


@given(phase=st.floats(0.0, 0.02))
def test_a_servo_frame_passes_fifty_commands_a_second(phase: float) -> None:
    frame = EscFrame(0.02, phase)
    assert sum(frame.due(i * DT_S) for i in range(2560)) in (499, 500, 501)


def test_without_a_frame_every_command_passes() -> None:
    frame = EscFrame(0.0, 0.0)
    assert all(frame.due(i * DT_S) for i in range(10))


def test_a_falling_body_against_coulomb_and_viscous_friction() -> None:
    rail = Rail(coulomb_n=0.4, stiction_n=0.6, viscous_n_per_mps=0.8)
    body = RailBody(0.45, rail, travel_m=10.0, z_m=9.0)
    for _ in range(128):
        body.step(0.0, DT_S)
    driving, tau = 0.45 * GRAVITY_MPS2 - 0.4, 0.45 / 0.8
    speed = driving / 0.8 * (1 - math.exp(-0.5 / tau))
    fallen = driving / 0.8 * (0.5 - tau * (1 - math.exp(-0.5 / tau)))
    assert body.vz_mps == pytest.approx(-speed, rel=0.005)
    assert body.z_m == pytest.approx(9.0 - fallen, abs=0.005)


def test_stiction_holds_until_it_is_overcome() -> None:
    body = RailBody(0.45, Rail(coulomb_n=0.3, stiction_n=0.5), travel_m=1.0, z_m=0.5)
    hover_n = 0.45 * GRAVITY_MPS2
    for _ in range(100):
        body.step(hover_n + 0.45, DT_S)
    assert body.z_m == 0.5
    body.step(hover_n + 0.55, DT_S)
    assert body.vz_mps == pytest.approx((0.55 - 0.3) / 0.45 * DT_S)


def test_friction_brings_a_moving_body_to_rest_and_not_beyond() -> None:
    body = RailBody(0.45, Rail(coulomb_n=0.3, stiction_n=0.4), 1.0, z_m=0.2, vz_mps=0.3)
    hover_n = 0.45 * GRAVITY_MPS2
    for _ in range(256):
        body.step(hover_n, DT_S)
    assert body.vz_mps == 0.0
    assert body.z_m == pytest.approx(0.2 + 0.3**2 * 0.45 / (2 * 0.3), abs=1e-3)


@given(st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=100))
def test_the_stops_are_never_passed(forces: list[float]) -> None:
    body = RailBody(0.45, Rail(coulomb_n=0.05, stiction_n=0.08), travel_m=0.05, z_m=0.02)
    for force_n in forces:
        body.step(force_n, DT_S)
        assert 0.0 <= body.z_m <= 0.05
        assert np.isfinite(body.vz_mps)
