"""Generic fits against linear-Gaussian closed forms, and intervals against simulated truths."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from linear_model import EPISODES, Linear
from scipy.optimize import minimize
from scipy.stats import norm
from scipy.stats import t as student_t

from wakedeploy.gap.evidence import inference
from wakedeploy.gap.evidence.ascent import Ascent, slopes_at, top_within
from wakedeploy.gap.evidence.fits import (
    LOST_NATS,
    Free,
    Score,
    extended,
    log_prior,
    neutral,
    told_by_data,
)
from wakedeploy.gap.evidence.inference import fit, held_out, settled

EVERY = range(EPISODES)
TRUTH = {"gain": 0.7, "offset": -0.5, "a": 0.6}


@pytest.mark.parametrize("hypothesis", [(), ("a",), ("a", "b", "c")])
def test_a_fit_is_the_posterior_mean(hypothesis) -> None:
    model = Linear(TRUTH)
    fitted = fit(model, hypothesis, EVERY)
    mean, covariance = model.posterior(hypothesis)
    away = fitted.theta - mean
    # A fit ends when a step promises less than 0.02 nats, and never gets closer on purpose.
    assert 0.5 * away @ np.linalg.solve(covariance, away) < 0.02
    assert fitted.log_likelihood == pytest.approx(
        sum(model.score(hypothesis, mean, e).log_density.sum() for e in EVERY), abs=0.3
    )
    assert fitted.log_prior == pytest.approx(model.prior_nats(hypothesis), abs=0.3)
    assert fitted.objective == pytest.approx(fitted.per_episode.sum() + fitted.log_prior)


def test_a_fit_ends_as_near_as_it_is_told_to() -> None:
    model = Linear(TRUTH)
    mean, covariance = model.posterior(("a",))
    for enough_nats in (1e-3, 1e-6):
        away = fit(model, ("a",), EVERY, enough_nats=enough_nats).theta - mean
        assert 0.5 * away @ np.linalg.solve(covariance, away) < enough_nats


class Hovering(Linear):
    """A thrust u moves a mass m by (1 + e) u / m: precise readings tell next to only the ratio."""

    SD = 1e-4

    def __init__(self) -> None:
        super().__init__({})
        rng = np.random.default_rng(3)
        self.thrust = 8.0 + rng.standard_normal((EPISODES, 60))
        self.read = self.thrust * 0.6 / 0.5 + self.SD * rng.standard_normal((EPISODES, 60))

    def free(self, hypothesis):
        mass = Free("mass", "kg", 0.5, 0.01, 0.1, 2.0, 2e-4)
        return (mass, Free("gain.error", "1", 0.0, np.inf, -0.9, 5.0, 1e-3, (0.1,)))

    def score(self, hypothesis, theta, episode):
        mass, error = theta
        rest = self.read[episode] - self.thrust[episode] * (1.0 + error) / mass
        variance = np.full(len(rest), self.SD**2)
        return Score(norm.logpdf(rest, scale=self.SD), rest, variance, np.ones(len(rest)))


def test_a_fit_follows_a_narrow_ridge_to_its_top() -> None:
    """Where a constant has bent to what was missing, the ridge back is a thousandth as wide as
    a finite difference reaches."""
    model = Hovering()
    begun = fit(model, ("gain",), EVERY, np.array([0.7, -0.16]))
    fitted, still = settled(model, begun)
    assert begun.value("mass") > 0.55  # a plain climb ends on the way
    assert still
    ratio = float((model.read * model.thrust).sum() / (model.thrust**2).sum())
    # Along the ridge only the prior speaks, of sd 0.01 kg: half a nat from the stated mass.
    assert fitted.value("mass") == pytest.approx(0.5, abs=0.01)
    assert (1.0 + fitted.value("gain.error")) / fitted.value("mass") == pytest.approx(
        ratio, abs=1e-5
    )


class Forecasting(Hovering):
    """The same with forecasts, which err as far as the mass is from a true one.

    Two readings of the mass turn while they shrink along a spiral, so that a straight line promises
    a small part of what there is to gain.
    """

    def __init__(self, true_kg: float) -> None:
        super().__init__()
        self.true_kg = true_kg

    def free(self, hypothesis):
        mass, error = super().free(hypothesis)
        return replace(mass, prior_sd=1.0), error

    def score(self, hypothesis, theta, episode):
        away = (theta[0] - 0.5) / 0.01
        turned = 0.3 * away * np.array([np.cos(0.3 * away), np.sin(0.3 * away)])
        scored = super().score(hypothesis, theta, episode)
        rest = np.append(scored.innovation, turned)
        density = np.append(scored.log_density, norm.logpdf(turned))
        return Score(density, rest, np.append(scored.variance, [1.0, 1.0]), np.ones(len(rest)))

    def disagreements(self, fitted, episodes):
        return [np.full((1, 60), fitted.value("mass") - self.true_kg) for _ in episodes]


@pytest.mark.parametrize("true_kg", [0.5, 0.7])
def test_a_fit_goes_along_a_ridge_unless_forecasts_get_worse(true_kg: float) -> None:
    """Where they do it has left the ridge for another summit: a servo was said to hardly move."""
    model = Forecasting(true_kg)
    begun = fit(model, ("gain",), EVERY, np.array([0.7, -0.16]))
    fitted, still = settled(model, begun)
    assert still
    assert fitted.value("mass") == pytest.approx(true_kg, abs=0.02)


@pytest.mark.parametrize(
    ("before", "after", "is_worse"),
    [
        ([[1.0, 1.0]], [[1.02, 1.02]], False),
        ([[1.0, 1.0]], [[1.2, 1.2]], True),
        ([[1.0, 1.0]], [[1.0, np.nan]], True),  # what ran away is no forecast without error
        ([[1.0, 1.0]], [[np.inf, 1.0]], True),
        ([[np.nan, 1.0]], [[1e9, 1.0]], False),  # nothing was predicted there
        ([[0.0, 0.0], [1.0, 1.0]], [[9.0, 9.0], [1.0, 1.0]], True),
        ([[1e-9, 1e-9], [1.0, 1.0]], [[2e-9, 2e-9], [0.1, 0.1]], False),
        ([[0.0, 0.0]], [[0.0, 0.0]], False),
    ],
)
def test_worse_forecasts_are_worse_on_average_or_no_numbers(before, after, is_worse) -> None:
    class Erring(Linear):
        def disagreements(self, fitted, episodes):
            return [np.array(fitted)]

    class Errors(list):
        episodes = (0,)

    judged = inference._forecasts_get_worse(Erring(TRUTH), Errors(before), Errors(after))
    assert judged is is_worse


class Breaking(Hovering):
    """The same, but that readings beside the ridge are none."""

    def score(self, hypothesis, theta, episode):
        scored = super().score(hypothesis, theta, episode)
        if abs((1.0 + theta[1]) / theta[0] - 1.2) > 1e-7:
            return replace(scored, innovation=np.full(60, np.inf))
        return scored


def test_a_ridge_beside_which_nothing_is_a_number_is_not_left() -> None:
    model = Breaking()
    theta = np.array([0.6, 0.6 * 1.2 - 1.0])
    ascent = Ascent(model, ("gain",), model.free(("gain",)), tuple(EVERY), None, -np.inf, 0.05)
    with np.errstate(all="ignore"):
        assert np.array_equal(ascent.along_ridge(theta).theta, theta)


class Thought(Linear):
    """The same, with an effect that was thought to be about so large before."""

    def __init__(self, sd: float) -> None:
        super().__init__(TRUTH)
        self.sd = sd

    def free(self, hypothesis):
        free = super().free(hypothesis)
        return tuple(f if f.quantity else replace(f, prior_sd=self.sd) for f in free)


def test_the_size_that_data_tell_is_not_drawn_to_what_was_thought_before() -> None:
    near = fit(Thought(0.1), ("a",), EVERY, enough_nats=1e-9)
    told = told_by_data(near, "a")
    mean, covariance = Thought(np.inf).posterior(("a",))
    assert abs(near.value("a.size")) < 0.95 * abs(mean[-1])
    assert told.theta == pytest.approx(mean, abs=1e-3)
    assert told._variances("a.size")[0] == pytest.approx(covariance[-1, -1], rel=1e-3)
    assert told_by_data(told, "a") is told


def test_what_the_data_do_not_tell_stays_where_it_was_thought_to_be() -> None:
    near = fit(Thought(0.01), ("a",), EVERY)
    assert told_by_data(near, "a") is near


class Twins:
    """Readings that tell the sum of an effect's two parameters, and nothing of their difference."""

    episodes = 4

    def free(self, hypothesis):
        return tuple(Free(f"e.{n}", "1", 0.0, 1.0, -9.0, 9.0, 0.01) for n in ("one", "two"))

    def score(self, hypothesis, theta, episode):
        rest = np.random.default_rng(episode).standard_normal(50) + 3.0 - theta.sum()
        return Score(norm.logpdf(rest), rest, np.ones(50), np.ones(50))


