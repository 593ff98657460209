"""Which name an answer may give: rivals, sizes that may be nothing, models that explain nothing."""

from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from scipy.stats import t as student_t

from tests.gap.linear_model import EPISODES, Linear
from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import Free, Score
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.search import rounds
from wakedeploy.gap.search.artefacts import Round
from wakedeploy.gap.search.comparison import ComparisonDefaults
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.outcome import ACCEPTED, HARDLY, Named, verdict_of
from wakedeploy.gap.search.results import answer_of
from wakedeploy.gap.search.rivalry import (
    Verdict,
    is_absent,
    is_companion,
    is_nothing,
    undecided,
)
from wakedeploy.gap.search.rounds import _best, _is_something
from wakedeploy.gap.search.size_bounds import profiled
from wakedeploy.gap.search.weighing import Weight, is_outdone
from wakedeploy.gap.systems.answers.words import sentences
from wakedeploy.gap.systems.kinds.library import kinds_of, offered
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE = 50.0


class _Offering(ComparisonDefaults):
    """Nothing to fit; kinds are as they are."""

    effects: ClassVar = {}

    def simpler_effects(self, name):
        port = name.partition("@")[2]
        return [f"{kind}@{port}" for each in kinds_of(name) for kind in each.simpler]

    def inputs_answered(self, fitted, name):
        return {"added-inertia@v": 0.5, "gain@u": 0.2}.get(name, 1.0)


def _verdict(name, why, gains, error, neutral=(0.0,), size=0.5):
    """A candidate whose forecasts of 24 stretches are off by `error`, give or take a fifth."""
    free = tuple(
        SimpleNamespace(name=f"{name}.{k}", neutral=n, low=-0.9, high=5.0)
        for k, n in enumerate(neutral)
    )
    rng = np.random.default_rng(len(name))
    squares = error**2 * (1.0 + 0.2 * rng.uniform(-1.0, 1.0, (24, 1)))
    weight = SimpleNamespace(share=0.1, low=0.0, high=0.2)
    return Verdict(
        Candidate(name, SimpleNamespace(free=free, value=lambda _: size), np.array(gains)),
        why,
        weight,
        squares,
    )


def _told(*verdicts):
    leader = next(v for v in verdicts if v.why == ACCEPTED)
    return [v.candidate.name for v in _best(_Offering(), None, leader, verdicts)]


@pytest.fixture
def apart(monkeypatch):
    """Nothing is scored: none is a companion of another."""
    monkeypatch.setattr(rounds, "is_companion", lambda *given: False)


@pytest.mark.parametrize(("other", "is_one"), [("b", False), ("c", True)])
def test_what_gains_most_beside_another_is_no_rival_of_it(other, is_one):
    """C is another thing that is missing, too; b looks like a."""
    model = Linear({"a": 0.6, "c": 0.5})
    base, *fits = (fit(model, h, range(EPISODES)) for h in ((), ("a",), (other,)))
    best, second = (Candidate(f.hypothesis[0], f, np.ones(EPISODES)) for f in fits)
    assert is_companion(model, base, best, second) == is_one
    verdicts = [Verdict(each, ACCEPTED) for each in (best, second)]
    rivals = rounds._rivals(model, base, verdicts[0], verdicts)
    assert [v.candidate.name for v in rivals] == ([] if is_one else [other])
    nothing = Candidate(other, replace(fits[1], per_episode=base.per_episode - 1.0), best.gains)
    assert not is_companion(model, base, best, nothing)


def test_what_would_not_be_named_is_a_rival_all_the_same(apart):
    lag = _verdict("lag@u", ACCEPTED, [2.0, 3.0, 2.0, 1.0], 1.0)
    gain = _verdict("gain@u", HARDLY, [2.5, 1.5, 3.0, 2.0], 1.01)
    assert _told(gain, lag) == ["lag@u", "gain@u"]


def test_of_those_that_nothing_tells_apart_the_simplest_comes_first(apart):
    bent = _verdict("hysteresis@v", ACCEPTED, [2.5, 3.0, 2.0, 2.5], 1.0, neutral=(0.0, 1.0, 0.0))
    push = _verdict("offset@v", ACCEPTED, [2.0, 3.0, 2.0, 1.0], 1.01)
    gain = _verdict("gain@u", HARDLY, [2.5, 1.5, 3.0, 2.0], 1.01)
    assert _told(bent, gain, push) == ["offset@v", "hysteresis@v", "gain@u"]
    rubs = _verdict("coulomb@v", ACCEPTED, [2.5, 3.0, 2.0, 2.5], 1.0, neutral=(0.0, 1.0))
    assert _told(rubs, push) == ["coulomb@v", "offset@v"]  # a shape makes it no less simple


