"""The smoother against a dense least-squares solution of the same problem, and its honesty."""

import itertools
import math

import numpy as np
import pytest
from scipy.linalg import expm

from runtime.smoother import (
    _START_SD,
    MAX_STEP_S,
    Flight,
    ForceModel,
    _Steps,
    fit,
    known_motion,
    smooth,
)

MASS_KG = 0.45
MODELS = [ForceModel(0.3, 0.4, 0.004), ForceModel(0.15, 0.2, 0.006, activity=0.9)]


def continuous(model: ForceModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Drift, driving noise and starting variances, written down anew from the definitions."""
    k = 1.0 / model.time_s
    drift = np.zeros((4, 4))
    drift[0, 1], drift[1, 2], drift[2, 3] = 1, 1 / MASS_KG, 1
    drift[3, 2:] = -(k**2), -2 * k
    force = np.array([model.sd_n**2, model.sd_n**2 * k**2])
    return drift, np.diag([0, 0, 0, 4 * model.sd_n**2 * k**3]), force


def exact(model: ForceModel, dt_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and noise over `dt_s` by Van Loan's matrix exponential."""
    drift, drive, _ = continuous(model)
    n = len(drift)
    block = np.block([[-drift, drive], [np.zeros((n, n)), drift.T]]) * dt_s
    e = expm(block)
    transition = e[n:, n:].T
    return transition, transition @ e[:n, n:]


@pytest.mark.parametrize("model", [*MODELS, ForceModel(0.1, 1.0, 0.004)])
@pytest.mark.parametrize("dt_s", [0.0, 1e-6, 0.01, 0.031, MAX_STEP_S])
def test_steps_agree_with_the_matrix_exponential(model: ForceModel, dt_s: float) -> None:
    transition, noise = _Steps([model], MASS_KG).at(dt_s)
    expected_transition, expected_noise = exact(model, dt_s)
    np.testing.assert_allclose(transition[0], expected_transition, rtol=1e-7, atol=1e-7)
    scale = np.sqrt(np.outer(np.diag(expected_noise), np.diag(expected_noise))) + 1e-30
    np.testing.assert_allclose(noise[0] / scale, expected_noise / scale, atol=1e-6)


def activity(t_s: np.ndarray | float) -> np.ndarray:
    return 1.0 + 0.95 * np.sin(2.0 * np.asarray(t_s))


def liveliness(model: ForceModel, t_s: float) -> float:
    return 1.0 - model.activity + model.activity * float(activity(t_s))


def draw(model: ForceModel, seconds: float, seed: int) -> tuple[Flight, np.ndarray, np.ndarray]:
    """A flight drawn from the model itself: (flight, true force (T,), true height (T,))."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, seconds, 1 / 32) + 0.0003 * rng.standard_normal(round(seconds * 32))
    sample_s = np.sort(t_s[1:] - rng.uniform(0.008, 0.03, len(t_s) - 1))
    _, _, force_variance = continuous(model)
    n = 4
    state = np.zeros(n)
    state[0] = 0.3
    state[2:] = np.sqrt(force_variance) * rng.standard_normal(n - 2)
    times = np.unique(np.concatenate([t_s, sample_s]))
    states = {times[0]: state}
    for before, now in itertools.pairwise(times):
        transition, noise = exact(model, now - before)
        noise *= liveliness(model, 0.5 * (before + now))
        root = np.linalg.cholesky(noise + 1e-18 * np.eye(n))
        state = transition @ state + root @ rng.standard_normal(n)
        states[now] = state
    known_s = np.arange(t_s[0] - 0.01, t_s[-1] + 0.01, 0.001)
    thrust = 0.5 * np.sin(3.0 * known_s)
    speed, height = known_motion(known_s, thrust)
    at = np.interp(sample_s, known_s, height)
    measured = np.array([states[t][0] for t in sample_s]) + at
    measured += model.range_sd_m * rng.standard_normal(len(measured))
    flight = Flight(t_s, sample_s, measured, known_s, speed, height, activity(t_s))
    truth = np.array([states[t] for t in t_s])
    return flight, truth[:, 2], truth[:, 0] + np.interp(t_s, known_s, height)


@pytest.mark.parametrize("model", MODELS)
def test_it_is_the_dense_least_squares_solution(model: ForceModel) -> None:
    """All states at once: one row for each transition and each sample, weighted, solved by QR."""
    flight, _, _ = draw(model, 3.0, seed=1)
    result = smooth(flight, model, MASS_KG)
    times = np.concatenate([flight.t_s, flight.sample_s])
    order = np.argsort(times, kind="stable")
    n, force_variance = 4, continuous(model)[2]
    expected = np.interp(flight.sample_s, flight.known_s, flight.known_height_m)
    deviation = np.concatenate([np.full(len(flight.t_s), np.nan), flight.height_m - expected])[
        order
    ]
    rows, right = [], []

    def add(blocks: dict[int, np.ndarray], value: np.ndarray, covariance: np.ndarray) -> None:
        weight = np.linalg.inv(np.linalg.cholesky(covariance))
        row = np.zeros((len(value), n * len(order)))
        for event, block in blocks.items():
            row[:, n * event : n * event + n] = weight @ block
        rows.append(row)
        right.append(weight @ value)

    start = np.zeros(n)
    start[0] = np.median(deviation[np.isfinite(deviation)][:3])
    add({0: np.eye(n)}, start, np.diag([*np.square(_START_SD), *force_variance]))
    steps = np.diff(times[order])
    for event, dt in enumerate(steps, 1):
        transition, noise = exact(model, dt)
        middle = times[order][event] - 0.5 * dt
        noise *= (
            1.0 - model.activity + model.activity * np.interp(middle, flight.t_s, flight.activity)
        )
        add({event - 1: -transition, event: np.eye(n)}, np.zeros(n), noise + 1e-16 * np.eye(n))
    for event in np.flatnonzero(np.isfinite(deviation)):
        height = np.eye(1, n)
        add({event: height}, deviation[[event]], np.array([[model.range_sd_m**2]]))
    matrix, value = np.vstack(rows), np.concatenate(right)
    solution, *_ = np.linalg.lstsq(matrix, value, rcond=None)
    covariance = np.linalg.pinv(matrix)
    covariance = covariance @ covariance.T
    ticks = np.flatnonzero(np.isnan(deviation)) * n
    np.testing.assert_allclose(result.force_n, solution[ticks + 2], atol=2e-4)
    sd = np.sqrt(np.diag(covariance)[ticks + 2])
    np.testing.assert_allclose(result.force_sd_n, sd, rtol=2e-3)
    speed = np.interp(flight.t_s, flight.known_s, flight.known_speed_mps) + solution[ticks + 1]
    np.testing.assert_allclose(result.speed_mps, speed, atol=1e-4)


@pytest.mark.whole
@pytest.mark.parametrize("model", MODELS)
def test_stated_standard_deviations_are_the_errors(model: ForceModel) -> None:
    scores, heights = [], []
    for seed in range(6):
        flight, force_n, height_m = draw(model, 15.0, seed)
        result = smooth(flight, model, MASS_KG)
        scores.append((result.force_n - force_n) / result.force_sd_n)
        heights.append(result.height_m - height_m)
    covered = np.mean(np.abs(np.concatenate(scores)) < 1.645)
    assert 0.86 < covered < 0.94
    assert np.sqrt(np.mean(np.square(heights))) < 0.5 * model.range_sd_m


def test_outliers_are_left_out() -> None:
    model = MODELS[0]
    flight, force_n, _ = draw(model, 15.0, seed=3)
    strays = np.random.default_rng(0).choice(len(flight.height_m), 12, replace=False)
    flight.height_m[strays] += np.where(strays % 2, 0.12, -0.2)
    result = smooth(flight, model, MASS_KG)
    assert 10 <= result.rejected <= 14
    assert np.sqrt(np.mean((result.force_n - force_n) ** 2)) < 1.3 * result.force_sd_n.mean()


def test_a_gap_without_samples_is_predicted_through_with_wider_bounds() -> None:
    model = MODELS[0]
    flight, force_n, _ = draw(model, 10.0, seed=4)
    gap = (flight.sample_s > 5.0) & (flight.sample_s < 5.4)
    kept = Flight(
        flight.t_s,
        flight.sample_s[~gap],
        flight.height_m[~gap],
        flight.known_s,
        flight.known_speed_mps,
        flight.known_height_m,
        flight.activity,
    )
    result = smooth(kept, model, MASS_KG)
    inside = (flight.t_s > 5.1) & (flight.t_s < 5.3)
    assert result.force_sd_n[inside].min() > 1.2 * np.median(result.force_sd_n)
    assert np.max(np.abs(result.force_n - force_n)[inside] / result.force_sd_n[inside]) < 4.0


def test_causal_estimates_do_not_look_ahead() -> None:
    model = MODELS[0]
    flight, _, _ = draw(model, 4.0, seed=5)
    before = smooth(flight, model, MASS_KG)
    late = flight.sample_s > 2.0
    flight.height_m[late] += 0.02
    after = smooth(flight, model, MASS_KG)
    early = flight.t_s <= 2.0
    np.testing.assert_array_equal(after.causal_speed_mps[early], before.causal_speed_mps[early])
    assert np.abs(after.speed_mps - before.speed_mps)[early].max() > 1e-3


@pytest.mark.whole
@pytest.mark.parametrize(
    "model", [ForceModel(0.2, 0.25, 0.004), ForceModel(0.4, 0.5, 0.0056, activity=0.99)]
)
def test_the_fit_finds_the_model_that_made_the_flights(model: ForceModel) -> None:
    flights = [draw(model, 20.0, seed)[0] for seed in range(4)]
    found = fit(flights, 0.004, MASS_KG)
    assert (found.activity > 0.5) == (model.activity > 0.5)
    assert abs(math.log(found.time_s / model.time_s)) < 0.7
    assert abs(math.log(found.sd_n / model.sd_n)) < 0.8
    assert found.range_sd_m == pytest.approx(model.range_sd_m, rel=0.3)


def test_known_motion_is_exact_for_linear_acceleration() -> None:
    t = np.linspace(0.0, 2.0, 41)
    speed, height = known_motion(t, 3.0 - 2.0 * t)
    np.testing.assert_allclose(speed, 3.0 * t - t**2, atol=1e-12)
    np.testing.assert_allclose(height, 1.5 * t**2 - t**3 / 3.0, atol=1e-12)