def test_what_only_priors_tell_apart_keeps_a_prior() -> None:
    told = told_by_data(fit(Twins(), ("e",), range(4)), "e")
    assert any(np.isfinite(f.prior_sd) for f in told.free)
    assert min(told.standard_error(n) for n in ("e.one", "e.two")) > 0.5
    assert told.theta.sum() == pytest.approx(3.0, abs=0.3)


class LargeResiduals:
    """Residuals of which a straight line knows a fiftieth of the curvature (Fletcher's example)."""

    episodes = 1

    def free(self, hypothesis):
        return tuple(Free(n, "1", 0.0, np.inf, -5.0, 5.0, 1e-6) for n in "xy")

    def score(self, hypothesis, theta, episode):
        pairs = [(at + 1.0, -50.0 * at**2 + at - 1.0) for at in theta]
        rest = 20.0 * np.array([*sum(pairs, ()), theta.sum()])
        return Score(norm.logpdf(rest), rest, np.ones(5), np.ones(5))


def test_a_climb_with_fresh_slopes_learns_the_curvature_that_it_lacks() -> None:
    """The top is at 0 in closed form; without learning a climb swings about it to its last step."""
    fitted = fit(LargeResiduals(), (), (0,), np.array([0.3, -0.2]), enough_nats=1e-7)
    assert fitted.converged
    assert np.abs(fitted.theta).max() < 1e-5