def test_a_rival_that_only_elaborates_another_rival_is_none(apart):
    bias, push = (_verdict(n, ACCEPTED, [3.0, 3.0], 1.0) for n in ("bias@u", "offset@v"))
    spring = _verdict("preloaded-spring@v", ACCEPTED, [3.0, 3.0], 1.0)
    assert _told(bias, push, spring) == ["bias@u", "offset@v"]
    assert _told(bias, spring) == ["bias@u", "preloaded-spring@v"]


@pytest.mark.parametrize(
    ("share", "low", "alone", "beside"),
    [
        (0.1, 0.05, True, True),
        (0.1, -0.05, True, False),
        (0.1, -0.2, False, False),
        (2e-3, 1e-3, False, False),
    ],
)
def test_beside_a_name_another_one_has_to_help_surely(share, low, alone, beside):
    weight = Weight(share, low, 2 * share - low)
    assert rounds.is_worth_naming(weight, ()) == alone
    assert rounds.is_worth_naming(weight, ("a",)) == beside


@pytest.mark.parametrize(
    ("turned_down", "named"),
    [((), "coulomb"), (("coulomb",), "stribeck"), (("coulomb", "stribeck"), None)],
)
def test_a_simpler_kind_that_is_turned_down_takes_no_candidate_with_it(
    monkeypatch, turned_down, named
):
    finer, simple = (_verdict(n, ACCEPTED, [2.0, 3.0], 1.0) for n in ("stribeck", "coulomb"))
    fakes = {
        "_judged_round": lambda *_: [finer],
        "_twins": lambda *_: None,
        "_plainer": lambda *_: simple,
        "_best": lambda model, found, leader, verdicts: [leader],
        "_with": lambda model, outcome, best: (
            None if best[0].candidate.name in turned_down else best[0].candidate.name
        ),
    }
    for part, fake in fakes.items():
        monkeypatch.setattr(rounds, part, fake)
    outcome = Named(None, None, None, [], alone=(finer.candidate,))
    assert rounds.with_one_more(_Offering(), outcome, lambda *_: None) == named


def test_what_every_block_finds_worse_is_no_rival(apart):
    lag = _verdict("lag@u", ACCEPTED, [9.0, 8.0, 9.0, 8.0], 1.0)
    gain = _verdict("gain@u", ACCEPTED, [3.0, 2.0, 3.0, 2.0], 1.0)
    assert _told(lag, gain) == ["lag@u"]


@pytest.mark.parametrize(("little", "told"), [(0.05, ["lag@u"]), (1.2, ["lag@u", "gain@u"])])
def test_what_explains_next_to_nothing_is_no_rival_of_what_a_few_blocks_show(apart, little, told):
    lag = _verdict("lag@u", ACCEPTED, [30.0, 0.5, 15.0, -0.5], 1.0)
    gain = _verdict("gain@u", HARDLY, [little, 0.0, 2 * little, little], 1.01)
    assert _told(lag, gain) == told


def test_forecasts_tell_apart_what_blocks_do_not():
    gains = [4.0, 1.0, 5.0, 2.0]
    members = [_verdict(n, ACCEPTED, gains, e) for n, e in (("a", 1.0), ("bb", 1.01), ("ccc", 2.0))]
    assert [v.candidate.name for v in undecided(_Offering(), members)] == ["a", "bb"]


@pytest.mark.parametrize(
    ("better", "told"),
    [("added-inertia@v", ["wake", "added-inertia@v"]), ("offset@v", ["offset@v"])],
)
def test_forecasts_take_out_no_leader_for_what_makes_inputs_do_less(apart, better, told):
    """A wake acts in a few blocks; a controller holds against it, as if there were more mass."""
    wake = _verdict("wake", ACCEPTED, [30.0, 0.0, 18.0, 0.0], 1.5)
    assert _told(wake, _verdict(better, ACCEPTED, [12.0, 6.0, 18.0, 1.0], 1.0)) == told


