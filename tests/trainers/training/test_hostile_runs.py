"""Runs, presets and studies that somebody forged: one sentence that names the file."""

import dataclasses
import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import pytest
import safetensors.torch
import torch
from small_study import tuned, work_of

from trainers import trained_run
from trainers.preset import read_preset
from trainers.trained_run import load_run
from trainers.training.fit import FitSettings
from trainers.training.runs import BEST, CONFIG, METRICS
from trainers.training.trainer import configure, stated_lead_s, train
from trainers.tuning.storage import JOURNAL
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import CheckFailed, UnusableInput

SETTINGS = FitSettings(epochs=1, lanes=4, chunk_steps=32)


@pytest.fixture(scope="module")
def run_folder(echo: EpisodeSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    config = configure(echo, "gru", seed=0, lead_s=0.0, hyper={"hidden": 4}, settings=SETTINGS)
    return train(config, echo, tmp_path_factory.mktemp("runs")).folder


@pytest.fixture
def forged(run_folder: Path, tmp_path: Path) -> Callable[..., Path]:
    """A copy of the run with other weights, or other values in its configuration."""

    def forge(weights: bytes | None = None, **changed: object) -> Path:
        for name in (CONFIG, METRICS, BEST):
            (tmp_path / name).write_bytes((run_folder / name).read_bytes())
        config = json.loads((tmp_path / CONFIG).read_text()) | changed
        (tmp_path / CONFIG).write_text(json.dumps(config))
        if weights is not None:
            (tmp_path / BEST).write_bytes(weights)
            metrics = json.loads((tmp_path / METRICS).read_text())
            metrics["weights_sha256"] = hashlib.sha256(weights).hexdigest()
            (tmp_path / METRICS).write_text(json.dumps(metrics))
        return tmp_path

    return forge


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"arch": "cnn"}, "There is no architecture 'cnn'"),
        ({"hyper": {"hiden": 3}}, "no hyper-parameter 'hiden'"),
        ({"hyper": {"hidden": 10**9}}, "hidden = 1000000000 has to be a whole number"),
        ({"rate_hz": 0.0}, "rate_hz = 0.0"),
        ({"window_s": 1e300}, "window_s = 1e"),
        ({"lead_s": -1.0}, "lead_s = -1"),
        ({"seed": 2**80}, "seed"),
        ({"warm_up_steps": 0}, "warm_up_steps = 0"),
        ({"force": []}, "force"),
        ({"loss_weights": [1.0, 1.0]}, "loss_weights has to have one weight for each force"),
        ({"present_only": ["wind"]}, "present_only names wind, which is not observed"),
        ({"hyper": {"hidden": 5}}, "its tensors are not those of its config.json"),
    ],
)
def test_a_configuration_that_nothing_can_be_built_from_is_named(
    forged: Callable[..., Path], changed: dict, told: str
) -> None:
    with pytest.raises(UnusableInput, match=f"(config.json|best.safetensors) is damaged .*{told}"):
        load_run(forged(**changed))


