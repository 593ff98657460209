"""What is searched: declared beside each architecture, narrowed by hand, and reaching the model."""

import dataclasses

import optuna
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from small_study import plan_of

from trainers.bounds import check_settings, check_value
from trainers.build import ARCHITECTURES, build, hyper_parameters, unfilled
from trainers.dimensions import Choice, Span
from trainers.memory import Sizes
from trainers.training.fit import FitSettings
from trainers.training.runs import new_predictor
from trainers.training.trainer import new_fit, tapes
from trainers.tuning.space import (
    in_effect,
    legible,
    point_of,
    search_space,
    split,
    suggest,
    trained_point,
)
from trainers.tuning.trial import Objective
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import UnusableInput

# The paper's table, column "Optimized Hyperparameters", in this project's names.
PAPER = {
    "agile-mlp": {"layers", "hidden"},
    "history-mlp": {"snapshots", "hidden"},
    "delay-embedding": {"initial_delay_s", "initial_spread_s", "selector"},
    "gru": {"hidden", "dropout"},
    "tcn": {"blocks", "kernel", "dropout"},
    "mamba": {"d_model", "d_state", "d_conv"},
    "esn": {"neurons", "spectral_radius", "leak"},
    "cross-attention": {"embed", "heads"},
}
DESCENT = {"learning_rate", "weight_decay"}
BATCH_AND_HISTORY = {
    "none": {"batch"},
    "window": {"batch", "history_s"},
    "state": {"lanes", "chunk_steps"},
}
DOMAIN = {"inputs": 3, "outputs": 2, "window_s": 0.5, "rate_hz": 20.0}
SMALL_RESERVOIR = ("neurons=20:200",)
EACH = [(arch, d.name) for arch, known in ARCHITECTURES.items() for d in known.dimensions]


def space_of(arch: str) -> dict[str, Span | Choice]:
    asked = SMALL_RESERVOIR if arch == "esn" else ()
    return {dimension.name: dimension for dimension in search_space(arch, 0.5, 20.0, asked)}


def ends(dimension: Span | Choice) -> tuple[float, float]:
    if isinstance(dimension, Choice):
        return dimension.values[0], dimension.values[-1]
    return dimension.low, dimension.high


@pytest.mark.parametrize("arch", PAPER)
def test_the_papers_dimensions_and_those_of_the_fit_are_searched(arch: str) -> None:
    names = set(space_of(arch))
    assert names >= PAPER[arch]
    if arch == "esn":
        assert names - PAPER[arch] == {"input_scale"}
        return
    kind = build(arch, **DOMAIN).memory.kind
    assert names - PAPER[arch] == DESCENT | BATCH_AND_HISTORY[kind]


@pytest.mark.parametrize(("arch", "name"), EACH)
def test_both_ends_of_a_dimension_are_values_that_it_may_have(arch: str, name: str) -> None:
    usual = ARCHITECTURES[arch].hyper()
    for value in ends(space_of(arch)[name]):
        if hasattr(usual, name):
            check_value(arch, usual, name, value)
        else:
            check_settings(dataclasses.asdict(FitSettings()), {name: value})


def fingerprint(arch: str, name: str, value: float) -> object:
    """Everything of a built model that a hyper-parameter could have changed."""
    other = {"esn": {"neurons": 40}, "history-mlp": {"snapshots": 5}}.get(arch, {})
    if name == "snapshots":
        other = {}
    torch.manual_seed(0)
    values = hyper_parameters(arch, {**other, name: value})
    made = ARCHITECTURES[arch].core(Sizes(3, 2, 11, 1, 20.0), values)  # whatever the budget
    rates = [m.p for m in made.modules() if isinstance(m, torch.nn.Dropout)]
    tensors = {n: t.tolist() for n, t in [*made.named_parameters(), *made.named_buffers()]}
    return made.memory, tensors, rates, getattr(made, "heads", None), getattr(made, "leak", None)


