"""The estimator against a second Kalman filter, and its promises about late and missing samples."""

import math

import numpy as np
import pytest

from runtime.loop.estimate import Estimate, Measurement, initial_estimate
from runtime.loop.estimator import Estimator
from wakedeploy.rig.file import default_rig

RIG = default_rig()
DT_S = 1.0 / 32.0
HOVER_US = RIG.thrust.sufferer.pulse(RIG.sufferer.mass_kg * 9.81)


def hovering(z_m: float, vz_mps: float = 0.0) -> Estimate:
    start = initial_estimate(0.0)
    height = np.array([z_m, vz_mps, 0.0])
    speed = math.sqrt(RIG.sufferer.mass_kg * 9.81)
    return Estimate(
        0.0, height, np.diag([0.05**2, 0.1**2, 0.1**2]), start.lateral, start.lateral_cov, speed
    )


def measured(tick: int, range_m: float, age_s: float = 0.0, repeats: int = 0) -> Measurement:
    return Measurement(tick * DT_S, range_m, age_s, repeats, 0)


def fly(ranges: np.ndarray, ages: np.ndarray, start: Estimate) -> list[Estimate]:
    estimator, states = Estimator(RIG), [start]
    for tick, (range_m, age_s) in enumerate(zip(ranges, ages, strict=True), start=1):
        seen = measured(tick, float(range_m), float(age_s))
        states.append(estimator.step(states[-1], seen, (HOVER_US, HOVER_US), 0.0))
    return states[1:]


def test_it_agrees_with_a_filter_in_information_form() -> None:
    """The same model written the other way round: information matrices, no gains."""
    rng = np.random.default_rng(0)
    ages, ranges = rng.uniform(0.01, 0.03, 40), 0.5 + 0.004 * rng.standard_normal(40)
    flown = fly(ranges, ages, hovering(0.5))
    state, cov = hovering(0.5).height, hovering(0.5).height_cov
    mass, keep = RIG.sufferer.mass_kg, math.exp(-DT_S / 1.0)
    step = np.array([[1, DT_S, DT_S**2 / 2 / mass], [0, 1, DT_S / mass], [0, 0, keep]])
    gain = np.array([DT_S**2 / 2, DT_S, 0.0])
    noise = 0.3**2 * np.outer(gain, gain) + np.diag([0, 0, 0.25**2 * (1 - keep**2)])
    variance = 0.004**2 + 0.001**2 / 12
    for z, age in zip(ranges, ages, strict=True):
        friction = 0.05 * math.tanh(state[1] / 0.02) + 0.05 * state[1]
        state, cov = step @ state - gain * friction / mass, step @ cov @ step.T + noise
        row = np.array([1, -age, age**2 / 2 / mass])
        information = np.linalg.inv(cov) + np.outer(row, row) / variance
        state = np.linalg.solve(information, np.linalg.inv(cov) @ state + row * z / variance)
        cov = np.linalg.inv(information)
    assert np.allclose(flown[-1].height, state, atol=1e-6)
    assert np.allclose(flown[-1].height_cov, cov, rtol=1e-5, atol=1e-12)


def test_the_age_of_a_sample_is_taken_into_account() -> None:
    """Rising at 0.2 m/s, samples 25 ms old lag by 5 mm; the estimate does not."""
    times = DT_S * np.arange(1, 65)
    ages = np.full(64, 0.025)
    last = fly(0.3 + 0.2 * (times - ages), ages, hovering(0.3, 0.2))[-1]
    assert last.z_m == pytest.approx(0.3 + 0.2 * times[-1], abs=0.0015)


def test_missed_and_repeated_samples_are_predicted_through() -> None:
    estimator = Estimator(RIG)
    for unseen in (measured(1, math.nan), measured(1, 0.9, 0.04, repeats=1)):
        after = estimator.step(hovering(0.5, 0.1), unseen, (HOVER_US, HOVER_US), 0.0)
        assert after.z_m == pytest.approx(0.5 + 0.1 * DT_S, abs=2e-4)
        assert math.isnan(after.innovation_m)
        assert after.height_cov[0, 0] > hovering(0.5).height_cov[0, 0]


def test_an_outlier_is_rejected_and_a_lasting_jump_believed() -> None:
    ranges = np.full(40, 0.5)
    ranges[10] = 0.8
    once = fly(ranges, np.full(40, 0.02), hovering(0.5))
    assert max(abs(e.z_m - 0.5) for e in once) < 0.005
    ranges[20:] = 0.8
    lasting = fly(ranges, np.full(40, 0.02), hovering(0.5))
    assert lasting[-1].z_m == pytest.approx(0.8, abs=0.05)
    assert not any(e.jumped_m for e in once)
    assert [tick for tick, e in enumerate(lasting) if e.jumped_m > 0.1] == [24]
    assert lasting[24].jumped_m == pytest.approx(0.3, abs=0.02)


def test_readings_that_drift_away_are_no_jump() -> None:
    """A frozen sensor's, or those of a fall: the first that is rejected is not yet far off."""
    drifting = fly(0.5 + 0.06 * np.maximum(np.arange(60.0) - 20.0, 0.0), np.full(60, 0.02),
                   hovering(0.5))  # fmt: skip
    jumps = [e.jumped_m for e in drifting if e.jumped_m]
    assert jumps
    assert max(jumps) < 0.1


def test_on_the_stop_the_motors_off_it_rests() -> None:
    estimator, state = Estimator(RIG), initial_estimate(0.0)
    for tick in range(1, 97):
        state = estimator.step(state, measured(tick, 0.002, 0.02), (1000.0, 1000.0))
    assert abs(state.z_m) < 0.003
    assert state.vz_mps == pytest.approx(0.0, abs=1e-6)


def test_steps_become_lateral_position_and_speed() -> None:
    estimator, state = Estimator(RIG), initial_estimate(0.0)
    for tick in range(1, 65):
        steps = math.floor(0.3 * tick * DT_S * RIG.stepper.steps_per_m)
        state = estimator.step(
            state, Measurement(tick * DT_S, math.nan, math.nan, 0, steps), (1000.0, 1000.0)
        )
    assert state.x_m == pytest.approx(0.6, abs=1e-3)
    assert state.vx_mps == pytest.approx(0.3, abs=0.02)
