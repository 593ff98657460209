"""A model asked far ahead: few readings of a forecast are looked at, and no push lasts."""

from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import expm

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap import workflow
from wakedeploy.gap.evidence.fits import neutral
from wakedeploy.gap.evidence.whiteness import whiteness
from wakedeploy.gap.progress import quiet
from wakedeploy.gap.search import judging
from wakedeploy.gap.search.artefacts import Answer, Forecast, Law, Leftover, Ranked, Round, read
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.outcome import Named
from wakedeploy.gap.search.results import answer_of
from wakedeploy.gap.systems.answers.folder import CORRECTION, OwnFolder
from wakedeploy.gap.systems.answers.words import _unexplained, sentences
from wakedeploy.gap.systems.correction import read_correction
from wakedeploy.gap.systems.likelihood import logs
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE = 50.0
FRICTION = "coulomb-friction@speed_mps"


class Cart(System):
    """A cart on a spring; two sensors show where it is."""

    rate_hz = RATE
    forecast_s = 0.6
    inputs: ClassVar = [Input("force_n", "N")]
    states: ClassVar = {"position_m": "m", "speed_mps": "m/s"}
    outputs: ClassVar = [
        Output("position_m", "m", noise=1e-3),
        Output("seldom_m", "m", noise=2e-3),
    ]
    constants: ClassVar = [Constant("mass_kg", 2.0, spread=0.05)]
    ports: ClassVar = [
        Port.force("speed_mps", inertia="mass_kg", kinds=["coulomb-friction"]),
    ]

    def derivative(self, state, inputs, c):
        push = inputs.force_n - 30.0 * state.position_m - 3.0 * state.speed_mps
        return {"position_m": state.speed_mps, "speed_mps": push / c.mass_kg}

    def measure(self, state, inputs, c):
        return {"position_m": state.position_m, "seldom_m": state.position_m}