class Counted(LargeResiduals):
    """It scores up to `room` sets at once, and counts how often it is asked, and for how many."""

    def __init__(self, room: int) -> None:
        self.room, self.asked, self.sets = room, 0, 0

    def sets_at_once(self, episodes):
        return self.room

    def scores(self, hypothesis, thetas, episodes):
        self.asked += 1
        self.sets += len(thetas)
        return [tuple(self.score(hypothesis, theta, e) for e in episodes) for theta in thetas]


@pytest.mark.parametrize("enough_nats", [None, 1e-6])
def test_what_is_scored_at_once_leads_to_the_same_top_with_fewer_questions(enough_nats) -> None:
    """A step comes with its slopes, and with three shorter ones should it gain nothing."""
    begun = np.array([4.0, -3.0])
    alone, ahead, narrow = Counted(1), Counted(9), Counted(4)
    there = [fit(m, (), (0,), begun, enough_nats=enough_nats) for m in (alone, ahead, narrow)]
    for other in there[1:]:
        assert other.theta.tobytes() == there[0].theta.tobytes()
        assert other.converged == there[0].converged
    assert ahead.asked <= narrow.asked <= alone.asked
    assert ahead.asked < 0.75 * alone.asked
    assert alone.sets <= narrow.sets <= ahead.sets