@pytest.mark.parametrize(
    ("gains", "error", "size", "told"),
    [
        ([20.0, 12.0, 18.0, 14.0], 1.5, -0.8, ["gain@u", "wake"]),
        ([20.0, 12.0, 18.0, 14.0], 1.5, -0.9, ["wake", "gain@u"]),  # as far as it may
        ([8.0, 4.0, 6.0, 5.0], 1.5, -0.8, ["gain@u"]),
    ],
)
def test_a_leader_by_which_inputs_do_hardly_anything_has_rivals_that_gain_much_of_what_it_does(
    apart, gains, error, size, told
):
    """A wake known in part only: of the rest, too, a controller holds against it."""
    weak = _verdict("gain@u", ACCEPTED, [25.0, 18.0, 26.0, 21.0], 1.0, size=size)
    wake = _verdict("wake", ACCEPTED, gains, error)
    assert _told(weak, wake) == told
    assert _told(weak, replace(wake, why=HARDLY)) == ["gain@u"]
    many = [_verdict(f"wake {k}", ACCEPTED, gains, error) for k in range(4)]
    assert len(_told(weak, *many)) == (3 if len(told) > 1 else 1)  # no class is larger
    mass = _verdict("added-inertia@v", ACCEPTED, [25.0, 18.0, 26.0, 21.0], 1.0)
    assert _told(mass, wake) == ["added-inertia@v"]  # half of what they do is plausible
    as_little = replace(mass.candidate, gains=wake.candidate.gains)
    assert _told(weak, replace(mass, candidate=as_little, squares=wake.squares)) == ["gain@u"]


def test_beside_inputs_that_do_hardly_anything_a_companion_is_no_rival(monkeypatch):
    weak = _verdict("gain@u", ACCEPTED, [25.0, 18.0, 26.0, 21.0], 1.0)
    wake = _verdict("wake", ACCEPTED, [20.0, 12.0, 18.0, 14.0], 1.5)
    for is_one in (True, False):
        monkeypatch.setattr(rounds, "is_companion", lambda *given, is_one=is_one: is_one)
        assert _told(weak, wake) == (["gain@u"] if is_one else ["gain@u", "wake"])


def test_a_trifle_tells_no_forecasts_apart_however_sure_it_is():
    gains = [4.0, 1.0, 5.0, 2.0]
    errors = ("a", 1.0), ("b", 1.002), ("c", 1.02)  # each off by the same share in every stretch
    members = [_verdict(n, ACCEPTED, gains, e) for n, e in errors]
    assert [v.candidate.name for v in undecided(_Offering(), members)] == ["a", "b"]


@pytest.mark.parametrize(("size", "something"), [(0.0, False), (0.6, True)])
def test_an_effect_whose_size_may_be_nothing_is_not_named(size, something):
    model = Linear({"gain": 0.4, "c": size})
    episodes = range(model.episodes)
    base, larger = fit(model, (), episodes), fit(model, ("c",), episodes)
    assert is_nothing(larger, "c") != something
    searched = Round(given=[], threshold_nats=-100.0, steady_nats=-100.0, ranking=[])
    assert _is_something(candidate(base, "c", larger), searched, False) == something


def test_what_forecasts_show_in_every_block_may_gain_in_one():
    model = Linear({"gain": 0.4, "c": 0.6})
    larger = fit(model, ("c",), range(model.episodes))
    gains = np.array([30.0, *(len(larger.episodes) - 1) * [0.2]])
    searched = Round(given=[], threshold_nats=20.0, steady_nats=3.0, ranking=[])
    for by_forecasts in (False, True):
        effect = Candidate("c", larger, gains)
        assert _is_something(effect, searched, by_forecasts) == by_forecasts


def test_an_effect_of_no_size_is_not_what_a_fit_rises_by():
    model = Linear({"gain": 0.4, "c": 0.6})
    larger = fit(model, ("c",), range(model.episodes))
    assert not is_absent(larger, "c")
    theta = np.where([n == "c.size" for n in larger.names], 0.0, larger.theta)
    assert is_absent(replace(larger, theta=theta), "c")


class Levelling:
    """Readings 1 − exp(−size) + noise: a large size is known to be large, and not how large."""

    episodes, noise = 5, 0.1

    def __init__(self):
        noise = self.noise * np.random.default_rng(0).standard_normal((self.episodes, 40))
        self.y = 1.0 - np.exp(-6.3) + noise - noise.mean()

    def free(self, hypothesis):
        size = Free("bend.size", "1", 0.0, np.inf, -50.0, 50.0, 1e-4)
        return (size,) * len(hypothesis)

    def score(self, hypothesis, theta, episode):
        told = 1.0 - np.exp(-theta[0]) if len(theta) else 0.0
        off, variance = self.y[episode] - told, np.full(40, self.noise**2)
        density = -0.5 * (off**2 / variance + np.log(2.0 * np.pi * variance))
        return Score(density, off, variance, np.ones(40))


