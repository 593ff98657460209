"""What is named and what is not: forecasts that run away, parameters of other blocks, leftovers."""

from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from linear_model import EPISODES, Linear

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import Fit, Free, Score, Slopes
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search import judging, rounds, scan, weighing, withdrawal
from wakedeploy.gap.search.artefacts import Forecast, Leftover, Ranked, Round
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.needed_gain import Chance
from wakedeploy.gap.search.outcome import (
    ACCEPTED,
    CHANCE,
    HARDLY,
    ONE_BLOCK,
    OUTDONE,
    SUPERFLUOUS,
    TRIFLE,
    UNSEEN_WORSE,
    Named,
    verdict_of,
)
from wakedeploy.gap.search.results import answer_of
from wakedeploy.gap.search.rivalry import Verdict
from wakedeploy.gap.search.size_bounds import is_steady
from wakedeploy.gap.search.weighing import Weight, is_outdone, share_of_gap, weight_of, without
from wakedeploy.gap.systems.answers.words import sentences
from wakedeploy.gap.systems.kinds.library import not_offered
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.physics.kalman import bumped

RATE = 50.0


class Rail(System):
    """What all masses on a rail here have: only effects that do not explain what rubs."""

    rate_hz = RATE
    inputs: ClassVar = [Input("force_n", "N")]
    states: ClassVar = {"speed_mps": "m/s"}
    outputs: ClassVar = [Output("speed_mps", "m/s", noise=2e-3)]
    constants: ClassVar = [Constant("mass_kg", 2.0, spread=0.05)]
    ports: ClassVar = [Port.input("force_n", kinds=["dead-time"])]


class Slider(Rail):
    """A mass on a rail."""

    def derivative(self, state, inputs, c):
        return {"speed_mps": inputs.force_n / c.mass_kg}


class Narrow(Slider):
    """The same, with a port for one kind of force."""

    ports: ClassVar = [Port.force("speed_mps", kinds=["offset"])]


def slid(friction_n, system=None):
    """The mass with dry friction, which no port of it can have."""
    rng = np.random.default_rng(4)
    force = np.repeat(rng.uniform(-12.0, 12.0, 50), 16)
    speed, shown = 0.0, np.empty(len(force))
    for k, push in enumerate(force):
        shown[k] = speed
        for _ in range(10):
            rub = friction_n * np.tanh(speed / 0.01)
            speed += (push - rub + 0.1 * rng.standard_normal()) / 2.0 / RATE / 10
    shown += 2e-3 * rng.standard_normal(len(force))
    columns = {"force_n": force, "speed_mps": shown}
    return LogModel(system or Slider(), [Recording("made", np.arange(len(force)) / RATE, columns)])


@pytest.fixture(scope="module")
def rubbing():
    """With 3 N."""
    return slid(3.0)


def test_what_a_port_leaves_out_is_what_would_make_sense_there():
    left_out = not_offered(Narrow(), "speed_mps", {})
    assert {"coulomb-friction", "viscous-friction", "quadratic-drag"} <= set(left_out)
    assert not {"offset", "stiffness"} & set(left_out)  # no position is there
    assert not_offered(Slider(), "speed_mps", {}) == []


@pytest.mark.whole
def test_a_law_is_asked_for_where_hardly_a_push_is_left():
    """Constants and noise have taken the friction in; its law still makes forecasts better."""
    model = slid(1.0)
    told = named(model, fitted_base(model))
    assert verdict_of(told) == "unknown"
    (left,) = told.leftover
    assert left.share < RULES.push_share
    assert left.law.removes > RULES.unexplained_share


@pytest.mark.whole
def test_what_nothing_explains_is_said_with_its_size_and_what_it_follows(rubbing):
    told = named(rubbing, fitted_base(rubbing))
    assert (verdict_of(told), told.found.hypothesis) == ("unknown", ())
    (left,) = told.leftover
    assert left.state == "speed_mps"
    assert 0.7 < left.sd < 3.0  # ± 3 N on 2 kg
    assert left.against.coordinate == "speed_mps"
    assert left.against.means[0] > 0.1 > -0.1 > left.against.means[-1]
    assert left.matters
    law = left.law  # over the speed or its direction, as friction is
    assert law.by_direction or law.coordinate == "speed_mps"
    assert law.low > 0.5
    assert (left.has_port, left.not_offered) == (False, [])
    lines = sentences(answer_of(told))
    assert lines[0] == "Something acts on the system that no known effect explains."
    assert "on speed_mps" in lines[1]