@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 6))
def test_the_top_within_bounds_is_one(seed: int, size: int) -> None:
    """Against a general solver, ridges and scales of many orders included."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-4.0, 4.0, size)
    root = rng.standard_normal((size, size)) * 10.0 ** rng.uniform(-2.0, 0.0, size)[:, None]
    curvature = (root.T @ root + 1e-4 * np.eye(size)) * scale[:, None] * scale[None, :]
    gradient, theta = scale * rng.standard_normal(size), rng.standard_normal(size) / scale
    low, high = (theta + sign * rng.uniform(0.0, 2.0, size) / scale for sign in (-1.0, 1.0))
    low = np.where(rng.random(size) < 0.2, theta, low)
    high = np.where(rng.random(size) < 0.2, theta, high)
    top = top_within(theta, gradient, curvature, low, high)
    assert ((low <= top) & (top <= high)).all()

    def below(step):
        return 0.5 * step @ curvature @ step - gradient @ step

    best = minimize(
        lambda at: below(at / scale),
        np.zeros(size),
        jac=lambda at: (curvature @ (at / scale) - gradient) / scale,
        bounds=list(zip((low - theta) * scale, (high - theta) * scale, strict=True)),
        method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-10, "maxiter": 5000},
    )
    assert below(top - theta) <= best.fun + 1e-6 * max(1.0, abs(best.fun))
    for end in (low, high):  # what is stopped is so to the last digit
        assert (top == end)[np.abs(top - end) * scale < 1e-12].all()


def test_what_is_not_finite_or_has_no_room_stays() -> None:
    theta, high = np.array([0.1, 0.2]), np.array([0.1, 3.0])
    top = top_within(theta, np.ones(2), np.eye(2), theta, high)
    np.testing.assert_allclose(top, [0.1, 1.2])
    for gradient in (np.array([np.nan, 1.0]), np.array([1.0, np.inf])):
        assert (top_within(theta, gradient, np.eye(2), theta - 1.0, high) == theta).all()
    nothing = np.zeros(0)
    assert top_within(nothing, nothing, np.zeros((0, 0)), nothing, nothing).size == 0


@pytest.mark.parametrize(
    ("moving", "step_sd", "rise_nats", "is_at_rest"),
    [
        ("a.size", 0.3, 1.0, False),
        ("a.size", 0.05, 1.0, True),
        ("a.size", 0.3, 0.05, True),
        ("offset", 0.3, 1.0, True),
    ],
)
def test_only_a_size_that_still_moves_keeps_a_fit_from_rest(
    moving, step_sd, rise_nats, is_at_rest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Refits that creep on, by a parameter of the effect itself or by one beside it."""
    begun = fit(Linear(TRUTH), ("a",), EVERY)
    names = {"a": "a.size"}
    free = (replace(f, name=names.get(f.name, f.name), prior_sd=np.inf) for f in begun.free)
    begun = replace(begun, free=tuple(free))
    at = begun.names.index(moving)
    step = step_sd * begun.standard_error(moving) * np.eye(len(begun.names))[at]

    def crept(model, hypothesis, episodes, start, enough_nats):
        refits = round((start - begun.theta)[at] / step[at]) + 1
        risen = begun.per_episode + refits * rise_nats / EPISODES
        return replace(begun, theta=start + step, per_episode=risen)

    monkeypatch.setattr(inference, "fit", crept)
    fitted, at_rest = settled(Linear(TRUTH), begun)
    assert at_rest is is_at_rest
    assert fitted.theta[at] > begun.theta[at]  # it went on as long as it was worth it


@pytest.mark.parametrize("own", [("a",), ("b", "c"), ("a", "b", "c")])
def test_held_out_densities_are_exact_where_everything_is_linear(own) -> None:
    model = Linear(TRUTH, seed=4)
    shared = tuple(n for n in ("a",) if n not in own)
    whole = (*shared, *own)
    # From the exact optimum, which a fit does not seek out on purpose.
    base, larger = (fit(model, h, EVERY, model.posterior(h)[0]) for h in (shared, whole))
    expected = model.unseen_density(whole, own) - model.seen_density(shared)
    assert held_out(base, larger) == pytest.approx(expected, abs=1e-4)


