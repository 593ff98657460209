"""What recordings tell by plain least squares: on motions whose truth is known."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.real_systems.silent import friction, spells, valve

INERTIA, WEIGHT, RUBBING = 0.17, 3.3, 0.3


def _swing(noise_rad: float = 1e-3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    time_s = np.arange(0.0, 8.0, 1.0 / 300.0)

    def torque(t):
        return 2.5 * np.sin(4.0 * t) + 1.5 * np.sin(2.3 * t)

    def rates(t, x):
        force = torque(t) - WEIGHT * np.sin(x[0]) - RUBBING * np.tanh(x[1] / 0.02)
        return [x[1], force / INERTIA]

    found = solve_ivp(rates, (0.0, 8.0), [0.0, 0.0], t_eval=time_s, rtol=1e-8, max_step=0.01)
    shaken = found.y[0] + noise_rad * np.random.default_rng(0).standard_normal(len(time_s))
    return time_s, shaken, torque(time_s)


@pytest.mark.parametrize("window_s", [0.4, 0.6])
def test_a_pendulum_that_is_driven_without_shaking_tells_its_friction(window_s):
    told, error = friction(*_swing(), window_s)
    assert told == pytest.approx(RUBBING, abs=3.0 * error)
    assert error < 0.1 * RUBBING


def test_spells_are_those_at_the_very_end_of_what_was_read():
    readings = np.array([1.0, 3.0, 3.0, 3.0, 2.0, 3.0, 3.0, 2.9, 3.0, 3.0, 3.0, 3.0])
    assert spells(readings) == [(1, 4), (8, 12)]


def test_a_valve_that_does_less_in_one_direction_is_told_from_one_that_does_not():
    rng = np.random.default_rng(1)
    opened = np.repeat(rng.normal(size=100), 4)
    pressure = np.zeros(400)
    for t in range(3, 400):
        acts = np.where(opened[t - 2 : t] > 0.0, 1.0, 0.7) * opened[t - 2 : t]
        driven = 0.5 * acts[1] - 0.1 * acts[0]
        pressure[t] = 1.4 * pressure[t - 1] - 0.6 * pressure[t - 2] + driven
        pressure[t] += 0.02 * rng.standard_normal()
    told = {share: valve(pressure, opened, share) for share in (0.6, 0.7, 0.8, 1.0)}
    assert max(told, key=lambda share: told[share]["log_density"]) == 0.7
    assert told[0.7]["one_ahead"] == pytest.approx(0.02, rel=0.1)
    assert told[0.7]["ten_ahead"] < 0.5 * told[1.0]["ten_ahead"]