@pytest.mark.parametrize(("push_n", "is_said"), [(30.0, True), (1.0, False)])
def test_a_hand_that_pushes_once_is_said_if_it_surely_did_most(push_n, is_said):
    """Blocks hardly agree on the size of what pushes in one of them, but it may be large."""
    rng = np.random.default_rng(4)
    force = np.repeat(rng.uniform(-1.0, 1.0, 50), 16)
    hand = np.zeros(len(force))
    hand[160:172], hand[172:184] = push_n, -push_n
    moved = force + hand + 0.02 * rng.standard_normal(len(force))
    speed = np.concatenate([[0.0], np.cumsum(moved)[:-1]]) / 2.0 / RATE
    columns = {"force_n": force, "speed_mps": speed + 2e-3 * rng.standard_normal(len(force))}
    model = LogModel(Slider(), [Recording("made", np.arange(len(force)) / RATE, columns)])
    base = fitted_base(model)
    assert base.standard_error("push.speed_mps") > RULES.push_ln_sd
    left = model.leftovers(base)
    assert [(p.state, p.unit, p.matters) for p in left] == [("speed_mps", "m/s²", True)] * is_said


def test_what_is_left_tells_the_kinds_that_its_port_leaves_out():
    model = slid(3.0, Narrow())
    (left,) = named(model, fitted_base(model)).leftover
    assert left.has_port
    assert "coulomb-friction" in left.not_offered


class Stepped(Rail):
    """The same as what comes a sample later."""

    def step(self, state, inputs, c):
        return {"speed_mps": state.speed_mps + inputs.force_n / c.mass_kg / RATE}


class Loaded(Slider):
    """The same, with forces that it distributes itself."""

    def derivative(self, state, inputs, c):
        return self.derivative_under(state, inputs, c, {})

    def derivative_under(self, state, inputs, c, forces):
        return {"speed_mps": (inputs.force_n + forces.get("speed_mps", 0.0)) / c.mass_kg}


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Stepped, Loaded])
def test_a_law_shows_in_any_form_of_a_system(rubbing, kind):
    log = rubbing.logs[0]
    columns = {"force_n": log.inputs[0], "speed_mps": log.outputs[0]}
    model = LogModel(
        kind(), [Recording("made", np.arange(len(columns["force_n"])) / RATE, columns)]
    )
    told = named(model, fitted_base(model))
    assert verdict_of(told) == "unknown"
    (left,) = told.leftover
    assert left.matters
    assert left.law.low > 0.5