def test_an_effect_without_truth_costs_what_its_parameters_fit_by_chance() -> None:
    """Half a nat each on the data that they were fitted to, and as much on others."""
    gains, seen = [], []
    for seed in range(60):
        model = Linear({}, seed=500 + seed)
        base, larger = fit(model, (), EVERY), fit(model, ("a", "c"), EVERY)
        gains.append(held_out(base, larger).sum())
        seen.append((larger.per_episode - base.per_episode).sum())
    assert np.mean(seen) == pytest.approx(1.0, abs=0.4)
    # Leaving each of E episodes out costs 1 + 1/(2 (E - 1)) nats a parameter.
    assert np.mean(seen) - np.mean(gains) == pytest.approx(2.25, abs=0.5)
    assert np.max(np.subtract(gains, seen)) < 0.0


def test_a_parameter_at_its_bound_follows_no_episode() -> None:
    """It was not fitted to any, however much the others would like it to be elsewhere."""
    model = Linear({"a": 0.8}, seed=4, bounds={"a": (-0.5, 0.3)})
    base, larger = fit(model, (), EVERY), fit(model, ("a",), EVERY)
    assert larger.value("a.size") == 0.3
    assert held_out(base, larger) == pytest.approx(larger.per_episode - base.per_episode)


def test_fits_of_different_episodes_are_not_compared() -> None:
    model = Linear(TRUTH)
    with pytest.raises(ValueError, match="not comparable"):
        held_out(fit(model, (), [0, 1]), fit(model, ("a",), EVERY))


def test_some_of_the_episodes_can_be_fitted_alone() -> None:
    model = Linear(TRUTH)
    fitted = fit(model, ("a",), [0, 1, 3, 4])
    mean, covariance = model.posterior(("a",), left_out=2)
    away = fitted.theta - mean
    assert fitted.episodes == (0, 1, 3, 4)
    assert 0.5 * away @ np.linalg.solve(covariance, away) < 0.02


def test_an_effect_of_one_episode_alone_gains_little_elsewhere() -> None:
    """What fits nothing but one strange episode is paid for by leaving that one out."""
    model = Linear({})
    model.columns["a"] = np.where(np.arange(EPISODES)[:, None] == 2, model.columns["a"], 0.0)
    model.y[2] += 2.0 * model.columns["a"][2]
    base, larger = fit(model, (), EVERY), fit(model, ("a",), EVERY)
    assert (larger.per_episode - base.per_episode).sum() > 50.0
    # The prior alone, of deviation 3, would take it 2/9 of a nat away from nothing.
    assert held_out(base, larger)[2] < 20.0


def test_a_jump_costs_no_more_than_the_worst_sample() -> None:
    """A finite difference across a sensor's end is as large as its step is small."""
    model = Linear(TRUTH, seed=4)
    base, larger = fit(model, (), EVERY), fit(model, ("a",), EVERY)
    innovation = list(larger.slopes.innovation)
    innovation[2] = innovation[2] * 1e9
    jumps = replace(larger, slopes=replace(larger.slopes, innovation=tuple(innovation)))
    gains = held_out(base, jumps)
    assert gains[2] == pytest.approx(LOST_NATS, rel=1e-3)
    assert np.all(np.delete(gains, 2) > -100.0)
    looked_at = held_out(base, jumps, model)
    assert looked_at == pytest.approx(held_out(base, larger), abs=5.0)  # the model has no jump
    assert held_out(base, larger, model) == pytest.approx(held_out(base, larger), abs=1e-9)


