"""What a study leaves: the best as a preset and a run, every trial as a line, figures."""

import csv
import tomllib
from pathlib import Path

import pytest
from small_study import TINY, cheap_when_small, work_of

from trainers.preset import read_preset
from trainers.training import configure, settings_for, train
from trainers.tuning.conclude import conclude
from trainers.tuning.report import best_of, front_of, rows_of
from trainers.tuning.storage import JOURNAL
from trainers.tuning.workers import run_trials
from wakedeploy.episodes import EpisodeSet
from wakedeploy.errors import CheckFailed


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


def test_every_trial_is_a_line_and_every_figure_a_picture(echo: EpisodeSet, tmp_path: Path) -> None:
    work = work_of(echo, tmp_path / "out", trials=9, asked=("hidden=4:16", "layers=1"))
    study = work.begin()
    run_trials(work, study, echo)
    found = conclude(work, study, echo)
    with (work.out / "trials.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [int(line["number"]) for line in lines] == list(range(9))
    assert {line["layers"] for line in lines} == {"1"}
    assert all(line["error"] for line in lines if line["state"] == "finished")
    for name in ("history", "importances"):
        assert (work.out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (work.out / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    assert sum(found.importances.values()) == pytest.approx(1)
    assert set(found.importances) == set(study.trials[0].params)


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
    errors, costs = [r.error for r in front], [r.step_us for r in front]
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