@pytest.mark.parametrize(("arch", "name"), EACH)
def test_every_dimension_reaches_what_is_built_or_fitted(
    arch: str, name: str, echo: EpisodeSet
) -> None:
    low, high = ends(space_of(arch)[name])
    if name in {f.name for f in dataclasses.fields(ARCHITECTURES[arch].hyper)}:
        assert fingerprint(arch, name, low) != fingerprint(arch, name, high)
        return
    made = []
    for value in (low, high):
        config = plan_of(echo, arch, asked=(), epochs=1).configured(echo, {name: value})
        assert config.settings[name] == value
        fit = new_fit(config, new_predictor(config), *tapes(echo, 0.0))
        assert getattr(fit.settings, name) == value
        made.append(fit)
    if arch in ("agile-mlp", "gru"):  # one of each way to descend, since it takes a second
        assert made[0].run_epoch() != made[1].run_epoch()


@pytest.mark.parametrize("arch", ARCHITECTURES)
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 10_000), budget=st.sampled_from([500, 5_000, 30_000, 100_000]))
def test_any_point_is_built_within_the_budget_or_pruned_untrained(
    arch: str, echo: EpisodeSet, seed: int, budget: int
) -> None:
    built = []

    class Untrained(Objective):
        def _trained(self, trial, config, predictor) -> float:
            built.append(predictor.trainable)
            return 1.0

    asked = SMALL_RESERVOIR if arch == "esn" else ()
    objective = Untrained(plan_of(echo, arch, asked=asked, budget=budget), echo)
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=seed))
    study.optimize(objective, n_trials=1)
    (trial,) = study.trials
    count = trial.user_attrs["parameters"]
    if trial.state == optuna.trial.TrialState.COMPLETE:
        assert built == [count]
        assert count < budget
    else:
        assert trial.state == optuna.trial.TrialState.PRUNED
        assert built == []
        assert count >= budget
        assert f"{count:,}" in trial.user_attrs["reason"]


@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_weights_are_counted_as_they_are_built(arch: str) -> None:
    hyper = {"neurons": 50} if arch == "esn" else {}
    assert (
        unfilled(arch, **DOMAIN, hyper=hyper).trainable
        == build(arch, **DOMAIN, hyper=hyper).trainable
    )


@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_the_papers_shape_is_a_point_of_the_space(arch: str) -> None:
    space = search_space(arch, 0.5, 62.5)
    usual = dataclasses.asdict(FitSettings())
    point = point_of(arch, space, 0.5, 62.5, usual)
    assert set(point) == {dimension.name for dimension in space}
    study = optuna.create_study()
    study.enqueue_trial(point)
    assert suggest(study.ask(), space) == pytest.approx(point)
    fixed = search_space(
        arch, 0.5, 62.5, (f"{space[0].name}={ends(space_of(arch)[space[0].name])[0]}",)
    )
    with pytest.raises(UnusableInput, match=f"{space[0].name} = .* is not within"):
        point_of(arch, fixed, 0.5, 62.5, usual)


@pytest.mark.parametrize("arch", ARCHITECTURES)
@pytest.mark.parametrize(
    ("window_s", "rate_hz"), [(0.75, 100.0), (0.5, 200.0), (30.0, 2.0), (1 / 3, 30.0)]
)
def test_the_papers_shape_is_what_training_without_a_preset_builds(
    arch: str, window_s: float, rate_hz: float
) -> None:
    space = search_space(arch, window_s, rate_hz)
    point = point_of(arch, space, window_s, rate_hz, dataclasses.asdict(FitSettings()))
    hyper, _ = split(arch, point)
    sizes = {"inputs": 5, "outputs": 1, "window_s": window_s, "rate_hz": rate_hz}
    asked, plain = build(arch, **sizes, hyper=hyper), build(arch, **sizes)
    assert asked.memory == plain.memory
    for name, weights in plain.state_dict().items():
        torch.testing.assert_close(asked.state_dict()[name], weights)


def test_a_delay_begins_within_the_history_that_was_drawn_with_it() -> None:
    point = {"initial_delay_s": 0.4, "history_s": 0.15, "batch": 64}
    assert split("delay-embedding", point) == (
        {"initial_delay_s": 0.15, "history_s": 0.15}, {"batch": 64}
    )  # fmt: skip
    assert split("delay-embedding", point | {"history_s": 0.6})[0]["initial_delay_s"] == 0.4
    assert split("delay-embedding", {"initial_delay_s": 0.4})[0] == {"initial_delay_s": 0.4}


