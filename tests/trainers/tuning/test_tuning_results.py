"""What a study leaves: the best as a preset and a run, every trial as a line, figures."""

import csv
import tomllib
from pathlib import Path

import numpy as np
import optuna
import pytest
from optuna.distributions import FloatDistribution, IntDistribution
from optuna.trial import TrialState
from small_study import TINY, cheap_when_small, work_of

from trainers.preset import read_preset
from trainers.training.fit import FitSettings
from trainers.training.trainer import configure, settings_for, train
from trainers.tuning.conclude import conclude
from trainers.tuning.figure import history
from trainers.tuning.report import Row, _ranked, best_of, front_of, importances, rows_of
from trainers.tuning.storage import JOURNAL
from trainers.tuning.trial import Objective
from trainers.tuning.workers import run_trials
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import CheckFailed


@pytest.mark.slow
def test_the_best_is_kept_as_a_preset_that_trains_to_the_same_error(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    work = work_of(echo, tmp_path / "out", "gru", 8, asked=(*TINY["gru"], "dropout=0.25"))
    study = work.begin()
    run_trials(work, study, echo)
    found = conclude(work, study, echo)
    assert found.best == best_of(rows_of(study))
    preset = read_preset(work.out / "best.toml")
    config = configure(
        echo, "gru", seed=0, lead_s=0.0, hyper=preset.hyper,
        settings=settings_for("gru", others=preset.settings),
    )  # fmt: skip
    run = train(config, echo, tmp_path / "again")
    assert min(run.metrics.history) ** 0.5 == found.best.error
    assert run.metrics.weights_sha256 == found.run.metrics.weights_sha256
    assert preset.hyper["dropout"] == 0.25
    told = tomllib.loads((work.out / "best.toml").read_text())["study"]
    assert told["data_sha256"] == echo.sha256
    assert (told["trials"], told["budget"], told["seed"]) == (8, 100_000, 0)
    assert told["validation_error"] == found.best.error
    assert told["kept_in"] == JOURNAL
    assert str(tmp_path) not in (work.out / "best.toml").read_text()


@pytest.mark.whole
def test_every_trial_is_a_line_and_every_figure_a_picture(echo: EpisodeSet, tmp_path: Path) -> None:
    work = work_of(echo, tmp_path / "out", trials=18, asked=("hidden=4:16", "layers=1"))
    study = work.begin()
    run_trials(work, study, echo)
    found = conclude(work, study, echo)
    with (work.out / "trials.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [int(line["number"]) for line in lines] == list(range(18))
    assert {line["layers"] for line in lines} == {"1"}
    assert all(line["error"] for line in lines if line["state"] == "finished")
    for name in ("history", "importances"):
        assert (work.out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (work.out / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    for name in ("curves", "prediction"):
        assert (found.run.folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert sum(found.importances.values()) == pytest.approx(1)
    assert set(found.importances) == set(study.trials[0].params)


def trial(number: int, state: str, error: float | None = None, last: float | None = None) -> Row:
    return Row(number, state, "", error, last, None, 9, 9, 1.0, "cpu", "", False, number == 0, {})


def test_a_trial_tells_the_window_that_it_was_trained_with_and_none_is_trained_twice(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A history of 0.5 s at 20 Hz has 11 snapshots, however many more are asked for."""
    asked = ("snapshots=18,30,41", "hidden=8", "history_s=0.5", "learning_rate=0.01",
             "weight_decay=0.001", "batch=128")  # fmt: skip
    count, trained = [], Objective._trained
    monkeypatch.setattr(
        Objective, "_trained", lambda self, *others: count.append(0) or trained(self, *others)
    )
    work = work_of(echo, tmp_path / "out", "history-mlp", 6, asked=asked)
    study = work.begin()
    run_trials(work, study, echo)
    found = conclude(work, study, echo)
    assert {row.point["snapshots"] for row in found.rows} == {11}
    assert len({row.error for row in found.rows}) == len(count) == 1
    assert found.rows[1].reason == "is trial 0 once more, and not trained again"
    assert found.run.config.hyper["snapshots"] == found.run.predictor.memory.k == 11
    assert read_preset(work.out / "best.toml").hyper["snapshots"] == 11
    with (work.out / "trials.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert {(line["snapshots"], line["history_s"]) for line in lines} == {("11", "0.5")}


def test_the_history_shows_every_trial_by_what_became_of_it() -> None:
    states = ["over budget", "impossible", "failed", "lost", "interrupted", "running"]
    rows = [
        trial(0, "finished", 0.6), trial(1, "pruned", last=0.9), trial(2, "finished", 0.5),
        *(trial(3 + at, state) for at, state in enumerate(states)), trial(9, "pruned", last=2.0),
    ]  # fmt: skip
    (axes,) = history("a study", rows).axes
    shown = {line.get_label(): line for line in axes.lines}
    assert list(shown["finished (2)"].get_ydata()) == [0.6, 0.5]
    assert list(shown["pruned (2)"].get_xdata()) == [1, 9]
    assert list(shown["pruned (2)"].get_ydata()) == [0.9, 2.0]
    assert list(shown["best so far"].get_ydata()) == [0.6, 0.5, 0.5]
    assert list(shown["best so far"].get_xdata()) == [0, 2, 9]  # as far as the trials go
    marked = {name.removesuffix(" (1)"): line for name, line in shown.items() if "(1)" in name}
    assert list(marked) == states
    assert [line.get_xdata()[0] for line in marked.values()] == [3, 4, 5, 6, 7, 8]
    looks = [(line.get_marker(), line.get_markerfacecolor()) for line in shown.values()]
    assert len({look for look in looks if look[0] != "None"}) == 8


@pytest.mark.parametrize("count", [1, 2, 3, 7, 40, 1000])
def test_the_trials_of_the_history_are_counted_in_whole_numbers(count: int) -> None:
    (axes,) = history("a study", [trial(n, "finished", 0.5 + n) for n in range(count)]).axes
    low, high = axes.get_xlim()
    ticks = [tick for tick in axes.get_xticks() if low <= tick <= high]
    assert ticks
    assert all(tick == round(tick) for tick in ticks)
    assert low < 0
    assert high > count - 1


def test_a_pruned_trial_is_drawn_where_it_was_ended(echo: EpisodeSet, tmp_path: Path) -> None:
    work = work_of(echo, tmp_path / "out", trials=18, asked=("hidden=4:16", "layers=1"))
    study = work.begin()
    run_trials(work, study, echo)
    for row, told in zip(rows_of(study), study.trials, strict=True):
        ended_early = told.state == TrialState.PRUNED
        assert (row.last_error is not None) == ended_early
        if ended_early:
            assert row.last_error == list(told.intermediate_values.values())[-1]
    assert any(row.last_error for row in rows_of(study))


def test_what_was_ended_early_counts_in_the_importances_behind_the_others() -> None:
    """Of 20 trials the five small ones came to their end, with more error than the others had."""
    spans = {"size": IntDistribution(1, 100), "idle": FloatDistribution(0.0, 1.0)}
    draw = np.random.default_rng(0)
    study = optuna.create_study()
    for number in range(20):
        params = {"size": 1 + number if number < 5 else 30 + number, "idle": draw.uniform()}
        told = {"value": 0.5} if number < 5 else {"state": TrialState.PRUNED}
        early = {1: 0.4} if number >= 5 else {}  # less than those that came to their end
        study.add_trial(
            optuna.trial.create_trial(
                params=params, distributions=spans, intermediate_values=early, **told
            )
        )
    shares = importances(study)
    assert shares["size"] > 0.9
    fewer = optuna.create_study()
    fewer.add_trials(study.trials[:14])
    assert importances(fewer) == {}
    far = optuna.trial.create_trial(
        params={"size": 99, "idle": 0.5}, distributions=spans, state=TrialState.PRUNED,
        intermediate_values={1: 0.4, 7: 0.9},
    )  # fmt: skip
    order = _ranked([*study.trials, far])
    places = sorted(order, key=lambda trial: trial.value or 0.0)
    assert [trial.params["size"] for trial in places[:6]] == [1, 2, 3, 4, 5, 99]
    assert len(order) == 21


def test_a_preset_says_what_was_searched_and_only_what_is_of_use(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    for arch, idle in (
        ("agile-mlp", {"lanes", "chunk_steps"}),
        ("gru", {"batch"}),
        ("esn", set(FitSettings.__dataclass_fields__)),
    ):
        work = work_of(echo, tmp_path / arch, arch, trials=1)
        study = work.begin()
        run_trials(work, study, echo)
        conclude(work, study, echo)
        preset = read_preset(work.out / "best.toml")
        assert set(preset.settings) == set(FitSettings.__dataclass_fields__) - idle
        assert preset.study["pruner"] == ("none" if arch == "esn" else "median")
        assert preset.study["dimensions"] == [str(d) for d in work.plan.dimensions]


def test_the_best_says_what_pruned_the_trials_and_not_what_the_last_command_asked_for(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    for trials, pruner, told in (
        (2, "hyperband", "hyperband"),
        (2, "none", "hyperband"),
        (3, "none", "hyperband, none"),
    ):
        work = work_of(echo, tmp_path / "out", trials=trials, pruner=pruner)
        study = work.begin()
        run_trials(work, study, echo)
        conclude(work, study, echo)
        assert read_preset(work.out / "best.toml").study["pruner"] == told


def test_the_best_says_what_the_papers_shape_reached(echo: EpisodeSet, tmp_path: Path) -> None:
    work = work_of(echo, tmp_path / "out", trials=2, asked=("hidden=100:128", "layers=2"))
    study = work.begin()
    run_trials(work, study, echo)
    conclude(work, study, echo)
    (own,) = [row for row in rows_of(study) if row.reference]
    assert own.point["hidden"] == 128
    assert read_preset(work.out / "best.toml").study["reference_error"] == own.error


def test_without_any_finished_trial_the_reasons_are_kept(echo: EpisodeSet, tmp_path: Path) -> None:
    work = work_of(echo, tmp_path / "out", trials=2, budget=10)
    study = work.begin()
    run_trials(work, study, echo)
    with pytest.raises(CheckFailed, match=r"No trial came to its end \(2 over budget\)"):
        conclude(work, study, echo)
    assert "budget fewer than 10" in (work.out / "trials.csv").read_text()
    assert not (work.out / "best.toml").exists()


@pytest.mark.whole
def test_of_two_objectives_the_front_is_what_none_beats(echo: EpisodeSet, tmp_path: Path) -> None:
    work = work_of(
        echo, tmp_path / "out", "history-mlp", 8, objective=("rmse", "latency"),
        step_cost=cheap_when_small, asked=("hidden=4:24", "snapshots=4:12"),
    )  # fmt: skip
    study = work.begin()
    run_trials(work, study, echo)
    found = conclude(work, study, echo)
    front = front_of(found.rows)
    assert found.front == front
    assert {row.number for row in front} == {t.number for t in study.best_trials}
    errors, costs = [r.error for r in front], [r.cost for r in front]
    assert errors == sorted(errors)
    assert costs == sorted(costs, reverse=True)
    assert {p.name for p in (work.out / "pareto").iterdir()} == {
        f"trial-{row.number:04d}.toml" for row in front
    }
    assert (
        read_preset(work.out / "pareto" / f"trial-{front[-1].number:04d}.toml").arch
        == "history-mlp"
    )
    assert (work.out / "pareto.png").exists()
    assert (work.out / "pareto.pdf").exists()
