"""Planning: information against arithmetic and against fits, and manoeuvres that split a class."""

import numpy as np
import pytest

from runtime.reference_file import read_reference
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.fits import Free, Score
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import rank
from wakedeploy.gap.evidence.separation import gain_nats, gather, loss_nats
from wakedeploy.gap.rules import RULES, sealed_count
from wakedeploy.gap.systems.gantry.artefacts import Name
from wakedeploy.gap.systems.gantry.findings import Ranked, Round, Size
from wakedeploy.gap.systems.gantry.flight import flight_from_log
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.planning.manoeuvres import menu
from wakedeploy.gap.systems.gantry.planning.plan import (
    make_plan,
    plausible_size,
    stated_sizes,
    write_plan_reference,
)
from wakedeploy.gap.systems.gantry.planning.rates import (
    Draws,
    flights_needed,
    null_quantile,
    smallest_sizes,
)
from wakedeploy.gap.systems.gantry.planning.tracking import with_effect
from wakedeploy.gap.systems.gantry.search.naming import fitted_base
from wakedeploy.rig.file import default_rig

RIG = default_rig()
EPISODES, SAMPLES, PRIOR_SD = 5, 120, 0.3


class Regression:
    """A linear model with a nuisance and three effects, of which two look alike."""

    def __init__(self, seed: int = 0, truth: dict[str, float] | None = None) -> None:
        design = np.random.default_rng(1)
        self.nuisance = design.standard_normal((EPISODES, SAMPLES))
        first, other = design.standard_normal((2, EPISODES, SAMPLES))
        self.columns = {"a": first, "b": first + 0.35 * other, "c": other + 0.5 * self.nuisance}
        noise = np.random.default_rng([seed, 2]).standard_normal((EPISODES, SAMPLES))
        drawn = PRIOR_SD * np.random.default_rng([seed, 3]).standard_normal()
        self.y = noise + drawn * self.nuisance
        for name, size in (truth or {}).items():
            self.y = self.y + size * self.columns[name]

    @property
    def episodes(self) -> int:
        return EPISODES

    def free(self, hypothesis):
        own = [Free(f"{n}.size", "1", 0.0, np.inf, -9.0, 9.0, 0.01, (0.5,)) for n in hypothesis]
        return (Free("nuisance", "1", 0.0, PRIOR_SD, -9.0, 9.0, 0.01), *own)

    def start(self, hypothesis):
        return np.zeros(1 + len(hypothesis))

    def score(self, hypothesis, theta, episode):
        rest = self.y[episode] - theta[0] * self.nuisance[episode]
        for name, size in zip(hypothesis, theta[1:], strict=True):
            rest = rest - size * self.columns[name][episode]
        one = np.ones(SAMPLES)
        return Score(-0.5 * rest**2 - 0.5 * np.log(2 * np.pi), rest, one, one)


@pytest.fixture(scope="module")
def evidence():
    model = Regression()
    base = fit(model, (), range(EPISODES))
    return gather(model, base, ["a", "b", "c"], {n: [0.2] for n in "abc"})


def test_losses_are_those_of_generalised_least_squares(evidence) -> None:
    model = Regression()
    flat = {n: c.ravel() for n, c in model.columns.items()}
    nuisance = model.nuisance.ravel()
    # The nuisance's prior makes the noise correlated: N(0, I + s² n nᵀ).
    inverse = np.linalg.inv(np.eye(len(nuisance)) + PRIOR_SD**2 * np.outer(nuisance, nuisance))
    loss = loss_nats(evidence)
    for i, truth in enumerate("abc"):
        for j, rival in enumerate("abc"):
            left = 0.2 * flat[truth]
            if i == j:
                assert gain_nats(evidence)[i] == pytest.approx(0.5 * left @ inverse @ left, 1e-6)
                continue
            share = (flat[rival] @ inverse @ left) / (flat[rival] @ inverse @ flat[rival])
            left = left - share * flat[rival]
            assert loss[i, j] == pytest.approx(0.5 * left @ inverse @ left, rel=1e-6)


def test_predicted_rates_are_those_of_fits(evidence) -> None:
    """Against sixty data sets that the generic inference really fits and ranks."""
    threshold, size = 3.0, 0.12
    detected = named = 0
    for seed in range(60):
        model = Regression(seed + 10, {"a": size})
        ranked = rank(model, fit(model, (), range(EPISODES)), ["a", "b", "c"])
        best = ranked[0].gain_nats
        near = [c.name for c in ranked if c.gain_nats > best - 3.0]
        detected += best > threshold
        named += best > threshold and near == ["a"]
    outcome = Draws.of(evidence).outcomes("a", np.array([size / 0.2]), threshold)
    assert outcome.detected[0] == pytest.approx(detected / 60, abs=0.12)
    assert outcome.named[0] == pytest.approx(named / 60, abs=0.17)


