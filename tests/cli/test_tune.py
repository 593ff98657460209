"""`wakedeploy tune` and `train --preset`: what they say and leave."""

import dataclasses
import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from small_tune import FAST, LIMIT_S, one_line, small_set, tune, wakedeploy

from trainers.build import ARCHITECTURES
from wakedeploy.core.episodes import read_episode_set


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tune") / "set"
    small_set().write(folder)
    return folder


@pytest.fixture(scope="module")
def done(data: Path) -> Path:
    """A finished study of five trials, with what it printed."""
    out = data.parent / "done"
    ended = tune(data, out, "--trials", 5, "--epochs", 2, *FAST, "--json", out.with_suffix(".json"))
    assert ended.exit_code == 0, ended.output
    out.with_suffix(".txt").write_text(ended.output)
    return out


# --- what it says and leaves --------------------------------------------------------------------


def test_tuning_prints_the_best_and_writes_the_rows(done: Path) -> None:
    told = json.loads(done.with_suffix(".json").read_text())
    text = done.with_suffix(".txt").read_text()
    assert (told["study"], told["storage"]) == ("echo-gru", str(done / "study.journal"))
    assert sum(told["trials"].values()) == len(told["rows"]) == 5
    best = min((r for r in told["rows"] if r["state"] == "finished"), key=lambda r: r["error"])
    assert told["best"] == best
    assert told["hyper"]["hidden"] == best["point"]["hidden"]
    assert set(told["test"]["rmse"]) == {"f_n"}
    assert f"{best['error']:.4g}" in text
    assert f"Test RMSE of trial {best['number']}" in " ".join(text.split())
    left = {path.name for path in done.iterdir() if not path.name.startswith(".")}
    assert left == {"study.journal", "best.toml", "trials.csv", "best",
                    "history.png", "history.pdf"}  # fmt: skip


