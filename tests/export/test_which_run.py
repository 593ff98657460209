"""Which run `wakedeploy export` takes, and where it finds the set that the run was trained on."""

import dataclasses
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from wakedeploy.cli import main
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.package import read_package


def wakedeploy(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def walk(seed: int = 0) -> EpisodeSet:
    rng = np.random.default_rng(seed)
    episodes = tuple(
        Episode(split, *rng.standard_normal((2, 1200, 1)).astype(np.float32))
        for split in ("train", "validation", "test")
    )
    return EpisodeSet(
        domain="walk", rate_hz=32.0, observation=(Channel("dx_m", "m"),),
        force=(Channel("force_z_n", "N"),), window_s=0.125, loss_weights=(1.0,),
        split={episode.name: episode.name for episode in episodes}, episodes=episodes,
    )  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def each_graph_is_made_once() -> Iterator[None]:
    """Two runs are exported a dozen times here: what their graphs look like is asked elsewhere."""
    pytest.importorskip("torch")
    from export import packaging

    made, ordinary = {}, packaging.graph_bytes

    def once(predictor, force):
        weights = [(n, w.numpy().tobytes()) for n, w in predictor.state_dict().items()]
        key = predictor.__class__, tuple(weights), repr(force)
        if key not in made:
            made[key] = ordinary(predictor, force)
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(packaging, "graph_bytes", once)
        yield


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trained")
    walk().write(folder / "set")
    for arch in ("history-mlp", "agile-mlp"):
        done = wakedeploy(
            "train", "--data", folder / "set", "--arch", arch, "--epochs", 1, "--no-pictures",
            "--out", folder / "runs",
        )  # fmt: skip
        assert done.exit_code == 0, done.output
    return folder


@pytest.fixture
def here(trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of one's own with both runs; their set lies elsewhere, where they know it."""
    shutil.copytree(trained / "runs", tmp_path / "runs")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_without_a_word_it_is_the_newest_run_of_all_and_says_so(here: Path) -> None:
    done = wakedeploy("export")
    assert done.exit_code == 0, done.output
    assert "Exporting runs/walk/agile-mlp/s0, the newest of 2 runs, finished" in done.stdout
    assert read_package(here / "agile-mlp.onnx").manifest.arch == "agile-mlp"


@pytest.mark.whole
def test_a_folder_with_a_single_run_says_enough(here: Path) -> None:
    for place in ("runs/walk/history-mlp", "runs/walk/history-mlp/s0"):
        done = wakedeploy("export", "--runs", place)
        assert done.exit_code == 0, done.output
        assert "Exporting runs/walk/history-mlp/s0, finished" in done.stdout
        assert (here / "history-mlp.onnx").exists()
        (here / "history-mlp.onnx").unlink()


def test_of_several_runs_one_has_to_be_picked(here: Path) -> None:
    done = wakedeploy("export", "--runs", "runs")
    assert done.exit_code == 2
    assert "runs holds 2 finished runs: walk/agile-mlp/s0, walk/history-mlp/s0; pick" in done.stderr
    assert not list(here.glob("*.onnx"))


@pytest.mark.parametrize(
    "picked",
    [["--arch", "History_MLP"], ["--run", "walk/history-mlp/s0"], ["--run", "walk/history-mlp"],
     ["--run", "runs/walk/history-mlp/s0"]],
)  # fmt: skip
def test_a_run_is_picked_by_architecture_or_by_name(here: Path, picked: list[str]) -> None:
    done = wakedeploy("export", "--runs", "runs", *picked)
    assert done.exit_code == 0, done.output
    assert "Exporting runs/walk/history-mlp/s0, finished" in done.stdout
    assert (here / "history-mlp.onnx").exists()


def test_many_runs_are_not_all_listed(here: Path) -> None:
    for seed in range(1, 15):
        shutil.copytree("runs/walk/agile-mlp/s0", f"runs/walk/agile-mlp/s{seed}")
    done = wakedeploy("export", "--runs", "runs")
    assert done.exit_code == 2
    assert done.stderr.count("agile-mlp/") + done.stderr.count("history-mlp/") == 12
    assert "and 4 more" in done.stderr


def test_where_there_is_no_run_it_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = wakedeploy("export")
    assert done.exit_code == 2
    assert "runs holds no finished run" in done.stderr
    done = wakedeploy("export", "--run", "runs/auv/gru/s9")
    assert done.exit_code == 2
    assert "runs/auv/gru/s9 is no run, neither here nor in runs" in done.stderr


@pytest.mark.whole
def test_a_set_that_has_moved_is_asked_for(
    trained: Path, here: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    away = tmp_path_factory.mktemp("away") / "set"
    (trained / "set").rename(away)
    try:
        done = wakedeploy("export")
        assert done.exit_code == 2
        assert f"lay in {trained / 'set'} and is no longer there" in done.stderr
        assert "--data FOLDER" in done.stderr
        assert wakedeploy("export", "--data", away).exit_code == 0
        shutil.copytree(away, here / "sets" / "copy")
        assert wakedeploy("export").exit_code == 0, "the same set lies near"
        shutil.rmtree(here / "sets")
        walk(seed=1).write(trained / "set")
        done = wakedeploy("export")
        assert done.exit_code == 2
        assert f"lay in {trained / 'set'} and has changed since" in done.stderr
    finally:
        shutil.rmtree(trained / "set", ignore_errors=True)
        away.rename(trained / "set")


def test_where_a_set_was_read_from_is_not_what_it_is(tmp_path: Path) -> None:
    made = walk()
    assert made.folder is None
    assert dataclasses.replace(made, folder=tmp_path).sha256 == made.sha256
