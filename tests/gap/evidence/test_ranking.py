"""Effects compared on made-up linear data, where every gain and every loss has a closed form."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear_model import EFFECTS, EPISODES, Linear
from scipy.stats import t as student_t

from wakedeploy.gap.evidence.fits import Free, Score
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import rank, rank_fairly
from wakedeploy.gap.evidence.separation import explained, information

EVERY = range(EPISODES)


def exact_gain(model: Linear, name: str) -> float:
    """Held-out gain over the base, and what the priors no longer pay."""
    unseen = model.unseen_density((name,), (name,)) - model.seen_density(())
    return unseen.sum() + model.prior_nats((name,)) - model.prior_nats(())


def whitening(model: Linear) -> np.ndarray:
    """Inverse covariance (n, n) of the readings before the calibration is known."""
    x, _, weight = model.stacked((), list(EVERY))
    spread = np.array([sd for _, sd in model.priors.values()])
    return np.linalg.inv(np.diag(1.0 / weight) + (x * spread**2) @ x.T)


@pytest.mark.parametrize("truth", [{"a": 0.5}, {"c": 0.4}, {}])
def test_gains_are_exact_and_in_order(truth) -> None:
    model = Linear({"gain": 0.5, **truth}, seed=2)
    ranked = rank(model, fit(model, (), EVERY), EFFECTS)
    assert {c.name for c in ranked} == set(EFFECTS)
    gains = [c.gain_nats for c in ranked]
    assert gains == sorted(gains, reverse=True)
    for candidate in ranked:
        assert candidate.gain_nats == pytest.approx(exact_gain(model, candidate.name), abs=0.2)


def test_the_effect_that_is_there_comes_first() -> None:
    """With its size; one that looks alike comes second, and an unrelated one gains nothing."""
    model = Linear({"a": 0.8}, seed=5)
    best, second, last = rank(model, fit(model, (), EVERY), EFFECTS)
    assert (best.name, second.name, last.name) == ("a", "b", "c")
    low, high = best.fit.interval("a.size")
    assert low < 0.8 < high
    assert last.gain_nats < 1.0


def test_a_ranking_tells_how_far_it_is() -> None:
    model, seen = Linear({"a": 0.8}, seed=5), []
    rank(model, fit(model, (), EVERY), EFFECTS, steps=lambda done, total: seen.append(done / total))
    assert len(seen) == len(EFFECTS)
    assert seen == sorted(set(seen))
    assert 0.0 < seen[0] < seen[-1] <= 1.0


def test_nothing_gains_much_where_nothing_is_missing() -> None:
    best = []
    for seed in range(40):
        model = Linear({"gain": 0.5}, seed=100 + seed)
        best.append(rank(model, fit(model, (), EVERY), EFFECTS)[0].gain_nats)
    # One parameter gains half a chi-squared of one on its own data and loses as much on others.
    assert np.mean(best) < 1.0
    assert np.quantile(best, 0.9) < 3.0


def test_effects_are_ranked_on_top_of_those_found() -> None:
    model = Linear({"a": 0.8, "c": 0.6}, seed=5)
    on_a = fit(model, ("a",), EVERY)
    best, second = rank(model, on_a, ("b", "c"))
    assert best.name == "c"
    assert best.fit.hypothesis == ("a", "c")
    expected = model.unseen_density(("a", "c"), ("c",)) - model.seen_density(("a",))
    assert best.gains == pytest.approx(expected, abs=0.05)
    assert second.gain_nats < best.gain_nats - 10.0


def test_a_base_that_has_bent_its_calibration_pays_for_it() -> None:
    """An effect that only spares a bent constant gains what the prior says against bending it."""
    model = Linear({"gain": 1.1, "a": 0.0}, priors={"gain": (0.0, 0.05)}, seed=3)
    model.columns["c"] = model.columns["gain"]  # the same thing under another name
    ranked = rank(model, fit(model, (), EVERY), ("c",))
    assert ranked[0].prior_gain > 20.0
    assert ranked[0].gain_nats == pytest.approx(exact_gain(model, "c"), abs=0.2)


def test_a_gains_interval_is_students() -> None:
    model = Linear({"a": 0.5}, seed=2)
    candidate = rank(model, fit(model, (), EVERY), ("a",))[0]
    error = candidate.gains.std(ddof=1) * np.sqrt(EPISODES)
    low, high = candidate.gain_interval()
    assert 0.5 * (high - low) == pytest.approx(student_t.ppf(0.95, EPISODES - 1) * error)
    assert 0.5 * (high + low) == pytest.approx(candidate.gain_nats)


def test_one_episode_knows_no_interval_of_its_gain() -> None:
    model = Linear({"a": 0.5})
    candidate = rank(model, fit(model, (), [0]), ("a",))[0]
    assert candidate.gain_interval() == (-np.inf, np.inf)


def test_information_is_what_is_left_after_the_calibration() -> None:
    model = Linear({"gain": 0.5})
    base, inverse = fit(model, (), EVERY), whitening(model)
    for name in EFFECTS:
        column = model.columns[name].ravel()
        known = information(model, base, explained(base), name)
        assert known == pytest.approx(np.array([[column @ inverse @ column]]), rel=1e-6)


class Valleys:
    """An effect that a bent calibration imitates so well that no climb leads from there to it.

    Readings are a bump at an unknown place; a calibrated shift moves a bump that is always there.
    """

    episodes = 4

    def __init__(self) -> None:
        self.t = np.linspace(0.0, 1.0, 120)
        rng = np.random.default_rng(11)
        self.y = self._bump(0.5) + self._bump(0.72) + 0.2 * rng.standard_normal((4, 120))

    def free(self, hypothesis):
        shift = Free("shift", "s", 0.5, 0.03, 0.1, 0.9, 1e-3, quantity="shift")
        size = Free("echo.size", "1", 0.0, 1.0, -3.0, 3.0, 0.01, (0.5,))
        return (shift, size) if hypothesis else (shift,)

    def score(self, hypothesis, theta, episode):
        echo = theta[1] * self._bump(0.72) if hypothesis else 0.0
        e = self.y[episode] - self._bump(theta[0]) - echo
        variance = np.full(120, 0.04)
        density = -0.5 * e * e / variance - 0.5 * np.log(2 * np.pi * variance)
        return Score(density, e, variance, np.ones(120))

    def _bump(self, at):
        return np.exp(-0.5 * ((self.t - at) / 0.04) ** 2)


def test_a_candidate_is_also_tried_with_the_calibration_put_straight() -> None:
    model = Valleys()
    bent = fit(model, (), range(4), np.array([0.7]))
    assert bent.value("shift") > 0.6  # it has taken the echo for the bump
    seen: list[tuple[int, int]] = []
    found = rank(model, bent, ("echo",), steps=lambda *at: seen.append(at))[0]
    assert seen[-1][0] == seen[-1][1]  # the second climb is the rest
    assert found.fit.value("shift") == pytest.approx(0.5, abs=0.01)
    assert found.fit.value("echo.size") == pytest.approx(1.0, abs=0.1)


class Placed(Valleys):
    """The place of the echo is what is not known; at its lower bound it is not in the readings."""

    def free(self, hypothesis):
        place = Free("echo.at", "s", -1.0, 10.0, -1.0, 1.0, 1e-3, (0.1, 0.3, 0.64, 0.95))
        return (super().free(())[0], place) if hypothesis else super().free(())

    def score(self, hypothesis, theta, episode):
        echo = self._bump(theta[1]) if hypothesis else 0.0
        e = self.y[episode] - self._bump(theta[0]) - echo
        density = -0.5 * e * e / 0.04 - 0.5 * np.log(2 * np.pi * 0.04)
        return Score(density, e, np.full(120, 0.04), np.ones(120))


def test_sizes_beyond_a_bound_are_one_size() -> None:
    """Nothing climbs from the bound, the likeliest; the next ones are to have their turn."""
    model = Placed()
    bent = fit(model, (), range(4), np.array([0.7]))
    found = rank(model, bent, ("echo",))[0]
    assert found.fit.value("echo.at") == pytest.approx(0.72, abs=0.01)
    assert found.fit.value("shift") == pytest.approx(0.5, abs=0.01)


class Ages:
    """Readings of a moving height, as old as a sensor's delay and, in part, as what it held.

    A delay explains the mean age; how the age goes up and down is jagged in the hold.
    """

    episodes, hold_s, noise_m = 4, 0.0204, 0.006
    relations = {  # noqa: RUF012
        "sample-and-hold": SimpleNamespace(confused_with=("range-delay",), constants=()),
        "range-delay": SimpleNamespace(confused_with=(), constants=("range.delay_s",)),
    }

    def __init__(self) -> None:
        rng = np.random.default_rng(12)
        self.at_s = np.cumsum(rng.choice([0.02, 0.04], (4, 150)), axis=1)
        self.speed_mps = rng.standard_normal((4, 150))
        self.y = rng.normal(0.0, self.noise_m, (4, 150)) - self._lag_m(0.0, self.hold_s)

    def free(self, hypothesis):
        delay = Free("range.delay_s", "s", 0.0, 0.004, -0.02, 0.02, 1e-3, quantity="range.delay_s")
        sizes = (*np.geomspace(0.008, 0.03, 40), *(self.hold_s + 5e-5 * np.arange(-20, 21)))
        hold = Free(
            "sample-and-hold.hold_s", "s", 0.0, 0.05, 0.0, 0.3, 1e-5, (0.015,), scanned=sizes
        )
        return (delay, hold) if hypothesis else (delay,)

    def score(self, hypothesis, theta, episode):
        e = (self.y + self._lag_m(theta[0], theta[1] if hypothesis else 0.0))[episode]
        variance = np.full(150, self.noise_m**2)
        density = -0.5 * e * e / variance - 0.5 * np.log(2 * np.pi * variance)
        return Score(density, e, variance, np.ones(150))

    def _lag_m(self, delay_s, hold_s):
        held_s = self.at_s % hold_s if hold_s > 0.0 else 0.0
        return self.speed_mps * (delay_s + held_s)


def test_a_jagged_size_is_looked_for_beside_what_it_is_confused_with() -> None:
    """The base has bent the delay for the hold's mean age; with both, the true hold is absurd."""
    model = Ages()
    bent = fit(model, (), range(4))
    assert bent.value("range.delay_s") > 0.008
    both = model.score(("x",), np.array([bent.value("range.delay_s"), model.hold_s]), 0)
    assert both.log_density.sum() < bent.per_episode[0]
    found = rank(model, bent, ("sample-and-hold",))[0]
    assert found.fit.value("sample-and-hold.hold_s") == pytest.approx(model.hold_s, abs=2e-5)
    assert found.fit.value("range.delay_s") == pytest.approx(0.0, abs=0.001)


