"""`wakedeploy train` and `evaluate` from the command line."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from wakedeploy.cli import main
from wakedeploy.core.episodes import OBSERVER, EpisodeSet

ROW = {"arch", "seed", "trainable", "frozen", "split", "rmse", "r2", "seconds", "device"}
ROW |= {"run", "lead_s", "hyper", "settings", "kept_from", "data_sha256", "episodes"}


def wakedeploy(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def folder(echo: EpisodeSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set, and two architectures with two seeds each trained on it."""
    folder = tmp_path_factory.mktemp("session")
    dataclasses.replace(echo, provenance={"default_lead_s": 0.05}).write(folder / "set")
    done = wakedeploy(
        "train", "--data", folder / "set", "--arch", "agile-mlp,history-mlp", "--seeds", 2,
        "--epochs", 3, "--out", folder / "runs", "--json", folder / "train.json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    (folder / "train.txt").write_text(done.output)
    return folder


def test_training_prints_one_table_and_writes_the_rows(folder: Path) -> None:
    rows = json.loads((folder / "train.json").read_text())["rows"]
    assert [(r["arch"], r["seed"]) for r in rows] == [
        ("agile-mlp", 0), ("agile-mlp", 1), ("history-mlp", 0), ("history-mlp", 1),
    ]  # fmt: skip
    assert all(set(row) == ROW and row["split"] == "test" for row in rows)
    assert all(set(row["rmse"]) == set(row["r2"]) == {"f_n"} for row in rows)
    text = (folder / "train.txt").read_text()
    assert "±" in text
    assert "0.05 s ahead" in text  # the set's own lead


def test_evaluating_the_test_split_repeats_what_training_found(folder: Path) -> None:
    done = wakedeploy(
        "evaluate", folder / "runs", "--data", folder / "set", "--json", folder / "eval.json"
    )
    assert done.exit_code == 0, done.output
    trained, evaluated = (
        json.loads((folder / name).read_text())["rows"] for name in ("train.json", "eval.json")
    )
    for before, after in zip(trained, evaluated, strict=True):
        assert before | {"seconds": 0.0} == after | {"seconds": 0.0}


def test_what_learned_nothing_stands_beside_what_did(folder: Path, echo: EpisodeSet) -> None:
    """Zero errs by the force's own size; an observer by what it tells now of the force then."""
    later, steps = round(0.05 * echo.rate_hz), echo.warm_up_steps

    def observing(episode):
        return dataclasses.replace(episode, extras={OBSERVER: 0.5 * episode.force})

    observed = dataclasses.replace(
        echo, provenance={"default_lead_s": 0.05}, episodes=tuple(map(observing, echo.episodes))
    )
    observed.write(folder / "observed")
    told = json.loads((folder / "train.json").read_text())["baselines"]
    names = ["zero", "training mean", "linear, one tick", "linear, window"]
    assert [row["predictor"] for row in told] == names
    assert all(name in (folder / "train.txt").read_text() for name in names)
    done = wakedeploy(
        "evaluate", folder / "runs", "--data", folder / "observed", "--json", folder / "both.json"
    )
    assert done.exit_code == 0, done.output
    assert "no-learning observer" in done.output
    # The runs have not seen this set, so that no baseline learns from it either.
    zero, observer = json.loads((folder / "both.json").read_text())["baselines"]
    then = [e.force[steps + later :, 0] for e in echo.part("test")]
    now = [0.5 * e.force[steps:-later, 0] for e in echo.part("test")]
    truth, seen = np.concatenate(then).astype(float), np.concatenate(now).astype(float)
    assert zero["rmse"]["f_n"] == pytest.approx(np.sqrt(np.mean(truth**2)), rel=1e-6)
    assert told[0]["rmse"] == pytest.approx(zero["rmse"])
    assert observer["rmse"]["f_n"] == pytest.approx(np.sqrt(np.mean((truth - seen) ** 2)), rel=1e-6)
    assert zero["lead_s"] == observer["lead_s"] == 0.05


def test_a_score_says_on_how_many_samples_it_rests(echo: EpisodeSet, tmp_path: Path) -> None:
    """Also where the set is described, before anything is trained on it."""
    short = tuple(
        dataclasses.replace(e, observation=e.observation[:13], force=e.force[:13])
        if echo.split[e.name] == "test" else e for e in echo.episodes
    )  # fmt: skip
    dataclasses.replace(echo, episodes=short).write(tmp_path / "set")
    asked = ("--data", tmp_path / "set", "--arch", "agile-mlp", "--epochs", 1)
    done = wakedeploy("train", *asked, "--out", tmp_path / "runs", "--no-pictures")
    scored = wakedeploy("evaluate", tmp_path / "runs", "--data", tmp_path / "set")
    shown = wakedeploy("data", "show", tmp_path / "set")
    for each in (done, scored, shown):
        assert each.exit_code == 0, each.output
        assert "Only 3 test samples are scored:" in " ".join(each.output.split())
        assert (each is shown) or "test episodes (3 samples)" in " ".join(each.output.split())
    enough = wakedeploy(
        "evaluate", tmp_path / "runs", "--data", tmp_path / "set", "--split", "train"
    )
    assert "Only" not in enough.output


def test_one_run_folder_and_every_split_can_be_evaluated(folder: Path) -> None:
    done = wakedeploy(
        "evaluate", folder / "runs/echo/agile-mlp/s1", "--data", folder / "set", "--split", "all",
        "--json", folder / "one.json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    (row,) = json.loads((folder / "one.json").read_text())["rows"]
    assert (row["arch"], row["seed"], row["split"]) == ("agile-mlp", 1, "all")


def test_evaluating_names_the_episodes_that_are_predicted_worst(
    folder: Path, echo: EpisodeSet
) -> None:
    loud = dataclasses.replace(echo.episodes[4], force=5 * echo.episodes[4].force)
    others = [episode for episode in echo.episodes if episode.name != loud.name]
    dataclasses.replace(echo, episodes=(*others, loud)).write(folder / "loud")
    done = wakedeploy(
        "evaluate", folder / "runs", "--data", folder / "loud", "--split", "all",
        "--json", folder / "loud.json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    told = done.output[done.output.index("errs most: 5 of 6 episodes") :]
    first = next(line for line in told.splitlines() if " e" in line and "episode" not in line)
    assert f" {loud.name} " in first
    rows = json.loads((folder / "loud.json").read_text())["rows"]
    assert [len(row["episodes"]) for row in rows] == [6, 6, 6, 6]
    assert set(rows[0]["episodes"][0]) == {"episode", "samples", "rmse", "relative"}


def test_runs_of_other_settings_are_not_averaged_as_seeds(folder: Path) -> None:
    other = folder / "several" / "wide"
    done = wakedeploy(
        "train", "--data", folder / "set", "--arch", "agile-mlp", "--hyper", "agile-mlp.hidden=9",
        "--epochs", 1, "--out", other,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    shutil.copytree(folder / "runs" / "echo" / "agile-mlp", folder / "several" / "usual")
    done = wakedeploy(
        "evaluate", folder / "several", "--data", folder / "set", "--json", folder / "both.json"
    )
    assert done.exit_code == 0, done.output
    told = " ".join(done.output.split())
    assert "hidden 9" in told
    assert "hidden 128" in told
    rows = json.loads((folder / "both.json").read_text())["rows"]
    assert sorted(Path(row["run"]).parts[-2:] for row in rows) == [
        ("agile-mlp", "s0"), ("usual", "s0"), ("usual", "s1"),
    ]  # fmt: skip


def test_what_was_finished_already_is_said(folder: Path) -> None:
    asked = ("train", "--data", folder / "set", "--arch", "agile-mlp", "--epochs", 1,
             "--out", folder / "twice", "--no-pictures")  # fmt: skip
    first, again, more = wakedeploy(*asked), wakedeploy(*asked), wakedeploy(*asked, "--seeds", 2)
    assert "finished already" not in first.output
    assert "Nothing was trained: the run was finished already" in again.output
    assert "1 of 2 runs were finished already" in more.output


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--arch", "mlp"], "choose all, agile-mlp"),
        (["--arch", "gru", "--hyper", "tcn.kernel=3"], "ARCH.NAME=VALUE for one of gru"),
        (["--arch", "gru", "--hyper", "gru.hidden=many"], "is not a number"),
        (["--arch", "gru", "--hyper", "gru.hidden=220"], "budget is fewer than 100,000"),
        (["--arch", "agile-mlp", "--epochs", "4"], "epochs = 3, not 4: the learning rate falls"),
        (["--arch", "agile-mlp", "--epochs", "3", "--learning-rate", "0.1"], "not 0.1; choose"),
    ],
)
def test_unusable_arguments_are_one_sentence_and_status_2(
    folder: Path, arguments: list[str], says: str
) -> None:
    done = wakedeploy("train", "--data", folder / "set", "--out", folder / "runs", *arguments)
    assert done.exit_code == 2
    assert says in " ".join(done.output.split())
    assert "unexpected" not in done.output


def test_runs_of_another_domain_are_refused_with_both_channel_lists(
    folder: Path, echo: EpisodeSet
) -> None:
    other = dataclasses.replace(echo, observation=tuple(reversed(echo.observation)))
    other.write(folder / "other")
    done = wakedeploy("evaluate", folder / "runs", "--data", folder / "other")
    assert done.exit_code == 2
    assert "u [N], idle [1], the set has idle [1], u [N]" in " ".join(done.output.split())


@pytest.mark.whole
def test_in_a_pipe_training_and_scoring_tell_how_far_they_are(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wakedeploy.cli.log_lines._SILENT_S", 0.0)
    done = wakedeploy(
        "train", "--data", folder / "set", "--arch", "agile-mlp,esn", "--epochs", 3,
        "--out", tmp_path / "runs",
    )  # fmt: skip
    assert "Training agile-mlp s0 (1 of 2): done in " in done.stderr
    assert "Training esn s0 (2 of 2): done in " in done.stderr
    done = wakedeploy("evaluate", tmp_path / "runs", "--data", folder / "set")
    assert "Reading the runs: done in " in done.stderr
    assert "Evaluating: done in " in done.stderr