@pytest.mark.parametrize("density", [-1e9, np.nan])
def test_a_state_that_is_lost_at_the_end_of_a_step_costs_what_the_worst_sample_may(density) -> None:
    class Lost(Linear):
        def score(self, hypothesis, theta, episode):
            score = super().score(hypothesis, theta, episode)
            return replace(score, log_density=score.log_density + density)

    base, larger = (fit(Linear(TRUTH, seed=4), h, EVERY) for h in ((), ("a",)))
    innovation = list(larger.slopes.innovation)
    innovation[2] = innovation[2] * 1e9
    jumps = replace(larger, slopes=replace(larger.slopes, innovation=tuple(innovation)))
    seen = larger.per_episode[2] - base.per_episode[2]
    assert held_out(base, jumps, Lost(TRUTH, seed=4))[2] == pytest.approx(seen + LOST_NATS)


def test_a_bound_holds_and_the_rest_is_fitted_under_it() -> None:
    model = Linear(TRUTH, bounds={"a": (0.0, 0.2)})
    fitted = fit(model, ("a",), EVERY)
    assert fitted.value("a.size") == 0.2
    under = Linear(TRUTH)
    under.y = under.y - 0.2 * under.columns["a"]
    mean, covariance = under.posterior(())
    away = fitted.theta[:2] - mean
    assert 0.5 * away @ np.linalg.solve(covariance, away) < 0.02
    low, high = fitted.interval("a.size")
    assert low < 0.2
    assert high == 0.2


def test_a_flat_prior_says_nothing() -> None:
    model = Linear({"gain": 2.0}, priors={"gain": (0.0, np.inf)})
    x, y, weight = model.stacked((), list(EVERY))
    least_squares = (weight * y) @ x[:, 0] / ((weight * x[:, 0]) @ x[:, 0])
    fitted = fit(model, (), EVERY)
    assert fitted.value("gain") == pytest.approx(least_squares, abs=0.01)
    assert fitted.log_prior == 0.0


def test_what_is_not_free_has_no_value() -> None:
    with pytest.raises(KeyError, match=r"a\.size"):
        fit(Linear(TRUTH), (), EVERY).value("a.size")


