"""What the workflow answers about effects that are hidden in the virtual gantry."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recorded import RIG, SECONDS, based, changed, flown, with_effects

from wakedeploy.core.rig import Effect, EffectParameter
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.fits import extended
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.progress import quiet
from wakedeploy.gap.systems.gantry.find_name_add_show import Case, _judged, find, name, write_answer
from wakedeploy.gap.systems.gantry.flight import read_flights
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search import naming, refitting
from wakedeploy.gap.systems.gantry.search.detectability import detectable
from wakedeploy.gap.systems.gantry.search.expressions import search
from wakedeploy.gap.systems.gantry.search.naming import (
    _claimed,
    _needed,
    _Search,
    _unsettled,
    fitted_base,
    name_effects,
    ranked_by_own_motion,
    with_terms,
)
from wakedeploy.gap.systems.gantry.search.outcome import Answer, Round, Thresholds
from wakedeploy.gap.systems.gantry.search.places import find_places
from wakedeploy.gap.systems.gantry.search.refitting import (
    expressed_by_own_motion,
    reduced,
    refitted,
    without_idle,
)
from wakedeploy.physics.constants import constants_of
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.effects.chain import setting_of
from wakedeploy.physics.effects.symbolic import SYMBOLIC

# About what this rig's own simulations give; see `threshold`.
LIMITS = Thresholds(6.0, 8.0, 8.0, 36.0, 0.02, 0.02, 0.003)
SEEDS = (51, 52, 53)
TRIED = ("command-latency", "coulomb-friction", "ground-effect")
STRONG = {
    "ground-effect": {"gain": (0.3, "1"), "height_m": (0.15, "m")},
    "command-latency": {"latency_s": (0.03, "s")},
    "coulomb-friction": {"coulomb_n": (0.3, "N")},
}


def answered(*names: str, hook=None, seeds=SEEDS, tried=TRIED) -> Answer:
    """The answer about flights in which these effects, or a force, are hidden."""
    truth = with_effects(**{n.replace("-", "_"): STRONG[n] for n in names}) if names else RIG
    model = GantryModel(RIG, [flown(seed, truth, hook) for seed in seeds])
    return name_effects(RIG, model, LIMITS, candidates=tried)


@pytest.fixture(scope="module")
def ground() -> Answer:
    return answered("ground-effect")


@pytest.fixture(scope="module")
def nothing() -> Answer:
    model, base = based(*SEEDS)
    return name_effects(RIG, model, LIMITS, candidates=TRIED, base=base)


@pytest.mark.slow
def test_nothing_that_matters_is_missing_where_nothing_is_hidden(nothing, tmp_path) -> None:
    """Three short flights may show a trace of something; others, that are sealed, decide."""
    sealed = tuple(flown(seed) for seed in (54, 55))
    case = Case(RIG, nothing.model.flights, sealed, LIMITS)
    told = _judged(case, tmp_path, nothing, write_answer(nothing, tmp_path, 0.0), quiet)
    assert told.verdict == "none"
    assert nothing.effects == nothing.members == ()
    assert nothing.rounds[0].given == ()
    assert nothing.rounds[0].ranking[0].gain_nats < LIMITS.effect_nats
    assert nothing.white.statistic < LIMITS.whiteness


def holds_truth(answer: Answer, effect: str) -> None:
    """The truth lies in the 99 % interval of each parameter, and the 90 % one is inside that."""
    for parameter, (truth, _) in STRONG[effect].items():
        name = f"{effect}.{parameter}"
        value, (low, high) = answer.fit.value(name), answer.fit.interval(name)
        widest = answer.fit.interval(name, 0.99)
        assert widest[0] <= low <= value <= high <= widest[1]
        assert widest[0] <= truth <= widest[1], (effect, parameter, value)


@pytest.fixture(scope="module")
def late() -> Answer:
    return answered("command-latency", tried=TRIED[:2])


@pytest.mark.slow
def test_a_strong_effect_is_named_with_its_size(late) -> None:
    assert late.verdict == "named"
    assert late.effects == ("command-latency",)
    holds_truth(late, "command-latency")


@pytest.mark.slow
def test_unless_told_otherwise_the_whole_library_is_tried(monkeypatch, nothing) -> None:
    class Tried(Exception):
        """Ends a search, which takes a minute, as soon as it has begun."""

    def ranked(model, base, names, *_):
        raise Tried(*names)

    monkeypatch.setattr("wakedeploy.gap.systems.gantry.search.naming.ranked_by_own_motion", ranked)
    with pytest.raises(Tried) as ended:
        name_effects(RIG, nothing.base_model, LIMITS, base=nothing.base)
    assert set(ended.value.args) == set(LIBRARY)


@pytest.mark.slow
def test_friction_is_named_with_its_size() -> None:
    friction = answered("coulomb-friction")
    assert friction.verdict == "named"
    assert friction.effects == ("coulomb-friction",)
    holds_truth(friction, "coulomb-friction")


def test_a_relative_of_what_was_found_has_to_gain_more() -> None:
    found = {"command-latency": 300.0, "added-mass": 50.0}
    assert _needed("esc-frame", found, LIMITS) == pytest.approx(30.0)
    assert _needed("spool-lag-sufferer", found, LIMITS) == pytest.approx(35.0)  # of both
    for other in ("ground-effect", "crosswind-offset"):
        assert _needed(other, found, LIMITS) == LIMITS.effect_nats
    assert _needed("esc-frame", {}, LIMITS) == LIMITS.effect_nats
    assert _needed("esc-frame", {"command-latency": 20.0}, LIMITS) == LIMITS.effect_nats


@pytest.mark.slow
def test_an_effect_of_two_parameters_is_named_with_both(ground) -> None:
    assert ground.verdict == "named"
    assert ground.effects == ("ground-effect",)
    holds_truth(ground, "ground-effect")
    assert all(set(searched.given) <= {"ground-effect"} for searched in ground.rounds)


@pytest.mark.slow
def test_two_effects_are_found_together() -> None:
    answer = answered("coulomb-friction", "ground-effect")
    assert answer.verdict == "named"
    assert set(answer.effects) == {"coulomb-friction", "ground-effect"}
    holds_truth(answer, "coulomb-friction")
    holds_truth(answer, "ground-effect")


def beyond_the_library(t_s, state) -> float:
    """A force [N] that depends on the source and the carriage together."""
    return 0.15 * state["source_thrust_n"] * state["x_m"]


@pytest.mark.slow
def test_a_force_that_is_no_known_effect_is_unknown_with_its_coordinates() -> None:
    answer = answered(hook=beyond_the_library)
    assert answer.verdict == "unknown"
    assert answer.effects == ()
    assert answer.unknown is not None
    assert "x_m" in answer.unknown.coordinates
    assert set(answer.unknown.coordinates) <= {"x_m", "source_n"}
    assert answer.unknown.gain_nats > LIMITS.expression_nats


def notch(t_s, state) -> float:
    """An eighth of the sufferer's thrust [N] is lost around one thrust: no effect's form."""
    thrust_n = state["sufferer_thrust_n"]
    return -0.12 * thrust_n * np.exp(-0.5 * ((thrust_n - 4.4) / 0.2) ** 2)


@pytest.mark.slow
def test_nothing_is_not_the_answer_where_a_place_disagrees() -> None:
    """No effect, no expression and white innovations: the fitted noise has swallowed it."""
    model = GantryModel(RIG, [flown(seed, hook=notch) for seed in SEEDS])
    near, base = fitted_base(model)
    places = find_places(near, base, LIMITS.whiteness, LIMITS.places).places
    assert {p.coordinate for p in places} >= {"sufferer command"}
    verdicts = {
        seen: name_effects(RIG, model, LIMITS, candidates=TRIED, disagrees=seen).verdict
        for seen in (False, bool(places))
    }
    assert verdicts == {False: "none", True: "unknown"}


@pytest.mark.parametrize(("explained", "has_name"), [(39.7, True), (30.0, False)])
def test_a_formula_takes_no_place_of_effects_that_explain_nearly_as_much(
    monkeypatch, explained, has_name
) -> None:
    """A viscous force and a little of the wake's form, 48.7 nats, for a loss of thrust in climb."""
    formula, fitted = SimpleNamespace(gain_nats=48.7), SimpleNamespace(hypothesis=("one",))
    monkeypatch.setattr(naming, "gain_over", lambda *_: explained)
    monkeypatch.setattr(naming, "_expression", lambda *_, **__: formula)
    unknown, rest = naming._rest(None, None, fitted, None, LIMITS)
    assert (unknown is formula, rest) == (not has_name, None)