class TwoValleys(Linear):
    """The calibrated gain explains the readings at +1 and at -1; a climb ends in the nearer one."""

    def score(self, hypothesis, theta, episode):
        bent = np.array(theta)
        bent[0] = 0.5 * (theta[0] ** 2 - 1.0)
        return super().score(hypothesis, bent, episode)


def test_what_any_new_climb_gains_is_no_effects_merit() -> None:
    """A base that ended in the wrong valley lets every effect gain what its prior costs there."""
    model = TwoValleys({}, priors={"gain": (1.0, 0.3)}, seed=4)
    stuck = fit(model, (), EVERY, np.array([-1.0]))
    assert stuck.value("gain") < -0.8
    assert stuck.log_prior < -15.0
    assert rank(model, stuck, ("a", "c"))[0].gain_nats > 10.0
    base, ranked = rank_fairly(model, stuck, ("a", "c"))
    assert base.value("gain") == pytest.approx(1.0, abs=0.2)
    assert ranked[0].gain_nats < 5.0


def test_other_summits_of_a_base_are_kept_where_it_is_climbed_again() -> None:
    """An interval spans them; an objective a hair better elsewhere is no reason to forget them."""
    model = Linear({"gain": 0.5, "a": 0.3}, seed=5)
    best = fit(model, ("a",), EVERY)
    short = replace(best, theta=best.theta - 1e-6, per_episode=best.per_episode - 1e-4)
    elsewhere = fit(model, ("a",), EVERY)
    base, _ = rank_fairly(model, replace(short, summits=(elsewhere,)), ("c",))
    assert base.summits == (elsewhere,)


def test_an_effect_looked_for_at_many_sizes_pays_for_them() -> None:
    """Its gain is less by the logarithm of the summits that the sizes may lie on."""
    model = Ages()
    bent = fit(model, (), range(4))
    found = rank(model, bent, ("sample-and-hold",))[0]
    held = float(found.gains.sum()) + found.prior_gain
    assert held - found.gain_nats == pytest.approx(np.log(81 / 3))


def test_a_climb_that_cannot_win_is_given_up() -> None:
    """Beside an objective that it will not come to, it ends early; below one, at its summit."""
    model = Linear({"gain": 0.5, "a": 0.6}, seed=6)
    whole = fit(model, ("a",), EVERY)
    start = np.array([whole.theta[0] + 0.3, whole.theta[1] - 0.3, 0.0])
    model.scored.clear()
    same = fit(model, ("a",), EVERY, start, least=whole.objective - 5.0)
    assert same.objective == pytest.approx(whole.objective, abs=0.05)
    used = len(model.scored)
    model.scored.clear()
    fit(model, ("a",), EVERY, whole.theta + 0.05, least=whole.objective + 100.0)
    assert len(model.scored) <= used
