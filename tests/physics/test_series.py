"""The compiled inner loops against dense Gaussian algebra, an ODE solver, and the plant's parts."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import multivariate_normal, norm

from wakedeploy.physics.jet import VerticalJet, paces, puff_shapes
from wakedeploy.physics.motor import Motor
from wakedeploy.physics.rail import GRAVITY_MPS2, RailBody
from wakedeploy.physics.series import (
    filtered,
    jet_along,
    mean_in_steps,
    puff_weights,
    rail_friction,
    sliding_and_resting,
    smoothed,
    spooled_thrust,
)
from wakedeploy.rig.file import default_rig

RIG = default_rig()
DT_S = 1.0 / 128.0
STEPS, START, STOP = 90, (4, 50), (44, 84)
KEEP, WHITE = 0.9, 0.05
NO_OUTLIERS, SOME_OUTLIERS = np.array([0.0, 1.0]), np.array([0.01, 0.1**2])
FIRST = np.diag([0.03**2, 0.3**2, 1.0])  # what the filter says it knows at first
NO_HORIZON = np.zeros(0, np.int64)


class Case:
    """A made-up flight with every term of the filter in use, and samples at uneven times."""

    def __init__(self, seed: int = 3) -> None:
        rng = np.random.default_rng(seed)
        t_s = DT_S * np.arange(STEPS)
        self.nominal = np.stack([0.5 + 0.1 * np.sin(5 * t_s), 0.5 * np.cos(5 * t_s)])
        self.acceleration = np.stack(
            [rng.normal(size=STEPS), -3.0 + rng.normal(size=STEPS), -1.0 - rng.random(STEPS)]
        )
        self.gain = 0.5 + rng.random(STEPS)
        # More than one sample in some steps, none in others, some outside the stretches.
        self.step_of = np.sort(rng.integers(0, STEPS, 40)).astype(np.int64)
        self.into_s = DT_S * rng.random(40)
        self.expected = np.stack([0.5 + 0.02 * rng.normal(size=40), 1.0 + 0.1 * rng.random(40)])
        self.reading = self.expected[0] + 0.03 * rng.normal(size=40)
        self.noise = (0.004 + 0.004 * rng.random(40)) ** 2

    def run(self, outlier=NO_OUTLIERS, horizons=NO_HORIZON, remember=False):
        return filtered(
            DT_S,
            np.array(START),
            np.array(STOP),
            self.nominal,
            self.acceleration,
            self.gain,
            KEEP,
            WHITE,
            self.step_of,
            self.into_s,
            self.reading,
            self.expected,
            self.noise,
            outlier,
            horizons,
            remember,
        )

    def dense(self, start: int, stop: int):
        """Mean (K, 3) and covariance (K, 3, K, 3) of all states before any reading."""
        count = stop - start
        mean, cov = np.zeros((count, 3)), np.zeros((count, 3, count, 3))
        mean[0, :2], cov[0, :, 0, :] = self.nominal[:, start], FIRST
        white = WHITE * np.array([[DT_S**3 / 3, DT_S**2 / 2], [DT_S**2 / 2, DT_S]])
        for i in range(count - 1):
            k = start + i
            a0, az, av = self.acceleration[:, k]
            slopes = np.array([az, av, self.gain[k]])
            rest = a0 - az * self.nominal[0, k] - av * self.nominal[1, k]
            f = np.array([[1.0, DT_S, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, KEEP]])
            f[0] += 0.5 * DT_S**2 * slopes
            f[1] += DT_S * slopes
            mean[i + 1] = f @ mean[i] + rest * np.array([0.5 * DT_S**2, DT_S, 0.0])
            cov[i + 1, :, : i + 1] = np.einsum("ab,bjc->ajc", f, cov[i, :, : i + 1])
            cov[: i + 1, :, i + 1] = np.moveaxis(cov[i + 1, :, : i + 1], 0, -1)
            own = f @ cov[i, :, i, :] @ f.T
            own[:2, :2] += white
            own[2, 2] += 1.0 - KEEP**2
            cov[i + 1, :, i + 1, :] = own
        return mean, cov

    def readings(self, start: int, stop: int):
        """The samples in a stretch, and how they read the states: H (m, K, 3), offset (m,)."""
        inside = np.flatnonzero((self.step_of >= start) & (self.step_of < stop))
        h = np.zeros((len(inside), stop - start, 3))
        offset = np.zeros(len(inside))
        for row, n in enumerate(inside):
            k = self.step_of[n]
            h[row, k - start, :2] = self.expected[1, n] * np.array([1.0, self.into_s[n]])
            offset[row] = self.expected[0, n] - h[row, k - start, :2] @ self.nominal[:, k]
        return inside, h, offset

    def given(self, start: int, stop: int, count: int | None = None):
        """Mean (K, 3) and covariance of the states given the stretch's first `count` readings."""
        mean, cov = self.dense(start, stop)
        inside, h, offset = self.readings(start, stop)
        inside, h, offset = inside[:count], h[:count], offset[:count]
        cross = np.einsum("ikjl,mjl->ikm", cov, h)
        own = np.einsum("mik,ikn->mn", h, cross) + np.diag(self.noise[inside])
        left = self.reading[inside] - offset - np.einsum("mik,ik->m", h, mean)
        gain = np.linalg.solve(own, np.moveaxis(cross, -1, 0).reshape(len(inside), -1))
        gain = gain.reshape(len(inside), *mean.shape)
        after = cov - np.einsum("ikm,mjl->ikjl", cross, gain)
        return mean + np.einsum("mik,m->ik", gain, left), after, left, own