def test_what_is_drawn_has_as_many_digits_as_people_read_and_what_is_fixed_stays() -> None:
    space = search_space("delay-embedding", 0.5, 20.0, ("learning_rate=0.0123456",))
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=3))
    point = suggest(study.ask(), space)
    assert point["learning_rate"] == 0.0123456
    assert point["history_s"] == round(point["history_s"], 6)
    assert point["weight_decay"] == float(f"{point['weight_decay']:.4g}")
    assert point["weight_decay"] != study.trials[0].params["weight_decay"]
    study.tell(0, 1.0)
    hyper, settings = split(
        "delay-embedding", {k: v for k, v in point.items() if k in study.trials[0].params}
    )
    assert trained_point("delay-embedding", study.trials[0]) == {**hyper, **settings}


@pytest.mark.parametrize("arch", ["history-mlp", "delay-embedding", "cross-attention"])
@given(samples=st.integers(2, 60), rate_hz=st.sampled_from([30.0, 32.0, 62.5, 100.0, 200.0]))
def test_seconds_to_a_microsecond_are_as_many_samples_as_they_were(
    arch: str, samples: int, rate_hz: float
) -> None:
    sizes = Sizes(3, 2, 17, 1, rate_hz)
    exact, told = samples / rate_hz, legible("history_s", samples / rate_hz)
    snapshots = samples + 1 if arch == "history-mlp" else None
    assert sizes.looking_back(told, snapshots) == sizes.looking_back(exact, snapshots)
    assert sizes.looking_back(told, samples + 1).k == samples + 1


@pytest.mark.parametrize("arch", ["history-mlp", "delay-embedding", "cross-attention"])
@pytest.mark.parametrize("history_s", [0.3, 1.0])
def test_a_shape_that_says_only_its_history_is_what_is_built_of_it(
    arch: str, history_s: float
) -> None:
    sizes = {"inputs": 5, "outputs": 1, "window_s": 0.5, "rate_hz": 20.0}
    usual = dataclasses.asdict(FitSettings()) | {"history_s": history_s}
    hyper, _ = split(arch, point_of(arch, search_space(arch, 0.5, 20.0), 0.5, 20.0, usual))
    asked = build(arch, **sizes, hyper=hyper)
    plain = build(arch, **sizes, hyper={"history_s": history_s})
    assert asked.memory == plain.memory
    for name, weights in plain.state_dict().items():
        torch.testing.assert_close(asked.state_dict()[name], weights)


@pytest.mark.parametrize(
    ("window_s", "rate_hz", "most"), [(0.5, 30.0, 31), (0.5, 20.0, 21), (0.75, 100.0, 48)]
)
def test_no_more_snapshots_are_searched_than_the_longest_history_has(
    window_s: float, rate_hz: float, most: int
) -> None:
    (snapshots,) = [
        d for d in search_space("history-mlp", window_s, rate_hz) if d.name == "snapshots"
    ]
    assert isinstance(snapshots, Span)
    assert (snapshots.low, snapshots.high, snapshots.whole) == (4, most, True)
    sizes = {"inputs": 5, "outputs": 1, "window_s": window_s, "rate_hz": rate_hz}
    hyper = {"history_s": 2 * window_s, "snapshots": most}
    k = build("history-mlp", **sizes, hyper=hyper).memory.k
    assert k == most if most < 48 else k <= most


@pytest.mark.parametrize(
    ("asked", "drawn"),
    [
        ("hidden=16:18", {16, 17, 18}),
        ("hidden=8,32", {8, 32}),
        ("hidden=24", {24}),
        ("dropout=0", {0.0}),
    ],
)
def test_dimensions_can_be_narrowed_and_fixed(asked: str, drawn: set[float]) -> None:
    space = search_space("gru", 0.5, 20.0, (asked,))
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=1))
    name = asked.split("=")[0]
    points = [suggest(study.ask(), space) for _ in range(20)]
    assert {point[name] for point in points} == drawn
    assert (name in study.trials[0].params) == (len(drawn) > 1)
    assert all(type(point["hidden"]) is int and type(point["dropout"]) is float for point in points)


