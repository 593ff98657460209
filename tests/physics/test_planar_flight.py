"""The LQR of the planar multicopter, against the cost it says it minimises, and a steady push."""

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.physics.body import PlanarBody
from wakedeploy.physics.planar_flight import lqr
from wakedeploy.physics.rail import GRAVITY_MPS2

SCALES = np.array([0.05, 0.05, 0.3, 0.3, 0.3, 3.0])
DT_S = 0.01


def regulator(**changed):
    told = {
        "dt_s": DT_S,
        "state_scale": SCALES,
        "thrust_scale_n": 1.0,
        "torque_scale_nm": 0.15,
        "thrust_n": (0.0, 30.0),
        "torque_nm": 5.0,
    }
    return lqr(1.0, 0.02, **(told | changed))


def flown(gain_factor: float, force_n=(0.0, 0.0), expected_n=(0.0, 0.0), seconds: float = 6.0):
    """States (T, 6) and the cost so far of a body let go 5 cm from its place."""
    control, body = regulator(), PlanarBody(1.0, 0.02)
    object.__setattr__(control, "gain", control.gain * gain_factor)
    state, reference = np.zeros((1, 6)), np.zeros((1, 6))
    state[0, :2] = 0.05, -0.05
    states, cost = [], 0.0
    for _ in range(int(seconds / DT_S)):
        thrust, torque = control.control(state, reference, np.array([expected_n]))
        steady = thrust[0] * np.cos(state[0, 2]) - GRAVITY_MPS2
        cost += float(((state[0] / SCALES) ** 2).sum() + steady**2 + (torque[0] / 0.15) ** 2)
        state = body.step(state, thrust, torque, np.array([force_n]), DT_S)
        states.append(state[0])
    return np.array(states), cost


@pytest.mark.parametrize("factor", [0.7, 0.85, 1.2, 1.5])
def test_no_other_gain_costs_less(factor: float) -> None:
    assert flown(1.0)[1] < flown(factor)[1]


def test_it_comes_to_rest() -> None:
    states, _ = flown(1.0)
    assert np.abs(states[-1]).max() < 1e-3


def test_an_expected_push_moves_nothing_in_the_end() -> None:
    push = (0.4, -0.9)
    surprised, ready = (flown(1.0, push, expected)[0][-1] for expected in ((0.0, 0.0), push))
    assert np.abs(surprised[:2]).max() > 0.01
    assert np.abs(ready[:2]).max() < 2e-3
    assert ready[2] == pytest.approx(np.arctan2(0.4, GRAVITY_MPS2 + 0.9), abs=1e-3)


def test_limits_hold_and_scales_must_be_positive() -> None:
    control = regulator(thrust_n=(5.0, 12.0), torque_nm=0.2)
    far = np.zeros((2, 6))
    far[:, 1], far[:, 0] = (50.0, -50.0), (50.0, -50.0)
    thrust, torque = control.control(far, np.zeros((2, 6)), np.zeros((2, 2)))
    assert set(thrust) == {5.0, 12.0}
    assert np.abs(torque).max() <= 0.2
    with pytest.raises(UnusableInput, match="scale"):
        regulator(thrust_scale_n=0.0)