@pytest.mark.slow
def test_the_summed_log_density_is_that_of_all_readings_together() -> None:
    case = Case()
    samples = case.run()[0]
    for start, stop in zip(START, STOP, strict=True):
        inside = case.readings(start, stop)[0]
        _, _, left, own = case.given(start, stop)
        together = multivariate_normal(cov=own).logpdf(left)
        assert len(inside) > 12
        assert samples[2, inside].sum() == pytest.approx(together, rel=1e-9)
        assert samples[3, inside] == pytest.approx(1.0)


def test_innovations_are_white_by_their_own_variance() -> None:
    """The squared innovations over their variances are the readings' Mahalanobis distance."""
    case = Case()
    samples = case.run()[0]
    inside = case.readings(START[0], STOP[0])[0]
    _, _, left, own = case.given(START[0], STOP[0])
    distance = left @ np.linalg.solve(own, left)
    assert (samples[0, inside] ** 2 / samples[1, inside]).sum() == pytest.approx(distance, rel=1e-9)
    assert np.log(samples[1, inside]).sum() == pytest.approx(np.linalg.slogdet(own)[1], rel=1e-9)


def test_samples_outside_the_stretches_are_left_alone() -> None:
    case = Case()
    samples = case.run()[0]
    inside = [case.readings(*ends)[0] for ends in zip(START, STOP, strict=True)]
    outside = np.setdiff1d(np.arange(40), np.concatenate(inside))
    assert len(outside) > 0
    assert (samples[:, outside] == 0.0).all()


def test_forecasts_are_the_conditional_means_without_further_readings() -> None:
    case, horizon = Case(), 9
    ahead = case.run(horizons=np.array([horizon]))[1]
    inside = case.readings(START[0], STOP[0])[0]
    for row, n in enumerate(inside):
        then = case.step_of[n] + horizon - START[0]
        if then >= STOP[0] - START[0]:
            assert np.isnan(ahead[:, n]).all()
            continue
        mean, cov, _, _ = case.given(START[0], STOP[0], row + 1)
        assert ahead[0, n] == pytest.approx(mean[then, 0], rel=1e-9)
        assert ahead[1, n] == pytest.approx(cov[then, 0, then, 0], rel=1e-7)


@pytest.mark.whole
def test_smoothed_states_are_the_conditional_means_given_everything() -> None:
    case = Case()
    _, _, states, covariances = case.run(remember=True)
    ends = np.array(START), np.array(STOP)
    path = smoothed(
        DT_S, *ends, states, covariances, case.nominal, case.acceleration, case.gain, KEEP, WHITE
    )
    for start, stop in zip(START, STOP, strict=True):
        mean = case.given(start, stop)[0]
        np.testing.assert_allclose(path[:, start:stop].T, mean, atol=1e-6)


def test_a_stray_reading_counts_for_nothing_and_costs_what_the_mixture_says() -> None:
    case = Case()
    _, _, calm, _ = case.run(SOME_OUTLIERS, remember=True)
    n = case.readings(START[0], STOP[0])[0][8]
    case.reading[n] += 0.3
    samples, _, states, _ = case.run(SOME_OUTLIERS, remember=True)
    e, variance, density, weight = samples[:, n]
    assert weight < 1e-3
    mixture = 0.99 * norm.pdf(e, scale=math.sqrt(variance))
    mixture += 0.01 * norm.pdf(e, scale=math.sqrt(variance + 0.1**2))
    assert density == pytest.approx(math.log(mixture), rel=1e-9)
    steps = slice(case.step_of[n], STOP[0])
    assert np.abs(states[0, steps] - calm[0, steps]).max() < 0.01