@pytest.mark.parametrize(
    ("arch", "asked", "says"),
    [
        ("gru", "hiden=3", "gru has no dimension 'hiden'; it has hidden, dropout, learning_rate"),
        ("gru", "projection=3", "no dimension 'projection'"),
        ("gru", "hidden", r"write hidden=LOW:HIGH, or hidden=VALUE"),
        ("gru", "hidden=", "'' is not a number"),
        ("gru", "hidden=many", "'many' is not a number"),
        ("gru", "hidden=null", "'null' is not a number"),
        ("gru", "hidden=8:4", "lower bound has to be below"),
        ("gru", "hidden=2.5:8", "hidden = 2.5 has to be a whole number from 1 to"),
        ("gru", "hidden=0:8", "hidden = 0 has to be"),
        ("gru", "hidden=[1]", "has to be a whole number"),
        ("gru", "dropout=0:1", "dropout = 1 has to be a number from 0 to 0.9"),
        ("gru", "learning_rate=0:1", "learning_rate = 0 has to be a number from 1e-07 to 1"),
        ("gru", "lanes=true", "lanes = True has to be a whole number"),
        ("gru", "dropout=NaN:0.5", "dropout = nan has to be"),
        ("cross-attention", "embed=9:40", "embed goes up in steps of 8; begin at a multiple of it"),
        ("mlp", "hidden=3", "There is no architecture 'mlp'; choose agile-mlp, history-mlp"),
    ],
)
def test_what_cannot_be_searched_is_told(arch: str, asked: str, says: str) -> None:
    with pytest.raises(UnusableInput, match=says) as told:
        search_space(arch, 0.5, 20.0, (asked,))
    assert "\n" not in str(told.value)


@given(
    history_s=st.floats(0.05, 5.0),
    snapshots=st.integers(2, 60),
    rate_hz=st.floats(5.0, 300.0),
)
def test_snapshots_are_as_many_as_asked_at_most_and_span_the_history(
    history_s: float, snapshots: int, rate_hz: float
) -> None:
    assume(history_s * rate_hz >= 1.0)
    sizes = Sizes(3, 2, 17, 1, rate_hz).looking_back(history_s, snapshots)
    assert 2 <= sizes.k <= snapshots
    reach = (sizes.k - 1) * sizes.stride
    assert reach <= history_s * rate_hz + 1e-3 < reach + sizes.stride + 1


@given(
    history_s=st.floats(0.05, 5.0),
    snapshots=st.integers(2, 60),
    rate_hz=st.floats(5.0, 300.0),
)
def test_a_point_in_effect_builds_the_same_and_says_how_many_snapshots(
    history_s: float, snapshots: int, rate_hz: float
) -> None:
    assume(history_s * rate_hz >= 1.0)
    asked = {"history_s": legible("history_s", history_s), "snapshots": snapshots, "batch": 64}
    told = in_effect("history-mlp", asked, rate_hz)
    sizes = Sizes(3, 2, 17, 1, rate_hz)
    built = sizes.looking_back(asked["history_s"], snapshots)
    assert told["snapshots"] == built.k
    assert told["history_s"] == pytest.approx(built.window_memory.reach / rate_hz, abs=1e-6)
    assert sizes.looking_back(told["history_s"], told["snapshots"]) == built
    assert in_effect("history-mlp", told, rate_hz) == told
    for unusable in ({"snapshots": 1}, {"history_s": 0.0}):  # as a journal may have it
        assert in_effect("history-mlp", asked | unusable, rate_hz) == asked | unusable


@pytest.mark.parametrize("arch", ["history-mlp", "delay-embedding", "cross-attention"])
def test_a_history_of_less_than_a_sample_is_refused_and_not_searched(arch: str) -> None:
    with pytest.raises(UnusableInput, match=r"history_s = 0.013 is shorter than the 0.02 s from"):
        build(arch, **DOMAIN | {"rate_hz": 50.0}, hyper={"history_s": 0.013})
    (history,) = [d for d in search_space(arch, 0.05, 20.0) if d.name == "history_s"]
    assert history.low == 0.05  # a quarter of the window would be 0.25 samples


def test_without_a_word_the_window_stays_the_domains() -> None:
    sizes = Sizes(3, 2, 17, 1, 32.0)
    assert sizes.looking_back(None) == sizes
    assert sizes.looking_back(None, 9).k == 9
    assert sizes.looking_back(1.0).k == 33