def test_too_few_flights_are_not_searched_for_a_verdict() -> None:
    with pytest.raises(ValueError, match="2 flights; a verdict takes 3"):
        answered("command-latency", seeds=SEEDS[:2])


@pytest.mark.slow
def test_an_effect_that_the_others_make_superfluous_is_dropped(ground) -> None:
    model = ground.model
    both = ("range-scale", "ground-effect")
    needless = fit(model, both, range(3), model.start(both))
    _, kept = without_idle(model, needless)
    assert kept.hypothesis == ("ground-effect",)
    assert kept.value("ground-effect.gain") == pytest.approx(
        ground.fit.value("ground-effect.gain"), rel=0.1
    )


@pytest.mark.slow
def test_effects_that_are_needed_are_kept() -> None:
    model = GantryModel(
        RIG,
        [
            flown(
                s,
                with_effects(
                    coulomb_friction=STRONG["coulomb-friction"],
                    ground_effect=STRONG["ground-effect"],
                ),
            )
            for s in SEEDS
        ],
    )
    both = ("coulomb-friction", "ground-effect")
    near, base = fitted_base(model)
    start = np.array(
        [
            dict(zip(base.names, base.theta, strict=True)).get(f.name, f.starts[-1])
            for f in near.free(both)
        ]
    )
    needed = fit(near, both, range(3), start)
    _, kept = without_idle(near, needed)
    assert kept.hypothesis == both
    _, kept = without_idle(near, needed, both[:1], least_nats=1e4)
    assert kept.hypothesis == both[1:]