def test_readings_that_all_stray_alike_are_believed_in_the_end() -> None:
    """A filter that has lost the motion finds it again, with outliers or without."""
    case = Case()
    case.step_of = np.arange(START[1], STOP[1], dtype=np.int64)
    count = len(case.step_of)
    case.into_s, case.noise = np.zeros(count), np.full(count, 0.004**2)
    nominal = case.nominal[0, case.step_of]
    case.expected = np.stack([nominal, np.ones(count)])
    case.acceleration[:] = 0.0
    case.acceleration[0, 1:] = np.diff(case.nominal[1]) / DT_S
    jumped = np.where(np.arange(count) < 12, 0.0, 0.4)
    case.reading = nominal + jumped
    _, _, states, _ = case.run(SOME_OUTLIERS, remember=True)
    assert states[0, STOP[1] - 1] == pytest.approx(case.nominal[0, STOP[1] - 1] + 0.4, abs=0.02)


def test_the_likelihood_does_not_jump_where_strays_begin_to_be_believed() -> None:
    """Its slopes are differences: across a jump of some nats they would be nonsense."""
    case = Case()
    first = case.readings(START[0], STOP[0])[0][8]
    straight = case.reading.copy()
    totals = []
    for shift_m in np.linspace(0.0, 0.1, 2001):
        case.reading = straight.copy()
        case.reading[first : first + 5] += shift_m
        samples, *_ = case.run(SOME_OUTLIERS, remember=False)
        totals.append(samples[2].sum())
    assert np.abs(np.diff(totals, 2)).max() < 0.02


def commands(count: int, dt_s: float = DT_S) -> np.ndarray:
    """Square roots of commanded thrusts [√N] that rise and fall."""
    t_s = dt_s * np.arange(count)
    steps = np.where((t_s % 0.3) < 0.12, 2.6, 1.2)
    return steps + 0.3 * np.sin(9.0 * t_s)


@pytest.mark.parametrize(("up_s", "down_s"), [(0.06, 0.1), (0.2, 0.02)])
def test_spool_lag_is_the_solution_of_its_equation(up_s: float, down_s: float) -> None:
    target = commands(60)
    thrust = spooled_thrust(target, up_s, down_s, DT_S)
    state = [0.0, 0.0]  # rotor speed, and the integral of its square
    for k, wanted in enumerate(target):

        def rates(_, s, wanted=wanted):
            return [(wanted - s[0]) / (up_s if wanted > s[0] else down_s), s[0] ** 2]

        end = solve_ivp(rates, (0.0, DT_S), state, rtol=1e-10, atol=1e-12).y[:, -1]
        assert thrust[k] == pytest.approx((end[1] - state[1]) / DT_S, rel=1e-7)
        state = end.tolist()


def test_spool_lag_is_the_plants_motor() -> None:
    """The plant steps at another rate; its mean over a step is what the series gives."""
    fine, target = 64, commands(80)
    motor = Motor(RIG.thrust.sufferer, RIG.spool.sufferer)
    means = []
    for wanted in target:
        motor.target = wanted
        means.append(np.mean([motor.step(DT_S / fine) for _ in range(fine)]))
    lag = RIG.spool.sufferer
    assert spooled_thrust(target, lag.up_s, lag.down_s, DT_S) == pytest.approx(
        np.array(means), rel=1e-4
    )


def test_a_rotor_without_lag_follows_at_once() -> None:
    target = commands(40)
    assert spooled_thrust(target, 0.0, 0.0, DT_S) == pytest.approx(target**2, rel=1e-12)


def test_a_mean_in_steps_is_that_of_what_was_held() -> None:
    """Against the integral of the held values, interpolated between the edges."""
    rng = np.random.default_rng(3)
    from_s = np.cumsum(np.append(0.11, rng.uniform(0.0, 0.05, 60)))
    from_s[20] = from_s[19]  # a value that was replaced at once
    values = rng.uniform(-1.0, 1.0, len(from_s))
    edges_s = np.arange(0.0, 1.8, 0.0078125)
    area = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(from_s))])
    expected = np.diff(np.interp(edges_s, from_s, area)) / 0.0078125
    expected[(edges_s[:-1] < from_s[0]) | (edges_s[1:] > from_s[-1])] = 7.0
    assert mean_in_steps(edges_s, from_s, values, 7.0) == pytest.approx(expected, abs=1e-9)
    assert (expected == 7.0).sum() > 10


