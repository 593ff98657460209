"""`wakedeploy export` and `wakedeploy check` from the command line, over one trained session."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from made_packages import with_manifest

pytest.importorskip("torch")

from wakedeploy.cli import main
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.package import read_package

pytestmark = pytest.mark.whole

KEYS = {"ok", "arch", "trainable", "parity"}


def wakedeploy(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def a_set(steps: int) -> EpisodeSet:
    draw = np.random.default_rng(0)
    episodes = []
    for split in ("train", "validation", "test"):
        observation = np.cumsum(draw.normal(size=(steps, 2)), axis=0).astype(np.float32)
        force = np.tanh(0.1 * np.roll(observation[:, :1], 4, axis=0))
        episodes.append(Episode(split, observation, force))
    return EpisodeSet(
        domain="walk",
        rate_hz=20.0,
        observation=(Channel("dx_m", "m"), Channel("dz_m", "m")),
        force=(Channel("force_z_n", "N"),),
        window_s=0.5,
        loss_weights=(1.0,),
        split={episode.name: episode.name for episode in episodes},
        episodes=tuple(episodes),
        provenance={"filtered": {"dx_m": "low-pass, 5 Hz"}},
    )


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a set, a foreign dataset.json beside it, and two trained runs of one kind."""
    folder = tmp_path_factory.mktemp("session")
    a_set(1200).write(folder / "sets" / "walk")
    (folder / "another").mkdir()
    (folder / "another" / "dataset.json").write_text('{"columns": []}')
    done = wakedeploy(
        "train", "--data", folder / "sets" / "walk", "--arch", "agile-mlp", "--seeds", 2,
        "--epochs", 2, "--out", folder / "runs",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    return folder


@pytest.fixture(scope="module")
def exported(session: Path) -> Path:
    before = Path.cwd()
    os.chdir(session)
    try:
        done = wakedeploy("export", "--arch", "agile-mlp", "--json", "export.json")
    finally:
        os.chdir(before)
    assert done.exit_code == 0, done.output
    (session / "export.txt").write_text(done.output)
    return session / "agile-mlp.onnx"


def test_the_newest_run_and_its_own_set_are_found_and_named(exported: Path) -> None:
    text = (exported.parent / "export.txt").read_text()
    assert str(Path("runs/walk/agile-mlp/s1")) in text
    manifest = read_package(exported).manifest
    assert manifest.seed == 1
    assert manifest.domain == "walk"
    assert manifest.parity.steps == 3600  # the whole set, in whole episodes
    assert manifest.test is not None
    assert set(manifest.test.rmse) == {"force_z_n"}


def test_what_was_exported_is_told_as_json(exported: Path) -> None:
    result = json.loads((exported.parent / "export.json").read_text())
    manifest = read_package(exported).manifest
    assert set(result) == {"arch", "trainable", "frozen", "lead_s", "parity", "file"}
    assert (result["arch"], result["file"]) == ("agile-mlp", "agile-mlp.onnx")
    assert (result["trainable"], result["frozen"]) == (manifest.trainable, 0)
    assert result["lead_s"] == manifest.lead_s
    assert result["parity"]["max_rel"] == manifest.parity.max_rel <= result["parity"]["limit"]
    assert result["parity"]["steps"] == 3600


def test_a_sound_package_passes_and_says_so(exported: Path, tmp_path: Path) -> None:
    done = wakedeploy("check", exported, "--json", tmp_path / "check.json")
    assert done.exit_code == 0, done.output
    result = json.loads((tmp_path / "check.json").read_text())
    parity = read_package(exported).manifest.parity
    assert set(result) >= KEYS
    assert result["ok"]
    assert result["arch"] == "agile-mlp"
    assert result["trainable"] == read_package(exported).manifest.trainable
    assert result["parity"] == {
        "max_abs": parity.max_abs, "max_rel": parity.max_rel, "steps": parity.steps,
    }  # fmt: skip
    assert result["replay"]["steps"] == 512


def test_a_filter_of_the_set_is_told_to_who_steps_the_package(
    exported: Path, tmp_path: Path
) -> None:
    channels = read_package(exported).manifest.observation
    assert [channel.filtered for channel in channels] == ["low-pass, 5 Hz", ""]
    told = read_package(exported).manifest.model_dump(mode="json")["observation"]
    assert ["filtered" in channel for channel in told] == [True, False]
    checked = wakedeploy("check", exported).output
    assert "filter dx_m likewise" in checked
    assert "low-pass, 5 Hz" in checked
    assert "filter dz_m" not in checked
    if shutil.which("cc") is None:
        return
    done = wakedeploy("export", "--package", exported, "--c", tmp_path / "c")
    assert done.exit_code == 0, done.output
    header = (tmp_path / "c" / "agile_mlp.h").read_text()
    assert "filter these likewise before each step" in header
    assert "dx_m: low-pass, 5 Hz" in header
    assert "inputs were filtered: `dx_m`" in (tmp_path / "c" / "README.md").read_text()
    assert "filter dx_m likewise" in wakedeploy("check", tmp_path / "c").output


def test_the_check_runs_where_torch_and_onnx_are_missing(exported: Path, tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules.update(torch=None, onnx=None, onnxscript=None, numba=None);"
        "from wakedeploy.cli import main; main()"
    )
    command = [sys.executable, "-c", code, "check", str(exported)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_a_run_of_another_kind_is_refused(session: Path) -> None:
    run = session / "runs" / "walk" / "agile-mlp" / "s0"
    done = wakedeploy("export", "--arch", "gru", "--run", run, "--out", session / "gru.onnx")
    assert done.exit_code == 2
    assert "is a run of agile-mlp, not of gru" in done.stderr
    assert not (session / "gru.onnx").exists()


def test_another_set_than_the_runs_own_leaves_no_file(session: Path, tmp_path: Path) -> None:
    """What was seen in training is written into the package, and only its set tells."""
    a_set(1300).write(tmp_path / "other")
    run, out = session / "runs" / "walk" / "agile-mlp" / "s0", tmp_path / "m.onnx"
    arguments = ("--arch", "agile-mlp", "--run", run, "--data", tmp_path / "other", "--out", out)
    done = wakedeploy("export", *arguments)
    assert done.exit_code == 2
    assert "was trained on another set" in done.stderr
    assert "--data" in done.stderr
    assert not out.exists()


def test_a_package_says_which_forces_were_seen_in_training(session: Path, exported: Path) -> None:
    seen = [e.force for e in a_set(1200).part("train")]
    (force,) = read_package(exported).manifest.force
    assert (force.min, force.max) == (float(np.min(seen)), float(np.max(seen)))


def test_an_unusable_file_exits_2_and_overwrites_an_older_verdict(
    exported: Path, tmp_path: Path
) -> None:
    verdict, cut = tmp_path / "check.json", tmp_path / "cut.onnx"
    wakedeploy("check", exported, "--json", verdict)
    cut.write_bytes(exported.read_bytes()[:-400])
    done = wakedeploy("check", cut, "--json", verdict)
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1
    result = json.loads(verdict.read_text())
    assert result["ok"] is False
    assert set(result) >= KEYS


@pytest.mark.parametrize(
    ("change", "reason"),
    [({"steps": 512}, "over 512 steps"), ({"max_rel": 0.5}, "relative 5.0e-01")],
)
def test_a_package_whose_recorded_parity_is_too_weak_exits_1(
    exported: Path, tmp_path: Path, change: dict[str, float], reason: str
) -> None:
    parity = read_package(exported).manifest.parity.model_dump() | change
    (tmp_path / "weak.onnx").write_bytes(with_manifest(exported.read_bytes(), parity=parity))
    done = wakedeploy("check", tmp_path / "weak.onnx", "--json", tmp_path / "check.json")
    assert done.exit_code == 1
    assert reason in done.stderr
    assert json.loads((tmp_path / "check.json").read_text())["ok"] is False