def candidates(**gains: float) -> tuple[Candidate, ...]:
    """Candidates with these gains, best first."""
    made = [Candidate(n, None, np.array([g])) for n, g in gains.items()]  # type: ignore[arg-type]
    return tuple(sorted(made, key=lambda c: -c.gain_nats))


def test_a_class_holds_what_is_within_three_nats_of_the_best() -> None:
    searched = Round((), candidates(a=30.0, b=30.1 - RULES.class_nats, c=29.9 - RULES.class_nats))
    assert [c.name for c in searched.rivals] == ["a", "b"]
    many = Round((), candidates(a=30.0, b=29.9, c=29.8, d=29.7))
    assert [c.name for c in many.rivals] == ["a", "b", "c"]


def test_what_was_taken_has_rivals_also_where_a_better_relative_was_passed_over() -> None:
    ranking = candidates(a=20.0, b=19.5, c=19.0, d=10.0)
    taken = Round(("x",), ranking, "b")
    assert [c.name for c in taken.rivals] == ["b", "a", "c"]
    current = SimpleNamespace(hypothesis=("x", "b"), episodes=range(5))
    assert _unsettled([taken], current) == [taken]  # type: ignore[arg-type]
    clear = Round(("x",), candidates(b=20.0, c=10.0), "b")
    assert _unsettled([clear], current) == []  # type: ignore[arg-type]


def test_what_one_round_doubts_is_not_claimed_because_another_round_took_it() -> None:
    first = Round((), candidates(a=11.0, b=10.0), "a")
    second = Round(("a",), candidates(b=9.0, c=1.0), "b")
    current = SimpleNamespace(hypothesis=("a", "b"), episodes=range(5))
    assert _claimed("class", [first, second], current) == ()  # type: ignore[arg-type]
    third = Round(("a", "b"), candidates(d=9.0, c=1.0), "d")
    current.hypothesis = ("a", "b", "d")
    assert _claimed("class", [first, second, third], current) == ("d",)  # type: ignore[arg-type]


@pytest.mark.slow
def test_an_expression_is_told_around_the_motion_that_it_explains() -> None:
    """Around the motion that the flights have without it, a force against the speed shows less."""
    size = EffectParameter(value=-2.0, unit="N s^2/m^2")
    drag = Effect(name=SYMBOLIC, expression="c1*vz_mps*abs(vz_mps)", parameters={"c1": size})
    truth = RIG.model_copy(update={"effect": (drag,)})
    model, base = fitted_base(
        with_terms(GantryModel(RIG, [flown(s, truth, seconds=12.0) for s in (3, 5, 7)]))
    )
    setting = vars(setting_of(RIG))
    found = search(model, base, setting=setting, names=["speed-squared"], least_nats=1.0)
    assert found is not None
    own = expressed_by_own_motion(model, base, found)
    assert own.terms == found.terms
    assert own.gain_nats > found.gain_nats + 2.0  # of 190
    (coefficient,) = own.coefficients
    assert coefficient.low < -2.0 < coefficient.high