@pytest.mark.parametrize("exponent", [0.0, 0.3])
def test_the_jet_along_a_path_is_the_plants_jet(exponent: float) -> None:
    rig = RIG.changed(wake={"speed_exponent": exponent})
    rng = np.random.default_rng(5)
    count = 220
    thrust = 3.0 + 2.0 * np.sin(np.arange(count) / 9.0) + 0.2 * rng.random(count)
    x_m = 0.3 * np.sin(np.arange(count) / 31.0)
    z_m = 0.6 + 0.3 * np.sin(np.arange(count) / 17.0)
    root = np.sqrt(thrust / rig.wake.reference_thrust_n)
    ages_s = DT_S * (np.arange(count) + 0.5)
    weights = puff_weights(
        x_m,
        z_m - rig.source.height_m,
        rig.wake.speed_mps * paces(root, exponent),
        ages_s,
        *puff_shapes(rig.wake, ages_s, DT_S),
    )
    velocity, slope = jet_along(root, weights)
    jet = VerticalJet(rig.wake, rig.source.height_m, DT_S)
    expected, slopes = [], []
    for u, x, z in zip(thrust, x_m, z_m, strict=True):
        jet.inject(u)
        expected.append(jet.velocity(x, z))
        slopes.append((jet.velocity(x, z + 1e-4) - jet.velocity(x, z - 1e-4)) / 2e-4)
    assert np.abs(expected).max() > 3.0
    assert velocity == pytest.approx(np.array(expected), abs=1e-4)
    assert slope == pytest.approx(np.array(slopes), abs=1e-3)


@pytest.mark.parametrize("vz_mps", [-0.8, -0.2, 0.2, 0.8])
def test_friction_in_motion_is_the_plants(vz_mps: float) -> None:
    driving_n, dt_s, mass_kg = 0.5, 1e-4, RIG.sufferer.mass_kg
    body = RailBody(mass_kg, RIG.rail, RIG.sufferer.travel_m, z_m=0.5, vz_mps=vz_mps)
    body.step(driving_n + mass_kg * GRAVITY_MPS2, dt_s)
    resisting_n = driving_n - mass_kg * (body.vz_mps - vz_mps) / dt_s
    assert friction(vz_mps, driving_n) == pytest.approx(resisting_n, rel=1e-6)


@pytest.mark.parametrize("share", [-0.999, -0.9, -0.5, 0.0, 0.2, 0.999])
def test_a_resting_body_is_held_by_all_that_is_needed(share: float) -> None:
    """As on the plant's rail: what drives it, up to stiction; no smaller force moves it."""
    driving_n = share * RIG.rail.stiction_n
    body = RailBody(RIG.sufferer.mass_kg, RIG.rail, RIG.sufferer.travel_m, z_m=0.5)
    body.step(driving_n + body.mass_kg * GRAVITY_MPS2, 0.01)
    assert body.vz_mps == 0.0
    assert friction(0.0, driving_n) == pytest.approx(driving_n, abs=1e-12)
    assert abs(friction(0.0, 100.0 * driving_n)) <= RIG.rail.stiction_n


@pytest.mark.parametrize("times_stiction", [3.0, 8.0])
def test_a_strong_force_turns_a_body_round_as_on_the_plants_rail(times_stiction: float) -> None:
    """What only passes through zero is not held there, however slow it is for a moment."""
    driving_n, dt_s = times_stiction * RIG.rail.stiction_n, 1e-4
    body = RailBody(RIG.sufferer.mass_kg, RIG.rail, RIG.sufferer.travel_m, z_m=0.5, vz_mps=-0.05)
    taken, modelled = 0.0, 0.0  # impulses [N s], on the plant and by the smooth form
    while body.vz_mps < 0.05:
        before = body.vz_mps
        modelled += friction(before, driving_n) * dt_s
        body.step(driving_n + body.mass_kg * GRAVITY_MPS2, dt_s)
        taken += driving_n * dt_s - body.mass_kg * (body.vz_mps - before)
    held = RIG.rail.stiction_n * 0.012 * body.mass_kg / driving_n  # N s, while below 6 mm/s
    assert modelled == pytest.approx(taken, abs=0.2 * held)


@pytest.mark.parametrize("speed_mps", [0.0, 0.002, -0.005])
def test_friction_has_no_jump_where_a_force_breaks_loose(speed_mps: float) -> None:
    forces = [friction(speed_mps, f) for f in np.linspace(-0.4, 0.4, 4001)]
    assert np.abs(np.diff(forces)).max() < 0.001


def test_friction_is_odd_and_has_no_jumps() -> None:
    speeds = np.linspace(-0.2, 0.2, 4001)
    forces = [friction(v, 0.04) for v in speeds]
    assert np.abs(np.diff(forces)).max() < 0.002
    assert friction(0.03, 0.04) == pytest.approx(-friction(-0.03, -0.04), rel=1e-12)


def friction(vz_mps: float, driving_n: float) -> float:
    rail = RIG.rail
    vz = np.array([vz_mps])
    return rail_friction(
        vz,
        *sliding_and_resting(vz, 0.007, 0.006),
        np.array([driving_n]),
        rail.coulomb_n,
        rail.viscous_n_per_mps,
        rail.stiction_n,
    )[0]