def test_a_reservoir_that_another_seed_draws_without_a_loop_is_named(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    hyper = {"neurons": 2, "density": 0.9}
    config = configure(echo, "esn", seed=0, lead_s=0.0, hyper=hyper, settings=SETTINGS)
    folder = train(config, echo, tmp_path).folder
    told = json.loads((folder / CONFIG).read_text())
    told["hyper"]["density"] = 0.001
    (folder / CONFIG).write_text(json.dumps(told))
    with pytest.raises(UnusableInput, match=r"config\.json is damaged \(esn: .* without a loop"):
        load_run(folder)


def test_tensors_are_compared_before_a_model_is_made_of_them(
    forged: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []
    built = trained_run.new_predictor
    monkeypatch.setattr(
        trained_run,
        "new_predictor",
        lambda config: made.append(torch.empty(0).is_meta) or built(config),
    )
    folder = forged(arch="esn", hyper={"neurons": 4000})  # of 16 million weights
    with pytest.raises(UnusableInput, match="its tensors are not those"):
        load_run(folder)
    assert made == [True]


@pytest.mark.parametrize(
    "weights",
    [b"", b"\xff" * 40, (10**9).to_bytes(8, "little") + b"{}", b"\x02" + bytes(7) + b"{]"],
)
def test_weights_whose_hash_fits_and_that_are_none_are_named(
    forged: Callable[..., Path], weights: bytes
) -> None:
    with pytest.raises(UnusableInput, match=r"best\.safetensors is damaged"):
        load_run(forged(weights))


def test_a_run_whose_best_weights_give_no_error_is_told(echo: EpisodeSet, tmp_path: Path) -> None:
    config = configure(echo, "gru", seed=0, lead_s=0.0, hyper={"hidden": 4}, settings=SETTINGS)
    folder = train(config, echo, tmp_path).folder
    best, header = folder / BEST, {"facts": "{}"}
    tensors = {n: torch.full_like(t, 3e38) for n, t in safetensors.torch.load_file(best).items()}
    safetensors.torch.save_file(tensors, best, header)
    (folder / METRICS).unlink()
    with pytest.raises(CheckFailed, match="the errors of the best weights are not finite"):
        train(config, echo, tmp_path)


@pytest.mark.parametrize("lead_s", ["soon", -1.0, 1e300, True, [1]])
def test_a_lead_that_is_no_time_is_refused(echo: EpisodeSet, lead_s: object) -> None:
    asked = {"provenance": {"default_lead_s": lead_s}, "folder": Path("sets/echo")}
    with pytest.raises(UnusableInput, match=r"^sets/echo/dataset.json: .* ask for a lead\.$"):
        stated_lead_s(dataclasses.replace(echo, **asked))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a = " + "[" * 100_000, "nested too deeply"),
        (
            "arch = 'gru'\n[hyper]\n[settings]\n[study]\nlead_s = 'soon'",
            "lead_s has to be a number",
        ),
        ("arch = 'gru'\n[hyper]\n[settings]\n[study]\nlead_s = 1e99", "lead_s has to be a number"),
    ],
)
def test_a_preset_that_train_could_not_tell_of_is_refused(
    tmp_path: Path, text: str, told: str
) -> None:
    (tmp_path / "best.toml").write_text(text)
    with pytest.raises(UnusableInput, match=f"best.toml .*{told}"):
        read_preset(tmp_path / "best.toml")


def in_journal(path: Path, change: Callable[[dict], None]) -> None:
    lines = [json.loads(line) for line in path.read_bytes().splitlines()]
    for line in lines:
        change(line)
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def with_values(line: dict) -> None:
    if line.get("values"):
        line["values"] = [float("inf")]


def with_parameter(line: dict) -> None:
    if line.get("param_name") == "hidden":
        line["param_name"] = "hiden"


def with_value(line: dict) -> None:
    if line.get("param_name") == "hidden":
        line["param_value_internal"] = 99


def with_worker(line: dict) -> None:
    if "worker" in line.get("user_attr", {}):
        line["user_attr"]["worker"] = {"pid": "mine"}


def with_identity(line: dict) -> None:
    if "wakedeploy" in line.get("user_attr", {}):
        line["user_attr"]["wakedeploy"] = "gru"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (with_values, "that cannot be: inf is no number"),
        (with_parameter, "it searches hiden, which the study does not"),
        (with_value, "isn't contained in the distribution"),
        (with_worker, "worker"),
        (with_identity, "does not say what it is a study of"),
    ],
)
def test_a_journal_of_trials_that_no_worker_left_is_refused(
    echo: EpisodeSet, tmp_path: Path, change: Callable[[dict], None], told: str
) -> None:
    tuned(echo, tmp_path / "out", "gru", trials=2)
    in_journal(tmp_path / "out" / JOURNAL, change)
    before = (tmp_path / "out" / JOURNAL).read_bytes()
    with pytest.raises(UnusableInput, match=rf"study\.journal: the study echo-gru .*{told}"):
        work_of(echo, tmp_path / "out", "gru").begin()
    assert (tmp_path / "out" / JOURNAL).read_bytes() == before