@pytest.mark.whole
@pytest.mark.parametrize(("gusts_mps2", "verdict"), [(0.4, "none"), (4.0, "unknown")])
def test_a_disturbance_that_follows_nothing_is_no_missing_effect(gusts_mps2, verdict):
    """Gusts of an eighth of a second; as large as all that is known, they are something unknown."""
    rng = np.random.default_rng(11)
    force = np.repeat(rng.uniform(-12.0, 12.0, 60), 16)
    speed, gust, shown = 0.0, 0.0, np.empty(len(force))
    kept = np.exp(-1.0 / RATE / 10 / 0.12)
    for k, push in enumerate(force):
        shown[k] = speed + 2e-3 * rng.standard_normal()
        for _ in range(10):
            gust = kept * gust + gusts_mps2 * (1.0 - kept**2) ** 0.5 * rng.standard_normal()
            speed += (push / 2.0 - 0.5 * speed + gust) / RATE / 10

    class Dragged(Slider):
        constants: ClassVar = [Constant("mass_kg", 2.0, 0.05), Constant("drag_per_s", 0.5)]

        def derivative(self, state, inputs, c):
            return {"speed_mps": inputs.force_n / c.mass_kg - c.drag_per_s * state.speed_mps}

    columns = {"force_n": force, "speed_mps": shown}
    model = LogModel(Dragged(), [Recording("made", np.arange(len(force)) / RATE, columns)])
    told = named(model, fitted_base(model))
    assert (verdict_of(told), told.found.hypothesis) == (verdict, ())
    (left,) = told.leftover
    assert left.sd == pytest.approx(gusts_mps2, rel=0.5)
    assert left.matters == (verdict == "unknown")
    assert left.law is None
    assert any("a disturbance acts so" in line for line in sentences(answer_of(told)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("offset_n", "found", "judged"),
    [
        (0.05, {"viscous-friction@speed_mps"}, TRIFLE),
        pytest.param(
            *(2.0, {"viscous-friction@speed_mps", "offset@speed_mps"}, ACCEPTED),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_trifle_of_the_gap_that_there_was_is_told_and_not_named(offset_n, found, judged):
    """Beside what closes nearly all of a gap, a small effect removes most of the rest."""

    class Pushed(Slider):
        ports: ClassVar = [
            Port.force("speed_mps", inertia="mass_kg", kinds=["viscous-friction", "offset"])
        ]

    rng = np.random.default_rng(0)
    force = np.repeat(rng.uniform(-8.0, 8.0, 40), 25)
    speed, shown = 0.0, np.empty(len(force))
    for k, push in enumerate(force):
        shown[k] = speed + 2e-3 * rng.standard_normal()
        for _ in range(20):
            speed += (push - 6.0 * speed + offset_n) / 2.0 / RATE / 20
    columns = {"force_n": force, "speed_mps": shown}
    model = LogModel(Pushed(), [Recording("made", np.arange(len(force)) / RATE, columns)])
    outcome = named(model, fitted_base(model))
    assert set(outcome.found.hypothesis) == found
    last = next(r for r in outcome.rounds if r.given).ranking[0]
    assert last.judged == judged
    assert last.forecast.share > 0.3


@pytest.mark.whole
def test_what_makes_forecasts_of_sealed_episodes_worse_is_withdrawn():
    """The input comes late until the last quarter begins, which alone is sealed."""
    rng = np.random.default_rng(5)
    force = np.repeat(rng.uniform(-4.0, 4.0, 100), 8)
    late = np.concatenate([np.zeros(5), force[:-5]])
    sealed = 3 * len(force) // 4
    acting = np.where(np.arange(len(force)) < sealed, late, force)
    pushed = acting + 0.1 * rng.standard_normal(len(force))
    speed = np.concatenate([[0.0], np.cumsum(pushed[:-1]) / 2.0 / RATE])
    columns = {"force_n": force, "speed_mps": speed + 2e-3 * rng.standard_normal(len(force))}
    model = LogModel(Slider(), [Recording("made", np.arange(len(force)) / RATE, columns)])
    told = named(model, fitted_base(model))
    assert (verdict_of(told), told.found.hypothesis) == ("unknown", ())
    (judged,) = [e.judged for e in told.rounds[0].ranking if e.name == "dead-time@force_n"]
    assert judged == UNSEEN_WORSE
    assert any(UNSEEN_WORSE in line for line in sentences(answer_of(told)))


class LateSlider(Slider):
    """Its input may come late in two ways."""

    ports: ClassVar = [Port.input("force_n", kinds=["dead-time", "lag"])]


@pytest.mark.whole
@pytest.mark.parametrize("refused", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_search_goes_on_once_without_what_sealed_episodes_refuse(
    refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The input comes late; where its dead time is refused, what is like it has its turn."""
    rng = np.random.default_rng(5)
    force = np.repeat(rng.uniform(-4.0, 4.0, 100), 8)
    late = np.concatenate([np.zeros(5), force[:-5]])
    speed = np.concatenate([[0.0], np.cumsum(late[:-1]) / 2.0 / RATE])
    columns = {"force_n": force, "speed_mps": speed + 2e-3 * rng.standard_normal(len(force))}
    model = LogModel(LateSlider(), [Recording("made", np.arange(len(force)) / RATE, columns)])
    asked = []

    def helps(model, without, found, sealed) -> bool:
        asked.append(found.hypothesis)
        return len(asked) > refused

    monkeypatch.setattr(withdrawal, "helps", helps)
    monkeypatch.setattr(judging, "asked_far_ahead", lambda model: None)
    monkeypatch.setattr(judging, "begun_anew", lambda *given: {})
    told = named(model, fitted_base(model))
    assert asked[0] == ("dead-time@force_n",)
    assert len(asked) == 2
    assert "dead-time@force_n" not in asked[1]
    assert told.found.hypothesis == (asked[1] if refused == 1 else ())
    assert [r.given for r in told.rounds].count([]) == (2 if refused == 1 else 1)


def test_blocks_that_all_gain_are_steady_however_much_their_gains_differ():
    few_gain_most = np.array([0.4, 60.0, 1.1, 0.3, 30.0, 2.0])
    assert is_steady(few_gain_most)
    assert not is_steady(few_gain_most[:4])  # four blocks are too few to agree
    assert not is_steady(np.array([0.4, 60.0, -1.1, 0.3, -30.0, 2.0]))
    assert not is_steady(np.zeros(6))
    rng = np.random.default_rng(0)
    alarms = sum(is_steady(rng.standard_normal(8) ** 3) for _ in range(400))
    assert alarms <= 32  # 20 expected of 400


def test_a_channel_without_an_error_decides_nothing(monkeypatch):
    """One that is forecast exactly, and one of which nothing is forecast."""
    rms = {"before": [0.0, np.nan, 2.0], "after": [0.0, np.nan, 1.0]}
    monkeypatch.setattr(weighing, "errors", lambda model, fitted, episodes: rms[fitted])
    monkeypatch.setattr(weighing, "weighed", lambda *_: weighing.Weight(0.5, 0.1, 0.9))
    likely = {"before": 0.0, "after": 0.0}
    monkeypatch.setattr(
        weighing, "applied", lambda _, fitted, __: SimpleNamespace(log_likelihood=likely[fitted])
    )
    assert weighing.helps(None, "before", "after", ())
    rms["after"][2] = 2.1  # although its cut share says that it helps
    assert not weighing.helps(None, "before", "after", ())
    likely["after"] = 4.0
    assert not weighing.helps(None, "before", "after", ())  # no evidence outweighs that
    rms["after"][2] = 2.004  # as good: the samples say more than so few forecasts do
    assert weighing.helps(None, "before", "after", ())
    rms["before"][0], rms["after"][0] = 1e-13, 3e-13  # right but for rounding
    assert weighing.helps(None, "before", "after", ())
    rms["after"][2] = np.nan  # the forecast ran off
    assert not weighing.helps(None, "before", "after", ())
    rms["after"][2] = 2.004
    monkeypatch.setattr(weighing, "weighed", lambda *_: weighing.Weight(-0.5, -0.9, -0.1))
    assert not weighing.helps(None, "before", "after", ())  # forecasts are clearly worse


@pytest.mark.whole
@pytest.mark.parametrize(
    ("mass_kg", "last"),
    [
        (2.8, "With that, nothing else that matters is missing from the system."),
        (4.0, "Something acts on the system that no known effect explains."),
    ],
)
def test_a_constant_far_from_what_was_stated_is_doubted_first(mass_kg, last):
    """The mass is not two kilograms; the prior holds back what is as far as another unit."""
    rng = np.random.default_rng(6)
    force = np.repeat(rng.uniform(-4.0, 4.0, 60), 8)
    pushed = force + 0.1 * rng.standard_normal(len(force))
    speed = np.concatenate([[0.0], np.cumsum(pushed[:-1]) / mass_kg / RATE])
    columns = {"force_n": force, "speed_mps": speed + 2e-3 * rng.standard_normal(len(force))}
    model = LogModel(Slider(), [Recording("made", np.arange(len(force)) / RATE, columns)])
    answer = answer_of(named(model, fitted_base(model)))
    assert answer.moved["mass_kg"] > 5.0
    lines = sentences(answer)
    assert "moved mass_kg (from 2 kg to " in lines[0]
    assert lines[1] == last


def test_one_blow_does_not_decide_what_chance_brings():
    rng = np.random.default_rng(3)
    slow = np.sin(np.arange(800) / 40.0)  # what a candidate's slope may look like
    brought = []
    for blow in (0.0, 40.0):
        e = rng.standard_normal(800)
        e[400] += blow
        score = Score(-0.5 * e**2, e, np.ones(800), np.ones(800))
        leader = Fit((), (), (0,), np.zeros(0), Slopes((score,), (), ()), np.zeros(1))
        turned = scan._turned(leader, np.random.default_rng(0), by_block=False)
        along = np.concatenate([slow, slow])
        along /= np.sqrt(along @ along)
        brought.append(float(np.quantile(0.5 * (along @ turned) ** 2, 0.95)))
    assert brought[1] < 3.0 * brought[0]  # 140 times as much where it counts in full


def test_a_stretch_that_runs_away_does_not_decide():
    was, now = np.full((20, 1), 1.0), np.full((20, 1), 0.5)
    now[3] = 1e9
    weight = weight_of(was, now)
    assert weight.share == pytest.approx(1.0 - (19 * 0.5 + 20.0) / 20.0)
    now[3] = 0.5
    assert weight_of(was, now).share == pytest.approx(0.5)


def met_now_and_then(near, far, count=3):
    """Stretches without and with an effect: a floor is met in some, elsewhere all is as before."""
    was, now = np.full((24, 1), 1.0), np.full((24, 1), near)
    was[[5, 6, 17][:count]], now[[5, 6, 17][:count]] = 500.0, far
    return was, now


def test_stretches_that_err_by_far_count_in_full_where_they_all_fall():
    was, now = met_now_and_then(1.5, 30.0)
    fallen = weight_of(was, now)
    assert fallen.share == pytest.approx(1.0 - (21 * 1.5 + 3 * 30.0) / (21 + 3 * 500.0))
    assert fallen.low > 0.5
    assert share_of_gap(was, was, now) == pytest.approx(fallen.share)


def test_they_do_not_where_one_hardly_falls_or_they_are_two():
    was, now = met_now_and_then(1.5, 240.0)
    assert weight_of(was, now).share > 0.0
    now[17] = 260.0
    assert weight_of(was, now).share < 0.0
    assert weight_of(*met_now_and_then(1.5, 30.0, count=2)).share < 0.0


def test_they_do_not_where_all_others_get_much_worse():
    assert weight_of(*met_now_and_then(7.0, 30.0)).share > 0.5
    assert weight_of(*met_now_and_then(8.0, 30.0)).share < 0.0


def test_errors_that_are_smaller_everywhere_are_no_smaller_share():
    """Whether stretches count in full does not hang on what all others do a little better."""
    shares = [weight_of(*met_now_and_then(near, 30.0)).share for near in (1.02, 1.0, 0.96, 0.5)]
    assert shares == sorted(shares)
    assert shares[0] > 0.9


def test_a_stretch_that_runs_away_from_both_is_no_share_of_the_gap():
    begun, after = np.full((24, 1), 1.0), np.full((24, 1), 1.0)
    begun[3], after[3] = 1e6, 0.99e6
    assert share_of_gap(begun, begun, after) == 0.0


def _left(**changed):
    push = {
        "state": "speed_mps",
        "sd": 1.0,
        "unit": "m/s/s",
        "lasts_s": 0.1,
        "share": 0.2,
        "of_parts": 0.2,
    }
    return Leftover(**push | {"matters": False} | changed)


def _round_with(*ranking, chance_nats=1.0):
    return Round(given=[], threshold_nats=chance_nats, steady_nats=chance_nats, ranking=ranking)


def _evident(name):
    forecast = Forecast(share=0.01, low=0.0, high=0.02)
    return Ranked(
        name=name, gain_nats=9, needed_nats=1, interval=(8, 10), parameters={}, forecast=forecast
    )


@pytest.mark.whole
@pytest.mark.parametrize(
    ("leftover_of", "rounds", "is_begun"),
    [
        ((), [], False),
        ((_left(),), [], True),
        ((), [_round_with(_evident("a"))], True),
        ((_left(matters=True),), [], True),
    ],
)
def test_effects_are_begun_anew_where_something_remains(
    rubbing, monkeypatch, leftover_of, rounds, is_begun
):
    """Also under "nothing is missing": a push, or an effect that is evident."""
    base, asked = fitted_base(rubbing), []
    outcome = Named(None, base, base, rounds, leftover=leftover_of)
    monkeypatch.setattr(judging, "_searched", lambda *args: outcome)
    monkeypatch.setattr(judging, "is_outdone", lambda *args: False)
    monkeypatch.setattr(judging, "begun_anew", lambda *args: asked.append(args) or {})
    assert named(rubbing, base) is outcome
    assert bool(asked) == is_begun


def test_what_would_have_been_named_on_a_hopeless_model_is_told(rubbing, monkeypatch):
    """The name is dropped, not what its search found."""
    base = fitted_base(rubbing)
    found = SimpleNamespace(hypothesis=("a",))
    rounds_of = [_round_with(_evident("a").model_copy(update={"judged": ACCEPTED}))]
    weights = {"a": Weight(0.3, 0.1, 0.4)}
    outcome = Named(rubbing, base, found, rounds_of, weights=weights)
    monkeypatch.setattr(judging, "_found", lambda *args: outcome)
    monkeypatch.setattr(judging, "is_outdone", lambda *args: True)
    told = judging._searched(rubbing, base, outcome, lambda *args: None)
    assert told.is_outdone
    assert told.rounds[0].ranking[0].judged == OUTDONE


def test_without_a_block_a_mean_is_the_mean_of_the_others():
    rng = np.random.default_rng(0)
    blocks = [rng.standard_normal(30) + level for level in (0.0, 0.1, 0.4)]
    mean = float(np.mean(blocks))
    scores = tuple(
        Score(-0.5 * (b - mean) ** 2, b - mean, np.ones(30), np.ones(30)) for b in blocks
    )
    slopes = Slopes(scores, (np.full((30, 1), -1.0),) * 3, (np.zeros((30, 1)),) * 3)
    free = (Free("mean", "1", 0.0, np.inf, -9.0, 9.0, 1e-3),)
    fitted = Fit((), free, (0, 1, 2), np.array([mean]), slopes, np.zeros(3))
    assert without(fitted, [2]) == pytest.approx([np.mean(blocks[:2])])


@pytest.mark.parametrize("episode", range(EPISODES))
def test_without_a_block_others_follow_what_a_bound_stops(episode):
    """Against the closed form of the others' posterior, maximised between bounds."""
    hypothesis, free_of = ("a", "b"), Linear({"a": 0.6})
    mean = free_of.posterior(hypothesis)[0]
    there, covariance = free_of.posterior(hypothesis, left_out=episode)
    at = 2  # the size of a, which goes half of its way and no farther
    way = sorted([mean[at], 0.5 * (mean[at] + there[at])])
    low, high = way[0] - 1e-3 * (there[at] > mean[at]), way[1] + 1e-3 * (there[at] < mean[at])
    model = Linear({"a": 0.6}, bounds={"a": (low, high)})
    fitted = fit(model, hypothesis, range(EPISODES), mean, enough_nats=1e-9)
    told = without(fitted, [episode])
    stopped = low if there[at] < mean[at] else high
    assert told[at] == pytest.approx(stopped, abs=1e-6)
    follow = covariance[:, at] / covariance[at, at] * (stopped - there[at])
    assert told == pytest.approx(there + follow, abs=2e-3)


def test_what_is_at_its_bound_stays_there_without_a_block():
    model = Linear({"a": 0.6}, bounds={"a": (-50.0, 0.4)})
    fitted = fit(model, ("a",), range(EPISODES), enough_nats=1e-9)
    assert [without(fitted, [e])[2] for e in range(EPISODES)] == [0.4] * EPISODES


def test_bumps_are_gaussians():
    rng = np.random.default_rng(1)
    at, sizes = rng.uniform(-3.0, 3.0, (2, 7)), rng.standard_normal((4, 7))
    centres = np.array([-1.5, -0.5, 0.5, 1.5])
    each = np.exp(-0.5 * ((at[:, None] - centres[:, None]) / 0.75) ** 2)
    assert bumped(at, sizes, centres, 0.75, 6.0) == pytest.approx((sizes * each).sum(1))


@pytest.fixture
def settling(monkeypatch):
    """Nothing is fitted again, and everything is something."""
    monkeypatch.setattr(rounds, "settled", lambda model, fit: (fit, True))
    monkeypatch.setattr(rounds, "candidate", lambda base, name, fit, model: name)
    monkeypatch.setattr(rounds, "_is_something", lambda effect, searched, by_forecasts: True)
    for stub in ("parameters", "least_squares", "errors"):
        monkeypatch.setattr(rounds, stub, lambda *given: {})


@pytest.mark.parametrize(("rival", "left"), [("c", ("b", "c")), ("d", None)])
def test_a_class_is_narrowed_by_its_own_members_only(settling, rival, left):
    """Beside A, of which A, B and C are the class, B is found, which has a rival."""
    fitted = SimpleNamespace(hypothesis=("a", "b"))
    outcome = Named(
        None,
        None,
        None,
        [_round_with()],
        rivals=("a", "b", "c"),
    )
    best = [
        Verdict(Candidate("b", fitted, np.ones(4)), ACCEPTED, Weight(0.5, 0.4, 0.6)),
        Verdict(Candidate(rival, fitted, np.ones(4)), HARDLY),
    ]
    model = SimpleNamespace(sealed=list, simpler_effects=lambda name: ())
    further = rounds._with(model, outcome, best)
    assert (further and further.rivals) == left


@pytest.mark.parametrize(("comes_as_far", "left"), [(True, 0.3), (False, 0.3), (False, 1.2)])
def test_what_was_judged_beside_a_superfluous_effect_is_judged_again_without_it(
    monkeypatch, comes_as_far, left
):
    """If that search explains less, the first one's names stay, as far as they matter alone."""
    model = Linear({"gain": 0.4, "c": 0.6})
    base, both, alone = (fit(model, h, range(EPISODES)) for h in ((), ("a", "c"), ("c",)))
    asked, beside = [], Weight(0.2, 0.1, 0.3)

    def ahead(part, outcome, progress, anew, earlier=None):
        asked.append((outcome.withdrawn, earlier))
        again = bool(outcome.withdrawn)
        found = both if not again else alone if comes_as_far else base
        ranking = [
            Ranked(
                name=n, gain_nats=g, needed_nats=4.0, interval=(1.0, 9.0), parameters={}, note=""
            )
            for n, g in (("a", 9.0), ("c", 5.0))
            if n not in outcome.withdrawn
        ]
        outcome.rounds.append(
            Round(given=[], threshold_nats=4.0, steady_nats=4.0, ranking=ranking, chosen="c")
        )
        candidates = tuple(Candidate(r.name, found, np.ones(EPISODES)) for r in ranking)
        weights = dict.fromkeys(found.hypothesis, Weight(0.9, 0.8, 1.0) if again else beside)
        return replace(outcome, found=found, weights=weights, alone=candidates)

    squares = {(): np.ones((9, 1)), ("c",): np.full((9, 1), left)}
    monkeypatch.setattr(judging, "crossed", lambda model, fitted: squares[fitted.hypothesis])
    monkeypatch.setattr(withdrawal, "removes_most", lambda model, before, after: False)
    monkeypatch.setattr(judging, "_ahead", ahead)
    chance = Ranked(
        name="a", gain_nats=1.0, needed_nats=4.0, interval=(1.0, 9.0), parameters={}, note=""
    )
    earlier = Round(given=[], threshold_nats=4.0, steady_nats=4.0, ranking=[chance])
    outcome = judging._needed(model, Named(model, base, base, [earlier]), lambda *a: None, {})
    assert [withdrawn for withdrawn, _ in asked] == [(), ("a",)]
    assert asked[0][1] is None
    assert asked[1][1].hypothesis == ("c",)
    assert outcome.rounds[0] == earlier
    assert [(r.name, r.judged) for r in outcome.rounds[1].ranking] == [
        ("a", SUPERFLUOUS),
        ("c", ""),
    ]
    if left > 1.0:
        assert outcome.found is base
        return
    assert outcome.found.hypothesis == ("c",)
    assert outcome.weights["c"].share == pytest.approx(0.9 if comes_as_far else 0.7)
    assert {c.name for c in outcome.alone} == {"a", "c"}


def test_what_was_named_as_one_is_weighed_as_one(monkeypatch):
    """One alone turns the robot; then c matters beside both."""
    model = Linear({"a": 0.6, "c": 0.4})
    base, found = (fit(model, h, range(EPISODES)) for h in ((), ("a", "b", "c")))
    left = {(): 1.0, ("a",): 1.5, ("a", "b"): 0.4, ("a", "b", "c"): 0.1}
    monkeypatch.setattr(
        judging, "crossed", lambda model, fitted: np.full((9, 1), left[fitted.hypothesis])
    )
    both = Weight(0.5, 0.4, 0.6)
    outcome = Named(
        model, base, found, [], weights={"a": both, "b": both, "c": Weight(0.5, 0.4, 0.6)}
    )
    weights = judging._weights_anew(model, outcome)
    shares = {name: weight.share for name, weight in weights.items()}
    assert shares == pytest.approx({"a": 0.6, "b": 0.6, "c": 0.75})


def test_an_earlier_search_shows_the_next_one_where_its_effects_ended(monkeypatch):
    model = Linear({"a": 0.6, "c": 0.4})
    base, both = (fit(model, h, range(EPISODES)) for h in ((), ("a", "c")))
    begun = []

    def one_more(part, outcome, progress, anew):
        begun.append({n: f.hypothesis for n, f in anew.items()})
        named = outcome.found.hypothesis
        return None if not anew else replace(outcome, found=anew["ac"[len(named)]])

    monkeypatch.setattr(judging, "with_one_more", one_more)
    start = Named(model, base, base, [])
    outcome = judging._ahead(model, start, lambda *a: None, {}, both)
    assert begun == [{"a": ("a",), "c": ("c",)}, {"c": ("a", "c")}, {}]
    assert outcome.found.objective == pytest.approx(both.objective, abs=0.1)


def test_what_the_next_search_names_itself_keeps_its_size_there(monkeypatch):
    model = Linear({"a": 0.6, "c": 0.4})
    base, earlier, now = (fit(model, h, range(EPISODES)) for h in ((), ("a",), ("c",)))
    begun = []
    monkeypatch.setattr(judging, "with_one_more", lambda part, outcome, progress, anew: None)
    monkeypatch.setattr(
        judging, "fit", lambda model, h, blocks, start: begun.append(start) or earlier
    )
    monkeypatch.setattr(judging, "settled", lambda model, fitted: (fitted, True))
    judging._ahead(model, Named(model, base, now, []), lambda *a: None, {}, earlier)
    assert begun[0][2:] == pytest.approx([now.value("c.size"), earlier.value("a.size")])


@pytest.mark.parametrize(
    ("lag", "friction", "why", "first"),
    [
        ((0.03, 0.02, 0.04), (0.63, 0.53, 0.74), ACCEPTED, "friction"),
        ((0.15, 0.02, 0.24), (0.63, 0.40, 0.80), ACCEPTED, "lag"),  # not surely twice as much
        ((0.24, 0.14, 0.32), (0.81, 0.74, 0.88), ACCEPTED, "friction"),
        ((0.24, 0.14, 0.38), (0.81, 0.74, 0.88), ACCEPTED, "lag"),  # it may matter half as much
        ((0.03, 0.02, 0.04), (0.63, 0.53, 0.74), HARDLY, "lag"),
    ],
)
def test_what_matters_less_waits_for_what_most_errors_are_of(lag, friction, why, first):
    verdicts = [
        Verdict(Candidate("dead-time", None, np.ones(4)), HARDLY, Weight(0.0, -0.1, 0.1)),
        Verdict(Candidate("lag", None, 3.0 * np.ones(4)), ACCEPTED, Weight(*lag)),
        Verdict(Candidate("spring", None, 2.0 * np.ones(4)), ACCEPTED, Weight(0.05, 0.02, 0.08)),
        Verdict(Candidate("friction", None, np.ones(4)), why, Weight(*friction)),
    ]
    leader = rounds._leader(verdicts)
    assert (leader and leader.candidate.name) == first
    assert rounds._leader(verdicts[:1]) is None


@pytest.mark.parametrize(("unseen", "runaway", "outdone"), [(1.2, 1.2, True), (0.3, 1e9, False)])
def test_sealed_blocks_say_with_the_others_whether_no_model_forecasts_better(
    monkeypatch, unseen, runaway, outdone
):
    """On blocks of its own it is as good as the last reading; one stretch may run away."""
    monkeypatch.setattr(weighing, "crossed", lambda model, fitted: np.ones((99, 1)))
    squares = np.repeat([*[unseen] * 98, runaway], 2) / 2.0  # two samples make a stretch
    model = SimpleNamespace(
        horizon=1,
        sealed=lambda: [1],
        disagreements=lambda fitted, episodes: [np.sqrt(squares)[None]],
        held=lambda episodes: [[np.full((1, 198), (s / 2.0) ** 0.5)] * 2 for s in (1.0, 9.0)],
    )
    assert is_outdone(model, SimpleNamespace(episodes=(0,))) == outdone


@pytest.mark.parametrize(
    ("gains", "left", "why"),
    [
        ([30.0, *7 * [0.2]], 0.2, ACCEPTED),
        ([30.0, *7 * [0.2]], 0.8, ONE_BLOCK),
        (8 * [1.0], 0.2, ACCEPTED),
        (8 * [1.0], 0.8, CHANCE),
        (8 * [0.3], 0.2, CHANCE),
    ],
)
def test_what_surely_removes_most_of_the_error_owes_it_to_no_single_block(
    monkeypatch, gains, left, why
):
    """A servo's weight: a push that lasts takes it up in all blocks but the first."""
    model = Linear({"gain": 0.4, "c": 0.6})
    found = fit(model, ("c",), range(model.episodes))
    base, before = fit(model, (), range(model.episodes)), np.linspace(1.0, 1.2, 9)[:, None]
    monkeypatch.setattr(rounds, "crossed", lambda model, fitted: left * before)
    monkeypatch.setattr(rounds, "removes_most", lambda model, before, after: left < 0.5)
    effect, was = Candidate("c", found, np.array(gains)), (before, before)
    verdict = rounds._judged(model, base, was, effect, 20.0, Chance(20.0, 3.0))
    assert verdict.why == why
    assert verdict.removes_most == (why == ACCEPTED)
    assert (verdict.weight is None) == (why == CHANCE)


@pytest.mark.parametrize(("left", "is_most"), [(8 * [0.2], True), (8 * [0.6], False),
                                               ([0.2, *7 * [1.0]], False)])  # fmt: skip
def test_most_of_the_error_goes_in_blocks_and_not_in_the_stretches_of_one(
    monkeypatch, left, is_most
):
    """The first block errs by thirty times as much as the others."""
    loud = np.sqrt([30.0, *7 * [1.0]])
    errors = {
        "before": [s * np.ones((1, 80)) for s in loud],
        "after": [
            s * np.sqrt(share) * np.ones((1, 80)) for s, share in zip(loud, left, strict=True)
        ],
    }
    monkeypatch.setattr(weighing, "_crossed_errors", lambda model, fitted: errors[fitted])
    assert weighing.removes_most(None, "before", "after") == is_most


@pytest.mark.parametrize(("named", "rivals", "goes_on"), [((), 4, True), (("a",), 4, False),
                                                          (("a",), 2, True)])  # fmt: skip
def test_a_name_is_not_lost_to_what_has_too_many_rivals(settling, named, rivals, goes_on):
    fitted = SimpleNamespace(hypothesis=(*named, "b"))
    weights = dict.fromkeys(named, Weight(0.5, 0.4, 0.6))
    outcome = Named(
        None,
        None,
        None,
        [_round_with()],
        weights=weights,
    )
    members = ["b", *(f"r{k}" for k in range(rivals - 1))]
    helps = Weight(0.5, 0.4, 0.6)
    best = [Verdict(Candidate(n, fitted, np.ones(4)), ACCEPTED, helps) for n in members]
    model = SimpleNamespace(sealed=list, simpler_effects=lambda name: ())
    further = rounds._with(model, outcome, best)
    assert (further is not None) == goes_on
    assert further is None or len(further.rivals) == rivals


@pytest.mark.parametrize(
    ("low", "rivals", "left"), [(0.05, 0, ()), (-0.05, 0, None), (0.05, 2, ("b", "r0", "r1")),
                                (0.05, 4, None)],
)  # fmt: skip
def test_a_pair_beside_a_name_is_held_to_what_one_effect_is(
    settling, monkeypatch, low, rivals, left
):
    """It has to help surely, and its first effect may have no more rivals than a class has."""
    monkeypatch.setattr(rounds, "crossed", lambda *given: None)
    monkeypatch.setattr(rounds, "weight_of", lambda *given: Weight(0.1, low, 0.25))
    monkeypatch.setattr(rounds, "share_of_gap", lambda *given: 0.5)
    monkeypatch.setattr(rounds, "undecided", lambda model, verdicts: list(verdicts))
    monkeypatch.setattr(rounds, "_rivals", lambda model, found, leader, verdicts: verdicts[1:])
    helps, gains = Weight(0.5, 0.4, 0.6), np.ones(4)

    def evident(*hypothesis):
        fitted = SimpleNamespace(hypothesis=hypothesis, free=())
        return Verdict(Candidate(hypothesis[-1], fitted, gains), HARDLY, helps)

    second = evident("a", "b", "c")
    monkeypatch.setattr(rounds, "_judged_round", lambda *given: [second])
    beside = [evident("a", "b"), *(evident("a", f"r{k}") for k in range(rivals))]
    named = Named(
        None,
        None,
        SimpleNamespace(hypothesis=("a",)),
        [_round_with()],
        weights={"a": helps},
    )
    model = SimpleNamespace(
        sealed=list, simpler_effects=lambda name: (), inputs_answered=lambda fitted, name: 1.0
    )
    further = rounds._pair(model, named, beside[0], beside, lambda *given: None)
    assert (further and further.rivals) == left
    assert further is None or set(further.weights) == {"a", "b", "c"}