def test_the_end_of_an_interval_is_found_where_the_likelihood_is_no_parabola():
    model = Levelling()
    found = fit(model, ("bend",), range(5), np.array([6.3]))
    assert is_nothing(found, "bend")  # its curvature says so
    told = profiled(model, found, "bend")
    low, high = told.interval("bend.size")
    assert 0.0 < low < found.theta[0] < high

    def lost(size):  # nats of each block, by the densities themselves
        return [
            sum(
                model.score(("bend",), theta, e).log_density.sum() * sign
                for theta, sign in ((found.theta, 1.0), (np.array([size]), -1.0))
            )
            for e in range(5)
        ]

    at_end, quantile = np.array(lost(low)), student_t.ppf(0.95, 4)
    assert at_end.sum() > 0.5 * quantile**2
    assert at_end.sum() > quantile * at_end.std(ddof=1) * 5**0.5


class Sticking(Levelling):
    """The same, where more than ten is surely too much, as a friction at which nothing moves."""

    def score(self, hypothesis, theta, episode):
        told = super().score(hypothesis, theta, episode)
        beyond = max(theta[0] - 10.0, 0.0) if len(theta) else 0.0
        return Score(told.log_density - beyond, told.innovation, told.variance, np.ones(40))


def test_the_other_end_of_such_an_interval_is_found_likewise():
    model = Sticking()
    found = fit(model, ("bend",), range(5), np.array([6.3]))
    assert found.interval("bend.size")[1] > 2.2 * found.theta[0]
    told = profiled(model, found, "bend")
    assert told.interval("bend.size")[1] == pytest.approx(2.0 * found.theta[0])


class Joint(System):
    """A joint that turns by itself, whatever is commanded."""

    rate_hz = RATE
    inputs: ClassVar = [Input("torque_nm", "N m")]
    states: ClassVar = {"speed_radps": "rad/s"}
    outputs: ClassVar = [Output("speed_radps", "rad/s", noise=0.01)]
    constants: ClassVar = [Constant("inertia_kgm2", 0.5, spread=0.01)]
    ports: ClassVar = [
        Port.input("torque_nm", kinds=["dead-time", "gain"]),
        Port.output("speed_radps", kinds=["sensor-bias"]),
    ]

    def derivative(self, state, inputs, c):
        return {"speed_radps": inputs.torque_nm / c.inertia_kgm2}


@pytest.mark.slow
def test_nothing_is_named_on_a_model_that_forecasts_worse_than_none():
    rng = np.random.default_rng(2)
    time_s = np.arange(640) / RATE
    torque = np.repeat(rng.uniform(-1.0, 1.0, 40), 16)
    speed = 0.5 + 0.3 * np.sin(7.0 * time_s) + 0.01 * rng.standard_normal(640)
    recorded = Recording("apart", time_s, {"torque_nm": torque, "speed_radps": speed})
    model = LogModel(Joint(), [recorded])
    told = named(model, fitted_base(model))
    assert told.is_outdone
    assert (verdict_of(told), told.found.hypothesis) == ("unknown", ())
    assert "no better than its outputs' last readings" in sentences(answer_of(told))[0]


class Fan(System):
    """A fan whose air resists by the square of its speed, which its model leaves out."""

    rate_hz = RATE
    inputs: ClassVar = [Input("duty", "1")]
    states: ClassVar = {"speed_per_s": "1/s"}
    outputs: ClassVar = [Output("speed_per_s", "1/s", noise=0.02)]
    constants: ClassVar = [
        Constant("gain", 40.0, spread=4.0),
        Constant("friction", 0.5, spread=0.1),
    ]
    ports: ClassVar = [
        Port.input("duty", kinds=["dead-time"]),
        Port.force("speed_per_s", kinds=["quadratic-drag"]),
        Port.output("speed_per_s", kinds=["sensor-bias"]),
    ]

    def derivative(self, state, inputs, c):
        return {"speed_per_s": c.gain * inputs.duty - c.friction * state.speed_per_s}


