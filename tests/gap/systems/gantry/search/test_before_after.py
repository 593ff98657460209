"""The gap shown: smaller with the effect that was hidden, and a placebo that could have helped."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fabricated_artefacts import PLACE, leave, summary
from recorded import RIG, flown, with_effects

from wakedeploy.gap.evidence.fits import extended
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import rank
from wakedeploy.gap.evidence.whiteness import whiteness
from wakedeploy.gap.report.shrinkage import channel_lines
from wakedeploy.gap.report.summary import account
from wakedeploy.gap.systems.gantry.artefacts import Name, Show, Summary
from wakedeploy.gap.systems.gantry.find_name_add_show import Case, show_gap
from wakedeploy.gap.systems.gantry.findings import Effect, Retraining
from wakedeploy.gap.systems.gantry.folder import StepArtefacts
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.before_after import show, wrong_effects
from wakedeploy.gap.systems.gantry.search.naming import fitted_base
from wakedeploy.gap.systems.gantry.search.outcome import Answer, Round, Thresholds
from wakedeploy.gap.systems.gantry.search.saved_fits import Found, Tried
from wakedeploy.physics.constants import with_constants
from wakedeploy.physics.effects import LIBRARY

HIDDEN = "tether-spring"
TRUTH = with_effects(tether_spring={"stiffness_n_per_m": (1.5, "N/m"), "slack_m": (0.3, "m")})
TRIED = (HIDDEN, "recirculation", "spool-lag-source", "spool-lag-sufferer")
THRESHOLDS = Thresholds(6.0, 8.0, 8.0, 60.0, 0.03, 0.03, 0.003)
PLACES = [
    {"channel": channel, "coordinate": coordinate}
    for channel, coordinate in [
        ("innovation", "height"),
        ("innovation", "height reference"),
        ("force", "height"),
        ("force", "everywhere"),
    ]
]


@pytest.fixture(scope="module")
def answer() -> Answer:
    """The hidden effect found in two flights."""
    model, base = fitted_base(GantryModel(RIG, [flown(seed, TRUTH) for seed in (40, 41)]))
    ranking = rank(model, base, TRIED)
    found = fit(model, (HIDDEN,), range(2), ranking[0].fit.theta)
    rounds = (Round((), tuple(ranking)),)
    return Answer(
        "named",
        (HIDDEN,),
        (),
        rounds,
        model,
        model,
        base,
        found,
        whiteness(found),
        None,
        None,
        THRESHOLDS,
    )


def shown(answer: Answer, sealed: tuple, out: Path, scored: list) -> Show:
    """`show.json` and the flights that predictors were scored on."""
    case = Case(RIG, tuple(answer.model.flights), sealed, THRESHOLDS)
    logs = [{"path": "", "sha256": sha256} for sha256 in case.recordings]
    places = [PLACE | place for place in PLACES]
    leave(out, "find", {"rig_sha256": RIG.sha256, "logs": logs, "places": places})
    leave(out, "name", {"verdict": "named", "effects": [{"name": HIDDEN}]})
    added = {"rig": "rig.toml", "old_sha256": "", "new_sha256": ""}
    leave(out, "add", added | {"effects": [{"name": HIDDEN}]})
    TRUTH.write(out / "rig.toml")
    Found.of(answer).write(out)

    def retrain(old, new, logs, into):
        assert (old, new.effect, into) == (RIG, TRUTH.effect, out)
        scored.extend(logs)
        return Retraining(old_rmse=0.2, new_rmse=0.1, scored_on=[str(p) for p in logs])

    return show_gap(case, out, retrain=retrain)


def named(told: Show, effect: str) -> Summary:
    name = Name(verdict="named", effects=[Effect(name=effect)])
    return StepArtefacts(name=name, show=told).summary


@pytest.mark.slow
def test_what_is_shown_stands_when_training_is_broken_off(answer, tmp_path) -> None:
    class BrokenOff(list):
        def extend(self, _) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shown(answer, (flown(42, TRUTH),), tmp_path, BrokenOff())
    told = json.loads((tmp_path / "show.json").read_text("utf-8"))
    assert told["retrain"] is None
    assert told["gap"]


@pytest.mark.slow
def test_a_sealed_flight_is_shown_and_scored_alone(answer, tmp_path) -> None:
    scored: list[Path] = []
    told = shown(answer, (flown(42, TRUTH),), tmp_path, scored)
    assert told.in_sample is False
    assert told.sealed == told.shown_on == ["flight 42"]
    assert scored == [Path("flight 42")]
    assert told.cross_validated is False
    ahead = told.gap["height 0.25 s ahead"]
    assert ahead.after < 0.5 * ahead.before
    assert ahead.closed > 0.8
    placebo = told.placebo
    gains = {one.name: one.gain_nats for one in answer.rounds[0].ranking}
    wrong = [one.name for one in wrong_effects(Found.of(answer).tried, (HIDDEN,))]
    assert wrong
    assert placebo.name == max(wrong, key=gains.__getitem__)
    assert placebo.found_gain_nats == told.log_density_gain_nats > 50.0
    assert placebo.helps == (placebo.gain_nats > 3.0)
    assert placebo.gain_nats < 0.3 * placebo.found_gain_nats
    words = account(named(told, HIDDEN))
    assert "On 1 flight that took no part" in words
    assert "errs by 0.100 N on 1 sealed flight" in words


@pytest.mark.slow
def test_every_map_is_shown_once_and_in_its_unit(answer, tmp_path) -> None:
    told = shown(answer, (flown(42, TRUTH),), tmp_path, [])
    maps = [(p.channel, p.coordinate, p.unit) for p in told.places]
    assert maps == [
        ("innovation", "height", "sd"),
        ("innovation", "height reference", "sd"),
        ("force", "height", "N"),
    ]
    for place in told.places:
        before, after = np.array(place.before), np.array(place.after)
        assert np.abs(after).max() < 0.7 * np.abs(before).max()
        reach = np.array(place.before_reach), np.array(place.after_reach)
        assert (reach[0] > 0.0).all()
        # What was hidden stands out of its interval somewhere, and with it in the model less.
        assert (np.abs(before) > reach[0]).any()
        assert np.median(np.abs(after) / reach[1]) < np.median(np.abs(before) / reach[0])


@pytest.mark.slow
def test_without_a_sealed_flight_each_is_left_out_and_it_says_so(answer, tmp_path) -> None:
    scored: list[Path] = []
    told = shown(answer, (), tmp_path, scored)
    assert told.in_sample is False
    assert told.cross_validated is True
    assert told.sealed == []
    seen = float((answer.fit.per_episode - answer.base.per_episode).sum())
    # Unseen, either model is less likely; which loses more depends on how far the base is bent,
    # its form included.
    assert 0.25 * seen < told.log_density_gain_nats < 2.0 * seen
    assert told.shown_on == ["flight 40", "flight 41"]
    assert [str(p) for p in scored] == told.retrain.scored_on == told.shown_on
    words = account(named(told, HIDDEN))
    assert "On each flight, with sizes fitted to the others" in words
    assert "too few flights to seal" in words
    assert "on the very flights that the effect was found in" in words


@pytest.mark.slow
def test_what_a_bent_calibration_had_hidden_is_told_and_was_hidden_by_it() -> None:
    """Before and after err alike; with the constant as the rig file has it, before errs more."""
    constant, effect = "thrust.sufferer.scale", "thrust-coefficient"
    truth = with_constants(RIG, {constant: 0.87})
    model, base = fitted_base(GantryModel(RIG, [flown(seed, truth) for seed in (44, 45)]))
    found = fit(model, (effect,), range(2), extended(base, model.free((effect,))))
    sealed = [flown(46, truth)]
    told = show(Found(model, model, base, found, ()), found, sealed, (), whiteness_limit=60.0)
    assert [one.name for one in told.hidden_by] == [constant]
    assert told.hidden_by[0].fitted == pytest.approx(0.87, abs=0.01)
    ahead = told.gap["height 0.25 s ahead"]
    assert ahead.after == pytest.approx(ahead.before, rel=0.02)
    unbent = base.theta.copy()
    unbent[base.names.index(constant)] = 1.0
    stated = GantryModel(RIG, sealed).forecasts(replace(base, theta=unbent), 0, (0.25,))
    errors_m = stated.measured_m[0] - stated.forecast_m[0]
    assert np.sqrt(np.nanmean(errors_m**2)) > 1.2 * ahead.before
    words = account(named(told, effect))
    assert f"Before, a calibration bent in {constant} (by 4" in words
    assert "had hidden what was found from this forecast; against such a calibration, the" in words


@pytest.mark.parametrize(
    ("after_mm", "nats", "words"),
    [
        (5.73, 74.6, "hardly shows; the likelihood of the same flights speaks for it by 74.6 nats"),
        (5.77, 1.9, "hardly shows; the likelihood of the same flights hardly speaks for it (1.9"),
        (5.90, -4.2, "hardly shows; the likelihood of the same flights does not speak for it (−4"),
        (5.40, 74.6, ""),
    ],
)
def test_where_the_error_hardly_shrinks_the_likelihood_is_told(after_mm, nats, words) -> None:
    channel = {"before": 5.78e-3, "after": 1e-3 * after_mm, "noise_floor": 5.77e-3, "unit": "m"}
    shrunk = {"gap": {"height 0.25 s ahead": channel | {"closed": None}}}
    told = account(summary(shrunk | {"verdict": "named", "log_density_gain_nats": nats}))
    assert words in told
    assert ("hardly shows" in told) is bool(words)
    assert "100 %" not in told  # of a gap that noise alone leaves nothing of


@pytest.mark.parametrize(
    ("verdict", "after", "noise"),
    [("unknown", 14.0, False), ("none", 14.0, True), ("unknown", 9.0, True)],
)
def test_a_line_per_channel_has_the_noise_where_it_is_known(verdict, after, noise) -> None:
    channel = {"before": 0.014, "after": 1e-3 * after, "noise_floor": 0.008, "unit": "m"}
    (line,) = channel_lines(summary({"verdict": verdict, "gap": {"height 0.25 s ahead": channel}}))
    change = "14.0 mm" if after == 14.0 else "14.0 mm → 9.0 mm"
    assert line == f"height 0.25 s ahead: {change}" + noise * " (noise 8.0 mm)"


def tried(names, used=10.0) -> list[Tried]:
    """Effects as the choice of a placebo looks at them, best first."""
    return [Tried(name, None, used) for name in names]


def test_wrong_effects_cannot_be_taken_for_what_was_found() -> None:
    for name in LIBRARY:
        wrong = [t.name for t in wrong_effects(tried(LIBRARY), (name,))]
        assert name not in wrong
        assert not set(LIBRARY[name].confused_with) & set(wrong)
        assert not [n for n in wrong if name in LIBRARY[n].confused_with]
        sizes = {len(LIBRARY[n].parameters) for n in wrong}
        assert sizes == {len(LIBRARY[name].parameters)}


def test_no_member_of_a_class_is_a_placebo() -> None:
    wrong = wrong_effects(tried(LIBRARY), ("stiction",), ("stiction", "lost-steps"))
    claimed = {"stiction", "lost-steps", "coulomb-friction", "crosswind-offset"}
    assert not claimed & {t.name for t in wrong}


def test_an_effect_that_was_fitted_to_nothing_is_a_placebo_only_where_all_are() -> None:
    names = ["range-bias", "stiction", "lost-steps"]
    some = [*tried(names[:2]), *tried(names[2:], used=0.0)]
    assert [t.name for t in wrong_effects(some, (HIDDEN,))] == names[:2]
    assert [t.name for t in wrong_effects(tried(names, used=0.0), (HIDDEN,))] == names