def searched(found: dict[str, float]) -> _Search:
    """A search that has found these with these gains, and that no expression helps."""
    search = _Search(None, None, None, LIMITS, RULES.class_nats)  # type: ignore[arg-type]
    search._gains = found
    search.expression = lambda model, current: None  # type: ignore[method-assign]
    return search


def test_the_search_walks_past_a_relative_that_gains_too_little() -> None:
    """20 nats beside 300 of its relative only mend that one's form; 15 of another are something."""
    ranked = candidates(**{"esc-frame": 20.0, "ground-effect": 15.0, "crosswind-offset": 9.0})
    chosen = searched({"command-latency": 300.0})._chosen(ranked)
    assert chosen is not None
    assert chosen.name == "ground-effect"
    first = searched({})._chosen(ranked)
    assert first is not None
    assert first.name == "esc-frame"
    weak = candidates(**{"esc-frame": 20.0, "ground-effect": LIMITS.effect_nats - 0.1})
    assert searched({"command-latency": 300.0})._chosen(weak) is None


def test_confidence_is_shared_with_nothing_and_the_rivals() -> None:
    searched = Round((), candidates(a=2.0, b=1.0))
    total = 1.0 + np.exp(2.0) + np.exp(1.0)
    shares = [searched.confidence(c) for c in searched.ranking]
    assert shares == pytest.approx([np.exp(2.0) / total, np.exp(1.0) / total])
    assert Round((), candidates(a=2000.0)).confidence(candidates(a=2000.0)[0]) == 1.0


@pytest.mark.parametrize(("beyond_nats", "sure"), [(0.0, 0.5), (3.0, 0.953), (-3.0, 0.047)])
def test_an_effect_at_the_threshold_is_as_likely_as_nothing(beyond_nats, sure) -> None:
    """So much is what the best of all effects gains where nothing is missing."""
    ranking = candidates(a=9.0 + beyond_nats)
    searched = Round((), ranking, "a", least_nats=9.0)
    assert searched.confidence(ranking[0]) == pytest.approx(sure, abs=0.001)


@pytest.mark.slow
def test_what_would_have_been_noticed_is_smaller_than_what_was_hidden(nothing) -> None:
    sizes = detectable(nothing)
    for effect, parameter in (("ground-effect", "gain"), ("coulomb-friction", "coulomb_n")):
        told = sizes[effect]
        assert told.parameter == parameter
        assert 0.0 < told.size < STRONG[effect][parameter][0]
        assert told.known


@pytest.mark.slow
def test_a_hidden_effect_of_the_size_told_gains_what_it_must(nothing) -> None:
    """15 nats and as many again for chance: half to twice of it."""
    size_n = detectable(nothing)["coulomb-friction"].size
    rubbing = constants_of(RIG)["rail.coulomb_n"] + size_n
    truth = with_effects(coulomb_friction={"coulomb_n": (rubbing, "N")})
    model, base = fitted_base(GantryModel(RIG, [flown(seed, truth) for seed in SEEDS]))
    _, _, (found,) = ranked_by_own_motion(model, base, ["coulomb-friction"], LIMITS.effect_nats)
    assert 0.5 < found.gain_nats / (2.0 * LIMITS.effect_nats) < 2.0


@pytest.mark.slow
def test_no_size_is_told_of_what_is_far_from_linear(nothing) -> None:
    """A dead band does nothing at first; 7 us of it are found, whatever its slope at zero says."""
    told = detectable(nothing)["pwm-dead-band"]
    assert (told.parameter, told.unit, told.known) == ("band_us", "us", False)
    assert math.isnan(told.size)