def test_more_flights_and_larger_effects_are_named_more_often(evidence) -> None:
    threshold = null_quantile(evidence)
    draws = Draws.of(evidence)
    detectable, nameable = smallest_sizes(draws, "a", threshold)
    assert detectable < nameable
    shares = draws.outcomes("a", np.array([0.5, 1.0, 2.0, 4.0]) * nameable, threshold).named
    assert np.all(np.diff(shares) >= 0.0)
    few, many = (gather_at(size) for size in (0.4, 0.1))
    assert flights_needed(few, "a", threshold) < flights_needed(many, "a", threshold)


def gather_at(size: float):
    model = Regression()
    base = fit(model, (), range(EPISODES))
    return gather(model, base, ["a", "b", "c"], {n: [size] for n in "abc"})


@pytest.mark.whole
def test_nothing_missing_crosses_the_threshold_once_in_twenty(evidence) -> None:
    threshold, alarms = null_quantile(evidence), 0
    for seed in range(120):
        model = Regression(seed + 500)
        ranked = rank(model, fit(model, (), range(EPISODES)), ["a", "b", "c"])
        alarms += ranked[0].gain_nats > threshold
    assert alarms / 120 < 0.11


def some(*names):
    by_name = {each.name: each for each in menu()}
    return [by_name[name] for name in names]


@pytest.mark.slow
def test_triangles_split_coulomb_from_viscous_friction(tmp_path) -> None:
    made = make_plan(
        RIG,
        ["coulomb-friction", "viscous-friction"],
        manoeuvres=some("source-sines-far", "triangles-both"),
    )
    best = made.best
    assert best is not None
    assert best.manoeuvre.name == "triangles-both"
    assert best.worst_nats > 2.0 * made.options[1].worst_nats
    assert "triangles-both" in made.sentence
    assert made.as_artefact.manoeuvre == "triangles-both"
    written = write_plan_reference(tmp_path / "fly.csv", RIG, best)
    back = read_reference(tmp_path / "fly.csv", RIG)
    np.testing.assert_allclose(back.z_m, written.z_m, atol=1e-6)


@pytest.mark.slow
def test_without_the_source_nothing_tells_its_lag_from_its_way() -> None:
    made = make_plan(RIG, ["spool-lag-source", "transport-speed"], manoeuvres=some("height-steps"))
    assert made.best is None
    assert "source steps at two separations" in made.sentence
    assert made.as_artefact.flights is None


def test_more_flights_of_a_kind_add_up(evidence) -> None:
    """All but the nuisance's prior, which counts once."""
    twice = loss_nats(evidence, copies=2.0)
    off = ~np.eye(3, dtype=bool)
    np.testing.assert_allclose(twice[off], 2.0 * loss_nats(evidence)[off], rtol=0.1)


@pytest.mark.parametrize("names", [["stiction"], ["stiction", "stiction"], ["no", "such"]])
def test_a_class_needs_two_known_effects(names) -> None:
    with pytest.raises(UnusableInput):
        make_plan(RIG, names, manoeuvres=[])


def test_sizes_come_from_what_naming_stated() -> None:
    size = Size(value=0.21, low=0.1, high=0.3, unit="N")
    ranked = Ranked(name="coulomb-friction", parameters={"coulomb_n": size}, gain_nats=9.0,
                    interval=(5.0, 13.0))  # fmt: skip
    stated = Name(rounds=[Round(given=[], ranking=[ranked])])
    names = ["coulomb-friction", "viscous-friction"]
    assert stated_sizes(stated, names) == {"coulomb-friction": (0.21,)}
    assert plausible_size(RIG, "ground-effect") == (0.1, 0.1)
    assert plausible_size(RIG, "coulomb-friction") == pytest.approx((0.15,))


def flown_on(truth, plans):
    """Flights of a plant that hides an effect from the rig file."""
    return [
        flight_from_log(record(truth, seconds=16, seed=300 + i, plan=plan, model_rig=RIG), RIG, "")
        for i, plan in enumerate(plans)
    ]


def ranked_on(flights, class_):
    """Names and gains of a class."""
    model, base = fitted_base(GantryModel(RIG, flights))
    return [(c.name, c.gain_nats) for c in rank(model, base, class_)]


@pytest.mark.slow
def test_flying_the_plan_splits_a_class_that_random_flights_leave() -> None:
    pair = ["viscous-friction", "axial-inflow-loss"]
    made = make_plan(RIG, pair, manoeuvres=some("height-steps"))
    assert made.best is not None
    assert made.best.worst_nats > 3.0 * made.random.worst_nats
    truth = with_effect(RIG, "axial-inflow-loss", (0.05,))
    assert "Give these logs before the earlier ones" in made.sentence
    flights = flown_on(truth, [made.best.manoeuvre.plan(RIG)] * 2 + [None] * 3)
    unplanned = ranked_on(flights[2:], pair)
    assert unplanned[0][1] > 20.0
    assert unplanned[0][1] - unplanned[1][1] < 3.0
    planned = ranked_on(flights[: len(flights) - sealed_count(len(flights))], pair)
    assert planned[0][0] == "axial-inflow-loss"
    assert planned[0][1] - planned[1][1] > RULES.margin_nats