@pytest.mark.slow
def test_what_removes_most_of_the_error_is_named_also_where_the_last_reading_is_hard_to_outdo():
    """The duty seldom changes and the load wanders slowly: the last reading forecasts well."""
    rng = np.random.default_rng(1)
    duty = np.repeat(rng.uniform(0.5, 0.6, 10), 200)
    loads, speeds = np.zeros(len(duty)), np.full(len(duty), 7.0)
    kept = np.exp(-1.0 / RATE / 2.0)
    for i in range(1, len(duty)):
        loads[i] = kept * loads[i - 1] + 1.5 * np.sqrt(1.0 - kept**2) * rng.standard_normal()
        speeds[i] = speeds[i - 1]
        for _ in range(4):
            drag = 0.5 * speeds[i] + 0.4 * speeds[i] ** 2
            speeds[i] += (40.0 * duty[i - 1] - drag + loads[i - 1]) / RATE / 4
    read = speeds + 0.02 * rng.standard_normal(len(duty))
    time_s = np.arange(len(duty)) / RATE
    model = LogModel(Fan(), [Recording("fan", time_s, {"duty": duty, "speed_per_s": read})])
    answer = named(model, fitted_base(model))
    assert is_outdone(model, answer.found)
    assert not answer.is_outdone
    assert answer.found.hypothesis == ("quadratic-drag@speed_per_s",)
    assert answer.found.value("quadratic-drag@speed_per_s.coefficient") == pytest.approx(
        0.4, abs=0.05
    )


class Resonator(System):
    """A mass on a spring that nobody has measured."""

    rate_hz = RATE
    inputs: ClassVar = [Input("drive", "1")]
    states: ClassVar = {"way": "1", "speed": "1/s"}
    outputs: ClassVar = [Output("way", "1", noise=0.01)]
    constants: ClassVar = [
        Constant("stiffness", 40.0, spread=float("inf")),
        Constant("damping", 2.0, spread=float("inf")),
    ]

    def derivative(self, state, inputs, c):
        pull = c.stiffness * (inputs.drive - state.way)
        return {"way": state.speed, "speed": pull - c.damping * state.speed}


@pytest.mark.whole
def test_a_constant_that_nobody_has_measured_is_found_from_far_away():
    rng = np.random.default_rng(3)
    drive = np.repeat(rng.choice([-1.0, 1.0], 40), 15)
    way, speed, shown = 0.0, 0.0, np.empty(len(drive))
    for k, u in enumerate(drive):
        shown[k] = way
        for _ in range(20):
            speed += (320.0 * (u - way) - 3.0 * speed) / RATE / 20
            way += speed / RATE / 20
    shown += 0.01 * rng.standard_normal(len(drive))
    columns = {"drive": drive, "way": shown}
    model = LogModel(Resonator(), [Recording("rung", np.arange(len(drive)) / RATE, columns)])
    base = fitted_base(model)
    assert base.value("constant.stiffness") == pytest.approx(320.0, rel=0.05)
    assert base.value("constant.damping") == pytest.approx(3.0, rel=0.2)


class Tank(System):
    rate_hz = 1.0
    inputs: ClassVar = [Input("pump", "V")]
    states: ClassVar = {"level_m": "m"}
    outputs: ClassVar = [Output("level_m", "m")]
    ports: ClassVar = [Port.input("pump"), Port.force("level_m")]

    def derivative(self, state, inputs, c):
        return {"level_m": inputs.pump - state.level_m}


@pytest.mark.parametrize(
    ("least", "turns", "absent"),
    [
        (0.5, 0.0, {"coulomb-friction@level_m", "hysteresis@level_m", "dead-band@pump"}),
        (0.01, 0.0, {"hysteresis@level_m", "asymmetry@pump"}),
        (0.0, 1.0, set()),
    ],
)
def test_what_asks_for_a_sign_is_offered_where_a_sign_may_turn(least, turns, absent):
    sizes = {"pump": 1.0, "level_m": 1.0, "d level_m": 1.0, "y level_m": 1.0}
    for name in ("pump", "level_m"):
        sizes |= {f"least {name}": least, f"turns {name}": turns}
    asks = {"coulomb-friction@level_m", "hysteresis@level_m", "dead-band@pump", "asymmetry@pump"}
    there = set(offered(Tank(), sizes, (1.0, 100.0)))
    assert absent.isdisjoint(there)
    if turns:
        assert asks <= there
    assert "viscous-friction@level_m" in there


@pytest.mark.parametrize(
    ("gained", "is_told"), [(0.005, False), (0.012, False), (0.05, True), (0.3, True)]
)
def test_forecasts_tell_rivals_apart_if_one_is_surely_better_by_what_matters(gained, is_told):
    """Better by 1.2 % for sure, and maybe by less than matters."""
    errors = 1.0 + 0.1 * np.cos(np.arange(24.0))[:, None]
    worse = errors * (1.0 + gained + 0.015 * np.sin(2.0 * np.arange(24.0))[:, None])
    members = [
        Verdict(Candidate(n, None, np.ones(4)), ACCEPTED, None, squares)
        for n, squares in (("best", errors), ("other", worse))
    ]
    left = [v.candidate.name for v in undecided(_Offering(), members)]
    assert left == (["best"] if is_told else ["best", "other"])