def written(tmp_path, variant: str):
    """Flights with a hidden effect, read from files whose truth is there, gone, or nonsense."""
    truth = with_effects(command_latency=STRONG["command-latency"])
    paths = []
    for seed in SEEDS:
        log = record(truth, seconds=SECONDS, seed=seed, model_rig=RIG)
        if variant == "without":
            log = log.without_truth()
        if variant == "nonsense":
            columns = {n: -v for n, v in log.columns.items() if n.startswith("true_")}
            log = changed(log, **columns)
        (tmp_path / variant).mkdir(exist_ok=True)
        paths.append(tmp_path / variant / f"{seed}.mcap")
        log.write_mcap(paths[-1])
    return read_flights(paths, RIG)


def told(flights) -> str:
    """Everything that find and name say about flights, as text."""
    model, base = fitted_base(GantryModel(RIG, flights))
    answer = name_effects(RIG, GantryModel(RIG, flights), LIMITS, candidates=TRIED[:2])
    named = {
        "verdict": answer.verdict,
        "effects": answer.effects,
        "gains": [[(c.name, c.gain_nats) for c in r.ranking] for r in answer.rounds],
        "theta": answer.fit.theta.tolist(),
        "intervals": [answer.fit.interval(n) for n in answer.fit.names],
        "white": answer.white.as_json(LIMITS.whiteness),
    }
    found = find_places(model, base, LIMITS.whiteness, LIMITS.places)
    return json.dumps([found.as_json(), named])


@pytest.mark.slow
def test_truth_in_the_logs_makes_no_difference_in_any_byte(tmp_path) -> None:
    with_truth, nonsense = (told(written(tmp_path, v)) for v in ("with", "nonsense"))
    assert "command-latency" in with_truth
    assert nonsense == with_truth


@pytest.mark.slow
def test_the_artefacts_are_the_same_without_the_truth(tmp_path) -> None:
    """The whole library, through the files; only file hashes and times taken may differ."""
    texts = []
    for variant in ("with", "without"):
        flights = written(tmp_path, variant)
        case, out = Case(RIG, tuple(flights), (), LIMITS), tmp_path / f"{variant}.out"
        found = find(case, out).as_json()
        named = name(case, out).as_json()
        named.pop("seconds")
        found.pop("logs")
        found.pop("split")
        texts.append(json.dumps([found, named]))
    assert texts[0] == texts[1]


@pytest.mark.slow
def test_without_an_effect_the_constant_that_it_replaced_goes_on_from_its_value(
    monkeypatch, nothing
) -> None:
    """From the rig file's value, under the noise that was fitted, a climb was 4,600 nats short."""

    class Begun(Exception):
        """Ends a fit, which takes half a minute, where it begins."""

    def begun(model, hypothesis, episodes, start):
        raise Begun(dict(zip([f.name for f in model.free(hypothesis)], start, strict=True)))

    model, both = nothing.model, ("spool-lag-source", "transport-speed")
    free = model.free(both)
    theta = extended(nothing.base, free)
    theta[[f.name for f in free].index("transport-speed.speed_mps")] = 4.3
    found = replace(nothing.base, hypothesis=both, free=free, theta=theta)
    monkeypatch.setattr(refitting, "fit", begun)
    with pytest.raises(Begun) as told:
        reduced(model, found, both[:1])
    assert told.value.args[0]["wake.speed_mps"] == 4.3


@pytest.mark.slow
def test_without_an_effect_as_much_is_explained_as_a_fit_from_afar_explains() -> None:
    """A wake of a twentieth: its constant's prior pulls back at once, to where all is louder.

    Under the noise that was fitted with the effect the climb ended a hundred nats short.
    """
    both = ("wake-strength", "spool-lag-sufferer")
    hidden = with_effects(
        wake_strength={"strength": (19.0, "m/s^2")},
        spool_lag_sufferer={"up_s": (0.11, "s"), "down_s": (0.15, "s")},
    )
    model = GantryModel(RIG, [flown(s, hidden) for s in SEEDS])
    near, base = fitted_base(model)
    start = dict(zip(base.names, base.theta, strict=True))
    begun = [start.get(f.name, f.starts[0] if f.starts else f.neutral) for f in near.free(both)]
    near, found = refitted(near, fit(near, both, range(3), np.array(begun)))
    assert found.value("wake-strength.strength") < 0.2 * RIG.wake.strength
    _, without = reduced(near, found, both[1:])
    _, afar = refitted(model, fit(model, both[1:], range(3), model.start(both[1:])))
    assert without.objective > afar.objective - 3.0
    assert found.objective > without.objective + 20.0