def test_the_shortest_command_makes_a_folder_of_its_own(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rigs = dataclasses.replace(read_episode_set(data), provenance={"default_lead_s": 0.05})
    rigs.write(tmp_path / "set")
    asked = ("--arch", "agile-mlp", "--data", tmp_path / "set", "--trials", 1, "--epochs", 1)
    ended = wakedeploy("tune", *asked)
    assert ended.exit_code == 0, ended.output
    found = tomllib.loads((tmp_path / "tuned" / "echo-agile-mlp" / "best.toml").read_text())
    assert found["study"]["lead_s"] == 0.05


def test_the_best_trains_as_a_preset(done: Path, data: Path, tmp_path: Path) -> None:
    asked = ("--data", data, "--preset", done / "best.toml", "--json", tmp_path / "t.json")
    ended = wakedeploy("train", *asked, "--out", tmp_path / "runs")
    assert ended.exit_code == 0, ended.output
    written = json.loads((tmp_path / "t.json").read_text())
    (row,) = written["rows"]
    preset = tomllib.loads((done / "best.toml").read_text())
    assert written["data_sha256"] == preset["study"]["data_sha256"]
    assert (written["preset"], written["lead_s"]) == (str(done / "best.toml"), 0.0)
    assert "another set" not in ended.output
    told = json.loads(done.with_suffix(".json").read_text())
    assert row["arch"] == "gru"
    assert row["rmse"] == told["test"]["rmse"]
    changed = wakedeploy(
        "train", *asked, "--out", tmp_path / "other", "--hyper", "gru.hidden=5", "--epochs", 1
    )
    assert changed.exit_code == 0, changed.output
    config = json.loads((tmp_path / "other/echo/gru/s0/config.json").read_text())
    assert (config["hyper"]["hidden"], config["settings"]["epochs"]) == (5, 1)
    assert config["settings"]["lanes"] == told["settings"]["lanes"]


def test_a_preset_of_another_set_is_told(done: Path, data: Path, tmp_path: Path) -> None:
    preset = (done / "best.toml").read_text()
    sha256 = tomllib.loads(preset)["study"]["data_sha256"]
    (tmp_path / "p.toml").write_text(preset.replace(sha256, "0" * 64))
    asked = ("--data", data, "--preset", tmp_path / "p.toml", "--epochs", 1)
    ended = wakedeploy("train", *asked, "--out", tmp_path / "runs")
    assert ended.exit_code == 0, ended.output
    assert "The preset of gru was found on another set" in one_line(ended)


def test_more_trials_add_to_the_study_and_the_best_follows(data: Path, tmp_path: Path) -> None:
    out, asked = tmp_path / "out", ("--epochs", 2, *FAST)
    for trials in (2, 6):
        ended = tune(data, out, "--trials", trials, *asked, "--json", tmp_path / "told.json")
        assert ended.exit_code == 0, ended.output
        told = json.loads((tmp_path / "told.json").read_text())
        assert len(told["rows"]) == trials
        best = min((r for r in told["rows"] if r["error"] is not None), key=lambda r: r["error"])
        preset = tomllib.loads((out / "best.toml").read_text())
        assert preset["study"]["trial"] == told["best"]["number"] == best["number"]
        config = json.loads((out / "best/echo/gru/s0/config.json").read_text())
        assert config["hyper"]["hidden"] == preset["hyper"]["hidden"] == best["point"]["hidden"]


def test_as_many_trials_as_there_are_add_nothing(done: Path, data: Path) -> None:
    before = (done / "study.journal").read_bytes()
    again = tune(data, done, "--trials", 5, "--epochs", 2, *FAST)
    assert again.exit_code == 0, again.output
    assert (done / "study.journal").read_bytes() == before


def test_a_study_begins_where_it_is_told_to_and_a_preset_can_be_added(
    data: Path, tmp_path: Path
) -> None:
    preset = tmp_path / "p.toml"
    preset.write_text(PRESET + "learning_rate = 0.0123\n")
    wide = (
        "--epochs",
        1,
        "--dimension",
        "hidden=4:128",
        "--seed",
        0,
        "--json",
        tmp_path / "t.json",
    )
    asked = (*wide, "--start", preset)
    ended = tune(data, tmp_path / "out", "--trials", 2, *asked)
    assert ended.exit_code == 0, ended.output
    paper, begun = json.loads((tmp_path / "t.json").read_text())["rows"]
    assert (paper["reference"], paper["point"]["hidden"]) == (True, 128)
    assert (begun["point"]["hidden"], begun["point"]["learning_rate"]) == (8, 0.0123)
    assert begun["point"]["lanes"] == paper["point"]["lanes"]  # what it does not say
    assert tune(data, tmp_path / "out", "--trials", 2, *asked).exit_code == 0  # it is there
    preset.write_text(PRESET.replace("hidden = 8", "hidden = 9"))
    full = tune(data, tmp_path / "out", "--trials", 2, *asked)
    assert full.exit_code == 2
    says = (
        "--start: there is no trial left for 1 of 1 points to begin at; ask for --trials 3 or more."
    )
    assert says in one_line(full)
    assert tune(data, tmp_path / "out", "--trials", 3, *asked).exit_code == 0
    rows = json.loads((tmp_path / "t.json").read_text())["rows"]
    assert [row["point"]["hidden"] for row in rows] == [128, 8, 9]


@pytest.mark.whole
def test_a_start_that_no_trial_is_left_for_is_refused_and_equal_ones_are_one(
    data: Path, tmp_path: Path
) -> None:
    for name in ("a", "b"):
        (tmp_path / f"{name}.toml").write_text(
            'format = 1\narch = "esn"\n[hyper]\nneurons = 30\ninput_scale = 0.03\n[settings]\n'
        )
    asked = ("--arch", "esn", "--data", data, "--dimension", "neurons=20:1000")
    starts = ("--start", tmp_path / "a.toml", "--start", tmp_path / "b.toml")
    few = wakedeploy("tune", *asked, *starts, "--trials", 1, "--out", tmp_path / "few")
    assert few.exit_code == 2
    assert "no trial left for 2 of 3 points to begin at; ask for --trials 3" in one_line(few)
    told = ("--trials", 3, "--out", tmp_path / "out", "--json", tmp_path / "t.json")
    ended = wakedeploy("tune", *asked, *starts, *told)
    assert ended.exit_code == 0, ended.output
    rows = json.loads((tmp_path / "t.json").read_text())["rows"]
    assert [row["point"]["neurons"] for row in rows[:2]] == [1000, 30]
    assert [row["state"] for row in rows] == ["finished"] * 3
    assert len({json.dumps(row["point"]) for row in rows}) == 3


@pytest.mark.whole
def test_a_reservoirs_study_begins_at_the_scales_that_are_tried_anyway(
    data: Path, tmp_path: Path
) -> None:
    asked = ("--arch", "esn", "--data", data, "--out", tmp_path / "out", "--trials", 3)
    small = ("--dimension", "neurons=20:1000", "--json", tmp_path / "t.json")
    ended = wakedeploy("tune", *asked, *small)
    assert ended.exit_code == 0, ended.output
    points = [row["point"] for row in json.loads((tmp_path / "t.json").read_text())["rows"]]
    told = [(point["input_scale"], point["leak"]) for point in points]
    assert told == [(0.25, 0.5), (0.03, 0.5), (0.001, 0.3)]


@pytest.mark.parametrize("device", ["auto", "cpu"])
def test_where_it_trained_is_told(device: str, data: Path, tmp_path: Path) -> None:
    asked = ("--trials", 1, "--epochs", 1, *FAST, "--device", device, "--json", tmp_path / "t.json")
    ended = tune(data, tmp_path / "out", *asked)
    assert ended.exit_code == 0, ended.output
    told = json.loads((tmp_path / "t.json").read_text())
    assert (told["device"], told["best"]["device"]) == ("cpu", "cpu")
    assert tomllib.loads((tmp_path / "out/best.toml").read_text())["study"]["device"] == "cpu"


def test_cuda_that_torch_does_not_see_is_one_sentence_and_leaves_no_trace(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    ended = tune(data, tmp_path / "out", "--trials", 1, *FAST, "--device", "cuda")
    assert ended.exit_code == 2
    assert "torch sees no CUDA device here; choose --device auto or cpu" in one_line(ended)
    assert ended.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--dimension", "hiden=3"], "gru has no dimension 'hiden'; it has hidden, dropout"),
        (["--arch", "mlp"], "--arch: 'mlp' is no architecture; choose agile-mlp"),
        (["--objective", "speed"], "--objective speed: choose rmse or rmse,latency"),
        (["--epochs", "9"], "was made with epochs = 2, not 9; repeat its options"),
        (["--lead", "0.2"], "was made with lead_s = 0.0, not 0.2"),
        (["--arch", "esn"], "--epochs: esn is solved in one pass, not in epochs; leave it out"),
        (
            ["--objective", "rmse,latency", "--pruner", "hyperband"],
            "--pruner: with two objectives no trial is ended early; leave it out",
        ),
        (["--storage", "mysql://me:secret@host/x"], "--storage mysql://…: give a database"),
        (["--storage", "here.db"], "--storage …://…: give a database as postgresql://"),
        (["--data", "nowhere"], "nowhere/dataset.json: not found"),
        (["--start", "nowhere.toml"], "--start nowhere.toml: nowhere.toml does not exist; give a"),
        (["--start", "wide.toml"], "--start wide.toml: hidden = 128 is not within hidden=4:9"),
        (["--start", "long.toml"], "epochs = 9 is not searched, and this study trains with 2."),
        (["--start", "tcn.toml"], "tcn.toml is a preset of tcn, not of gru; give a preset of gru"),
        (["--start", "tuned"], "--start tuned: No tuned preset of gru ships for echo sets; give a"),
        (["--start", "reference"], "--start reference: every study begins there"),
    ],
)
def test_what_cannot_be_tuned_is_one_sentence_and_status_2(
    done: Path, data: Path, arguments: list[str], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(data.parent)
    texts = {
        "wide": PRESET.replace("hidden = 8", "hidden = 128").replace("epochs = 1\n", ""),
        "long": PRESET.replace("epochs = 1", "epochs = 9"),
        "tcn": PRESET.replace("gru", "tcn").replace("hidden", "blocks"),
    }
    for name, text in texts.items():
        (data.parent / f"{name}.toml").write_text(text)
    before = {path: path.read_bytes() for path in done.rglob("*") if path.is_file()}
    ended = tune(data, done, "--trials", 9, "--epochs", 2, *FAST, *arguments)
    assert ended.exit_code == 2, ended.output
    assert says in one_line(ended)
    assert ended.stderr.count("\n") == 1
    assert "secret" not in ended.output
    assert {path: path.read_bytes() for path in done.rglob("*") if path.is_file()} == before


PRESET = 'format = 1\narch = "gru"\n[hyper]\nhidden = 8\n[settings]\nepochs = 1\n'


@pytest.mark.parametrize(
    ("text", "arguments", "says"),
    [
        (PRESET, ["--arch", "tcn"], "is a preset of gru, not of tcn; train --arch gru with it"),
        (PRESET.replace("hidden", "hiden"), [], "gru has no hyper-parameter 'hiden'"),
        (
            PRESET.replace("epochs", "epoch"),
            [],
            "There is no fit setting 'epoch'; there are epochs",
        ),
        (PRESET.replace("hidden = 8", "hidden = 0"), [], "hidden = 0 has to be a whole number"),
        (PRESET.replace("epochs = 1", "epochs = 1.5"), [], "epochs = 1.5 has to be a whole"),
        (PRESET + "[extra]\n", [], "is no preset: extra is not known"),
        (PRESET.replace('"gru"', '"mlp"'), [], "There is no architecture 'mlp'"),
        (PRESET.replace("format = 1", "format = 2"), [], "is no preset: format = 2"),
        ("hidden = = 8", [], "cannot be read as a preset"),
        (None, [], "does not exist; give a preset's file, 'reference' or 'tuned'"),
    ],
)
def test_an_unusable_preset_is_one_sentence(
    text: str | None, arguments: list[str], says: str, data: Path, tmp_path: Path
) -> None:
    path = tmp_path / "p.toml"
    if text is not None:
        path.write_text(text)
    asked = ("--data", data, "--out", tmp_path / "runs", "--preset", path, *arguments)
    ended = wakedeploy("train", *asked)
    assert ended.exit_code == 2, ended.output
    assert says in one_line(ended)
    assert ended.stderr.count("\n") == 1
    assert not (tmp_path / "runs").exists()


def test_tuned_presets_are_looked_up_by_the_sets_domain(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ("--data", data, "--arch", "gru", "--out", tmp_path / "runs", "--preset", "tuned")
    none = wakedeploy("train", *asked)
    assert none.exit_code == 2
    assert "No tuned preset of gru ships for echo sets; find one with" in one_line(none)
    (tmp_path / "echo").mkdir()
    (tmp_path / "echo/gru.toml").write_text(PRESET)
    monkeypatch.setattr("trainers.preset.SHIPPED", tmp_path)
    found = wakedeploy("train", *asked)
    assert found.exit_code == 0, found.output
    config = json.loads((tmp_path / "runs/echo/gru/s0/config.json").read_text())
    assert config["hyper"]["hidden"] == 8


def test_a_tuned_preset_of_the_papers_shape_says_so_and_nothing_else(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "echo").mkdir()
    study = '[study]\nships = "reference"\ntrials = 20\nlead_s = 0.3\ndata_sha256 = "of another"\n'
    text = 'format = 1\narch = "agile-mlp"\n[hyper]\n[settings]\n' + study
    (tmp_path / "echo/agile-mlp.toml").write_text(text)
    monkeypatch.setattr("trainers.preset.SHIPPED", tmp_path)
    asked = ("--data", data, "--arch", "agile-mlp", "--epochs", 1, "--preset", "tuned")
    told = wakedeploy("train", *asked, "--out", tmp_path / "runs")
    assert told.exit_code == 0, told.output
    says = "of agile-mlp on echo sets is the paper's shape: what 20 trials found was no better"
    assert says in one_line(told)
    assert "was found" not in one_line(told)


def test_presets_are_packed_into_the_wheel(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    for name in ("pyproject.toml", "README.md", "trainers/__init__.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes((root / name).read_bytes())
    (tmp_path / "trainers/presets/echo").mkdir(parents=True)
    (tmp_path / "trainers/presets/echo/gru.toml").write_text(PRESET)
    subprocess.run(
        [sys.executable, "-c", "import setuptools; setuptools.setup()", "-q", "build_py",
         "--build-lib", "built"],
        cwd=tmp_path, check=True, capture_output=True, timeout=LIMIT_S,
    )  # fmt: skip
    assert (tmp_path / "built/trainers/presets/echo/gru.toml").exists()


@pytest.mark.slow
def test_error_and_latency_give_a_front_of_measured_packages(data: Path, tmp_path: Path) -> None:
    out = tmp_path / "front"
    ended = wakedeploy(
        "tune", "--arch", "agile-mlp", "--data", data, "--out", out, "--trials", 3, "--epochs", 2,
        "--dimension", "hidden=4,64", "--dimension", "layers=1,3", "--objective", "rmse,latency",
        "--json", tmp_path / "front.json",
    )  # fmt: skip
    assert ended.exit_code == 0, ended.output
    told = json.loads((tmp_path / "front.json").read_text())
    assert all(row["cost"] > 0 for row in told["rows"])
    assert 1 <= len(told["front"]) <= 3
    for row in told["front"]:
        assert f"{row['error']:.4g}" in ended.output
        assert (out / "pareto" / f"trial-{row['number']:04d}.toml").exists()
    assert (out / "pareto.png").exists()
    assert (out / "pareto.pdf").exists()


@pytest.mark.whole
def test_error_and_flash_judge_a_trial_by_the_bytes_of_its_weights(
    data: Path, tmp_path: Path
) -> None:
    ended = wakedeploy(
        "tune", "--arch", "agile-mlp", "--data", data, "--out", tmp_path / "out", "--trials", 2,
        "--epochs", 1, "--dimension", "hidden=4,64", "--dimension", "layers=1",
        "--objective", "rmse,flash", "--json", tmp_path / "told.json",
    )  # fmt: skip
    assert ended.exit_code == 0, ended.output
    for row in json.loads((tmp_path / "told.json").read_text())["rows"]:
        assert row["cost"] == 4 * row["parameters"]
    presets = [tomllib.loads(p.read_text()) for p in (tmp_path / "out" / "pareto").glob("*.toml")]
    assert presets
    assert all(preset["study"]["flash_bytes"] > 0 for preset in presets)


def test_every_architectures_dimensions_are_listed_with_their_bounds() -> None:
    told = " ".join(wakedeploy("tune", "--list-dimensions").output.replace("│", " ").split())
    assert "gru hidden=16:192 dropout=0:0.5 learning_rate=0.0003:0.03" in told
    for arch, known in ARCHITECTURES.items():
        assert f"{arch} {known.dimensions[0]}" in told


def test_help_loads_no_heavy_library() -> None:
    code = (
        "import sys\nfrom wakedeploy.cli import main\n"
        "main(['tune', '--help'], standalone_mode=False)\n"
        "heavy = {'torch', 'numpy', 'optuna', 'sqlalchemy', 'onnx', 'rich', 'pydantic'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=LIMIT_S
    )
    assert ended.stdout.splitlines()[-1] == "[]"


def test_a_folder_with_a_study_in_a_journal_is_none_for_one_in_a_database(
    done: Path, data: Path, tmp_path: Path
) -> None:
    (tmp_path / "study.journal").write_bytes((done / "study.journal").read_bytes())
    told = tune(data, tmp_path, "--storage", "postgresql://me@127.0.0.1:1/none")
    assert told.exit_code == 2
    assert "holds a study of its own, study.journal; choose another --out" in one_line(told)
    assert [path.name for path in tmp_path.iterdir()] == ["study.journal"]


def test_a_folder_with_other_things_is_left_alone(data: Path, tmp_path: Path) -> None:
    theirs = tmp_path / "trials.csv"
    theirs.write_text("mine\n")
    told = tune(data, tmp_path)
    assert told.exit_code == 2
    assert "holds trials.csv and no study; choose another --out" in told.output
    assert [path.name for path in tmp_path.iterdir()] == ["trials.csv"]
    assert theirs.read_text() == "mine\n"


@pytest.mark.parametrize("left", [None, ""])
def test_what_a_study_found_stays_where_its_journal_is_gone(
    done: Path, data: Path, tmp_path: Path, left: str | None
) -> None:
    out = shutil.copytree(done, tmp_path / "out")
    (out / "study.journal").unlink()
    if left is not None:
        (out / "study.journal").write_text(left)
    told = tune(data, out, "--trials", 1, *FAST)
    assert told.exit_code == 2, told.output
    assert "best.toml belongs to a study whose trials are no longer in" in one_line(told)
    assert (out / "best.toml").read_bytes() == (done / "best.toml").read_bytes()
    assert (out / "trials.csv").read_bytes() == (done / "trials.csv").read_bytes()