class Curved:
    """Readings whose mean and variance are curved in two parameters."""

    episodes = 3

    def __init__(self, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.t = rng.random((3, 200))
        self.y = np.sin(1.3 * self.t) + np.exp(-1.0) * rng.standard_normal((3, 200))

    def free(self, hypothesis):
        return (
            Free("rate", "1", 1.0, 1.0, 0.0, 3.0, 1e-4),
            Free("log_noise", "", 0.0, np.inf, -5.0, 3.0, 1e-4),
        )

    def score(self, hypothesis, theta, episode):
        e = self.y[episode] - np.sin(theta[0] * self.t[episode])
        deviation = np.exp(theta[1]) * np.ones(len(e))
        return Score(norm.logpdf(e, scale=deviation), e, deviation**2, np.ones(len(e)))


def test_gradients_are_derivatives_of_the_log_likelihood() -> None:
    model, theta, size = Curved(), np.array([1.1, -0.8]), 1e-5
    gradient = slopes_at(model, (), (0, 2), theta).gradient()
    for row, episode in enumerate((0, 2)):
        for k in range(2):
            moved = [theta + sign * size * np.eye(2)[k] for sign in (1, -1)]
            up, down = (model.score((), m, episode).log_density.sum() for m in moved)
            assert gradient[row, k] == pytest.approx((up - down) / (2 * size), rel=1e-2, abs=0.05)


def test_fisher_information_is_the_variance_of_the_gradient() -> None:
    truth = np.array([1.3, -1.0])
    gradients = [slopes_at(Curved(seed), (), (0,), truth).gradient()[0] for seed in range(400)]
    fisher = slopes_at(Curved(), (), (0,), truth).fisher()[0]
    assert np.diag(np.cov(np.array(gradients).T)) == pytest.approx(np.diag(fisher), rel=0.25)


def test_noise_is_fitted_with_the_rest() -> None:
    model = Curved()
    fitted = fit(model, (), range(3))
    e = np.concatenate([model.score((), fitted.theta, i).innovation for i in range(3)])
    deviation = 1.0 / np.sqrt(2 * len(e))  # of the logarithm of an estimated noise
    assert fitted.value("log_noise") == pytest.approx(np.log(e.std()), abs=0.2 * deviation)
    assert fitted.value("rate") == pytest.approx(1.3, abs=0.15)


def test_slopes_can_be_renewed_in_part() -> None:
    model, here, there = Curved(), np.array([1.0, -0.5]), np.array([1.4, -1.0])
    old, fresh = (slopes_at(model, (), (0, 1), theta) for theta in (here, there))
    mixed = slopes_at(model, (), (0, 1), there, (old, [0]))
    for i in range(2):
        assert (mixed.innovation[i][:, 0] == fresh.innovation[i][:, 0]).all()
        assert (mixed.variance[i][:, 1] == old.variance[i][:, 1]).all()
        assert (mixed.scores[i].innovation == fresh.scores[i].innovation).all()


class Clustered:
    """A mean under noise of which some is shared by a whole episode, which the model ignores."""

    def __init__(self, shared_sd: float, seed: int, episodes: int = 5, samples: int = 16) -> None:
        rng = np.random.default_rng([7, seed])
        self.y = rng.standard_normal((episodes, samples))
        self.y += shared_sd * rng.standard_normal((episodes, 1))

    @property
    def episodes(self) -> int:
        return len(self.y)

    def free(self, hypothesis):
        return (Free("mean", "1", 0.0, np.inf, -50.0, 50.0, 0.01),)

    def score(self, hypothesis, theta, episode):
        e = self.y[episode] - theta[0]
        one = np.ones(len(e))
        return Score(norm.logpdf(e), e, one, one)


@pytest.mark.whole
@pytest.mark.parametrize("shared_sd", [0.0, pytest.param(0.25, marks=pytest.mark.slow), 1.0])
def test_intervals_hold_the_truth_as_often_as_they_say(shared_sd: float) -> None:
    """Also where flights differ by as much as the noise within one makes their means differ."""
    held, count = 0, 500
    for seed in range(count):
        model = Clustered(shared_sd, seed)
        low, high = fit(model, (), range(5)).interval("mean", 0.9)
        held += low <= 0.0 <= high
    assert 0.87 < held / count < 0.975


def test_an_interval_is_the_wider_of_curvature_and_spread_between_episodes() -> None:
    model = Clustered(0.5, 3)
    fitted = fit(model, (), range(5))
    sums = model.y.sum(axis=1) - model.y.shape[1] * model.y.mean()
    curvature, spread = 1.0 / model.y.size, 5 / 4 * (sums**2).sum() / model.y.size**2
    assert spread > curvature
    error = np.sqrt(spread)
    assert fitted.standard_error("mean") == pytest.approx(error, rel=1e-6)
    low, high = fitted.interval("mean", 0.8)
    assert high - low == pytest.approx(2 * student_t.ppf(0.9, 4) * error, rel=1e-6)


def test_one_episode_has_the_curvatures_interval() -> None:
    model = Clustered(0.0, 1)
    fitted = fit(model, (), [0])
    assert fitted.standard_error("mean") == pytest.approx(1.0 / np.sqrt(16), rel=1e-6)


def test_a_larger_hypothesis_starts_where_the_smaller_one_is() -> None:
    """The same quantity under another name, as an effect that takes over a calibrated constant."""
    model = Linear(TRUTH)
    base = fit(model, (), EVERY)
    free = (
        *model.free(()),
        Free("gain-moved.gain", "1", 0.4, 3.0, -9.0, 9.0, 0.05, quantity="gain"),
        Free("other.size", "1", 0.1, 3.0, -9.0, 9.0, 0.05),
    )
    theta = extended(base, free)
    assert theta.tolist() == [*base.theta, base.value("gain"), 0.1]


def test_priors_are_paid_in_nats() -> None:
    free = Linear(TRUTH).free(())
    assert log_prior(free, neutral(free)) == 0.0
    moved = neutral(free) + [f.prior_sd for f in free]
    assert log_prior(free, moved) == pytest.approx(-1.0)