def recorded(friction_n=0.0, samples=960):
    """The cart in fine steps; the second sensor reads every fourth time."""
    rng = np.random.default_rng(2)
    force = np.repeat(rng.normal(0.0, 12.0, samples // 25 + 1), 25)[:samples]
    x = v = 0.0
    shown = np.empty(samples)
    for k in range(samples):
        shown[k] = x
        for _ in range(20):
            v += (force[k] - 30.0 * x - 3.0 * v) / 2.0 / RATE / 20
            v -= np.clip(v, -(friction_n / 2.0) / RATE / 20, (friction_n / 2.0) / RATE / 20)
            x += v / RATE / 20
    seldom = np.where(np.arange(samples) % 4 == 1, shown, np.nan)
    noisy = {
        "force_n": force,
        "position_m": shown + 1e-3 * rng.standard_normal(samples),
        "seldom_m": seldom + 2e-3 * rng.standard_normal(samples),
    }
    return Recording("cart", np.arange(samples) / RATE, noisy)


@pytest.fixture(scope="module")
def rubbing():
    """With 3 N of dry friction."""
    return LogModel(Cart(), [recorded(3.0)])


def test_six_readings_of_a_forecast_are_looked_at(rubbing):
    """Of the seldom sensor the first in each sixth; each forecast begins at a reading."""
    far = rubbing.far_ahead()
    run = far.run((), neutral(far.free(()))[None], [4])
    scored = run.pieces.scored[:, 0]
    often, seldom = (run.statistics[2, :, m, 0, 0] != 0.0 for m in (0, 1))
    assert rubbing.horizon == 30
    assert list(np.flatnonzero(often & scored) % 5) == [0] * 12
    assert 10 <= (seldom & scored).sum() <= 12
    assert often[~scored].sum() > 50  # by which the filter has settled
    begins = np.arange(len(scored)) % rubbing.horizon == 0
    assert np.all(often[begins & scored])


def test_nothing_lasts(rubbing):
    free = [f.name for f in rubbing.far_ahead().free(())]
    assert "push.speed_mps" in [f.name for f in rubbing.free(())]
    assert not any(n.startswith(("push.", "lasting.")) for n in free)


def test_the_likelihood_is_a_kalman_filter_s_that_sees_every_fifth_reading():
    class Plain(Cart):
        outputs: ClassVar = Cart.outputs[:1]

        def measure(self, state, inputs, c):
            return {"position_m": state.position_m}

    far = LogModel(Plain(), [recorded(samples=960)]).far_ahead()
    theta = neutral(far.free(()))
    values = far.values((), theta)
    block = far.blocks[0]
    run = far.run((), theta[None], [0])
    a = np.array([[0.0, 1.0], [-15.0, -1.5]])
    big = np.zeros((3, 3))
    big[:2] = np.column_stack([a, [0.0, 0.5]])
    step = expm(big / RATE)
    lain = np.zeros((4, 4))
    lain[:2, :2], lain[2:, 2:] = -a, a.T
    lain[1, 3] = np.exp(2 * values["force.speed_mps"]) / RATE
    whole = expm(lain / RATE)
    f = KalmanFilter(dim_x=2, dim_z=1, dim_u=1)
    f.F, f.B, f.H = step[:2, :2], step[:2, 2:], np.array([[1.0, 0.0]])
    f.Q = whole[2:, 2:].T @ whole[:2, 2:]
    f.R = np.array([[np.exp(2 * values["noise.position_m"])]])
    f.x, f.P = far._starts[0].states[:, :1].copy(), np.diag(far._starts[0].spread ** 2)
    log, compared = far.logs[0], 0
    for k in range(block.stop):
        innovation, variance, density, _ = run.statistics[:, k, 0, 0, 0]
        if density != 0.0:
            f.update(log.outputs[0, k])
            assert innovation == pytest.approx(f.y[0, 0], abs=1e-8)
            assert variance == pytest.approx(f.S[0, 0], rel=1e-5)
            compared += run.pieces.scored[k, 0]
        f.predict(log.inputs[0, k])
    assert compared == 10  # ten are not scored, so that the filter has settled


def _push(**changed):
    push = {
        "state": "speed_mps",
        "sd": 1.0,
        "unit": "m/s/s",
        "lasts_s": 0.3,
        "share": 0.1,
        "of_parts": 0.1,
    }
    return Leftover(**push, **changed)


def _evident_round():
    forecast = Forecast(share=0.01, low=0.0, high=0.02)
    evident = Ranked(
        name="a", gain_nats=9, needed_nats=1, interval=(8, 10), parameters={}, forecast=forecast
    )
    return Round(given=[], threshold_nats=1.0, steady_nats=1.0, ranking=[evident])


@pytest.mark.whole
@pytest.mark.parametrize(
    ("verdict", "leftover_of", "rounds", "is_asked"),
    [
        ("unknown", (), [], True),
        ("none", (), [], False),
        ("named", (), [], False),
        ("named", (_push(matters=False),), [], True),
        ("none", (), [_evident_round()], True),
    ],
)
def test_what_explains_all_is_asked_no_further(
    rubbing, monkeypatch, verdict, leftover_of, rounds, is_asked
):
    base, asked = fitted_base(rubbing), []
    near = Named(rubbing, base, base, rounds, leftover=leftover_of)

    def one_way(model, base, progress, **given):
        asked.append(model)
        return near

    monkeypatch.setattr(judging, "_named", one_way)
    monkeypatch.setattr(judging, "_further_ahead", one_way)
    monkeypatch.setattr(judging, "verdict_of", lambda outcome: verdict)
    monkeypatch.setattr(judging, "is_outdone", lambda *args: False)
    monkeypatch.setattr(judging, "unfitted", lambda *args: np.ones((9, 1)))
    assert named(rubbing, base) is near
    assert [m.is_pushed for m in asked] == ([True, False] if is_asked else [True])


@pytest.mark.whole
@pytest.mark.parametrize(
    ("rest", "all_blocks", "sealed", "is_taken"),
    [
        ("unknown", 0.9, 0.9, True),
        ("unknown", 0.9, 1.1, False),  # forecasts of what was sealed get worse
        ("unknown", 1.1, 0.9, False),
        ("named", 0.5, 0.9, True),
        ("named", "unsure", 0.9, False),
        ("unknown", "unsure", 0.9, True),
    ],
)
def test_an_answer_far_ahead_has_to_forecast_better(
    rubbing, monkeypatch, rest, all_blocks, sealed, is_taken
):
    base = fitted_base(rubbing)
    near, far = (Named(rubbing, base, base, [], unsettled=u) for u in ((), ("far",)))
    scattered = np.linspace(0.0, 1.5, 9)[:, None]  # better on average, not surely

    def squares(of, level):
        after = scattered if level == "unsure" else np.full((9, 1), level)
        return after if of.is_pushed is False else np.ones((9, 1))

    seen = rubbing.far_ahead()
    far = Named(**{**vars(far), "model": seen})
    monkeypatch.setattr(
        judging, "_named", lambda model, *_, **given: near if model.is_pushed else far
    )
    monkeypatch.setattr(judging, "_further_ahead", lambda *_: far)
    monkeypatch.setattr(judging, "fitted_base", lambda model: base)
    monkeypatch.setattr(judging, "_is_whole", lambda outcome: False)
    verdicts = {(): rest, ("far",): "named"}
    monkeypatch.setattr(judging, "verdict_of", lambda outcome: verdicts[outcome.unsettled])
    monkeypatch.setattr(judging, "unfitted", lambda model, _: squares(model, all_blocks))
    monkeypatch.setattr(judging, "unseen", lambda model, _: squares(model, sealed))
    monkeypatch.setattr(judging, "_left_near", lambda *args: ())
    told = named(rubbing, base)
    assert told.is_far_ahead == is_taken
    assert (told is near) != is_taken


class Pushed(Cart):
    """The same, which something else may push, too."""

    ports: ClassVar = [
        Port.force("speed_mps", inertia="mass_kg", kinds=["coulomb-friction", "offset"]),
    ]


@pytest.mark.slow
def test_what_is_named_near_is_where_the_search_far_ahead_begins():
    model = LogModel(Pushed(), [recorded(3.0)])
    near = judging._named(model, fitted_base(model), quiet)
    again = judging._further_ahead(model.far_ahead(), near, quiet)
    assert near.found.hypothesis == again.found.hypothesis == (FRICTION,)
    assert not again.model.is_pushed
    *before, asked = again.rounds
    assert before == near.rounds
    assert asked.given == [FRICTION]
    low, high = again.found.interval(f"{FRICTION}.force")
    assert low < near.found.value(f"{FRICTION}.force") < high
    placebo = answer_of(again).placebo  # which was asked near, in the first ranking
    assert placebo is not None
    assert placebo.name == "offset@speed_mps"


@pytest.mark.slow
def test_long_logs_are_searched_in_part_far_ahead_too(monkeypatch):
    """What was named is fitted to the samples that the search goes on with."""
    monkeypatch.setattr(logs, "_SEARCHED", 1)  # at least twice as far as a forecast reaches
    model = LogModel(Pushed(), [recorded(3.0, 1920)])
    assert model.thinned() is not model
    near = judging._named(model, fitted_base(model), quiet)
    assert near.found.hypothesis == (FRICTION,)
    again = judging._further_ahead(model.far_ahead(), near, quiet)
    assert again.found.hypothesis == (FRICTION,)
    found, base = (
        [len(score.log_density) for score in fitted.slopes.scores]
        for fitted in (again.found, again.base)
    )
    assert found == base
    assert again.found.episodes == near.found.episodes


@pytest.mark.slow
def test_steps_go_on_from_an_answer_far_ahead(rubbing, monkeypatch, tmp_path):
    """Its fits have other parameters than those of the model that was asked first."""
    far = rubbing.far_ahead()

    def asked_far(model, base, progress):
        outcome = judging._named(far, fitted_base(far), progress)
        return Named(**{**vars(outcome), "is_far_ahead": True})

    monkeypatch.setattr(workflow, "named", asked_far)
    folder = OwnFolder(rubbing, tmp_path)
    folder.add()
    (kept,) = read_correction(tmp_path / CORRECTION, "Cart").document.effect
    assert kept.name == FRICTION
    shown = folder.show()
    assert shown.gap["position_m"].after < 0.5 * shown.gap["position_m"].before
    told = read(tmp_path / "name.json", Answer, folder.key)
    assert told is not None
    assert told.is_far_ahead
    assert told.effects[0].parameters["force"].value == pytest.approx(3.0, abs=0.5)
    assert any("predicts far ahead" in line for line in sentences(told))


def test_short_forecasts_are_not_asked_far_ahead():
    """Three samples between readings are few; with fewer, nearly all would be looked at."""

    class Short(Cart):
        forecast_s = 17 / RATE

    class Longer(Cart):
        forecast_s = 18 / RATE

    assert LogModel(Short(), [recorded()]).far_ahead() is None
    assert LogModel(Longer(), [recorded()]).far_ahead() is not None


def test_each_forecast_s_part_has_one_reading_also_where_it_is_no_whole_number():
    class Odd(Cart):
        forecast_s = 100 / RATE

    far = LogModel(Odd(), [recorded(samples=4800)]).far_ahead()
    run = far.run((), neutral(far.free(()))[None], [4])
    looked_at = np.flatnonzero((run.statistics[2, :, 0, 0, 0] != 0.0) & run.pieces.scored[:, 0])
    first = int(np.argmax(run.pieces.scored[:, 0]))
    wanted = [t for t in range(first, len(run.states)) if t * 6 // 100 > (t - 1) * 6 // 100]
    assert set(wanted) <= {*looked_at, first}
    assert {100, 200, 300} <= set(looked_at)


@pytest.mark.slow
def test_a_disturbance_that_lasts_is_no_law_and_no_effect():
    """Far ahead nothing takes it up: it shows in many innovations of a block alike."""
    rng = np.random.default_rng(3)
    recording = recorded(samples=2400)
    keep, push, drift = np.exp(-1.0 / RATE / 2.0), 0.0, np.empty(2400)
    x = v = 0.0
    force = recording.columns["force_n"]
    for k in range(2400):
        drift[k] = x
        push = keep * push + 1.5 * np.sqrt(1.0 - keep**2) * rng.standard_normal()
        for _ in range(20):
            v += ((force[k] - 30.0 * x - 3.0 * v) / 2.0 + push) / RATE / 20
            x += v / RATE / 20
    noisy = {
        "force_n": force,
        "position_m": drift + 1e-3 * rng.standard_normal(2400),
        "seldom_m": drift + 2e-3 * rng.standard_normal(2400),
    }
    model = LogModel(Cart(), [Recording("cart", recording.time_s, noisy)])
    told = named(model, fitted_base(model))
    assert (judging.verdict_of(told), told.found.hypothesis) == ("none", ())
    assert told.leftover


def test_readings_that_are_passed_over_are_no_samples(rubbing):
    far = rubbing.far_ahead()
    base = fitted_base(far)
    readings = sum(int((s.log_density[s.channels[1]] != 0.0).sum()) for s in base.slopes.scores)
    assert whiteness(base).samples == readings


def test_a_law_by_which_forecasts_get_no_better_is_told_so():
    law = Law(coordinate="speed_mps", by_direction=True, removes=-0.2, low=-0.4, high=0.1)
    push = _push(law=law, matters=False)
    (line,) = (line for line in _unexplained(SimpleNamespace(unexplained=[push])) if "law" in line)
    assert line.strip() == (
        "A law over speed_mps and the direction of motion is evident, but forecasts get no better "
        "by it."
    )
