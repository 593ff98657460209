"""All eight become packages that tell the training-time force, or no file is left."""

import copy
from pathlib import Path

import numpy as np
import onnx
import onnxruntime as ort
import pytest
import torch

from export.graph import graph_bytes
from export.packaging import export_predictor
from runtime.predictor import PackagePredictor
from runtime.replay import compare, replay, rolled_out
from trainers.build import ARCHITECTURES
from trainers.model import Predictor
from trainers.runs import RunConfig, new_predictor
from wakedeploy.episodes import Episode
from wakedeploy.errors import CheckFailed, UnusableInput
from wakedeploy.package import Manifest, make_package, read_package, write_package

NAMES = ("dx_m", "dz_m", "vx_mps", "vz_mps", "source_command")


def config_of(arch: str, seed: int = 3) -> RunConfig:
    channel = {"unit": "m", "min": -2.0, "max": 2.0}
    return RunConfig.model_validate(
        {
            "arch": arch,
            "hyper": {},
            "domain": "gantry",
            "rate_hz": 32.0,
            "lead_s": 0.098,
            "window_s": 0.5,
            "warm_up_steps": 16,
            "observation": [channel | {"name": name} for name in NAMES],
            "force": [{"name": "force_z_n", "unit": "N"}],
            "loss_weights": [1.0],
            "data_sha256": "0" * 64,
            "seed": seed,
            "settings": {},
        }
    )


def predictor_of(arch: str) -> Predictor:
    """Untrained weights, but normalisation that is not the identity and a readout that is not 0."""
    predictor = new_predictor(config_of(arch)).eval()
    torch.manual_seed(5)
    predictor.set_normalisation(torch.randn(500, 5) * 2 + 1, torch.randn(500, 1) * 0.4 - 0.3)
    with torch.no_grad():
        for weight in predictor.parameters():
            if weight.requires_grad and not weight.any():
                weight.normal_(0.0, 0.05)
    return predictor


@pytest.fixture(scope="module")
def episodes() -> tuple[Episode, ...]:
    rng = np.random.default_rng(0)
    walk = np.cumsum(rng.standard_normal((4, 900, 5)), axis=1) * 0.1
    forces = np.zeros((900, 1), np.float32)
    return tuple(Episode(f"e{i}", w.astype(np.float32), forces, {}) for i, w in enumerate(walk))


@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_a_package_carries_the_training_time_forward(
    arch: str, episodes: tuple[Episode, ...], tmp_path: Path
) -> None:
    path = tmp_path / f"{arch}.onnx"
    made = export_predictor(predictor_of(arch), config_of(arch), episodes, path)
    assert made.manifest.parity.steps >= 3200
    assert made.manifest.parity.max_rel <= made.manifest.parity.limit
    read = read_package(path)
    assert read.manifest == made.manifest
    assert replay(read).difference.max_rel <= read.manifest.parity.limit
    model = onnx.load_from_string(path.read_bytes())
    assert [entry.version for entry in model.opset_import if entry.domain == ""] == [20]
    assert not any(node.metadata_props or node.doc_string for node in model.graph.node)
    assert str(Path.cwd()).encode() not in path.read_bytes()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("arch", ["gru", "cross-attention"])
def test_the_older_exporter_gives_the_same_force(arch: str, tmp_path: Path) -> None:
    """The TorchScript exporter is a second opinion on the graph, step for step."""
    predictor = predictor_of(arch)
    shape = (1, predictor.memory.k, 5) if predictor.memory.kind == "window" else (1, 5)
    state = predictor.initial_state(1)
    held = {name: torch.randn_like(value) for name, value in state.items()}
    source = torch.randn(shape)

    class Step(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.predictor = predictor

        def forward(self, source: torch.Tensor, *held: torch.Tensor) -> torch.Tensor:
            given = dict(zip(state, held, strict=True))
            stepped = self.predictor.step(source, given or None)
            return stepped[0] if given else stepped

    path = tmp_path / "second.onnx"
    torch.onnx.export(Step(), (source, *held.values()), str(path), dynamo=False, opset_version=17)
    old = ort.InferenceSession(path)
    inputs = [source, *held.values()]
    old_force = old.run(
        None, {i.name: v.numpy() for i, v in zip(old.get_inputs(), inputs, strict=True)}
    )[0]
    new = ort.InferenceSession(graph_bytes(predictor))
    new_force = new.run(
        None, {i.name: v.numpy() for i, v in zip(new.get_inputs(), inputs, strict=True)}
    )[0]
    assert np.allclose(np.ravel(old_force), np.ravel(new_force), rtol=1e-5, atol=1e-6)


def test_a_graph_that_differs_leaves_no_file(
    episodes: tuple[Episode, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if the exporter had got an equation wrong: another predictor's graph is written."""
    wrong = graph_bytes(copy_with_noise(predictor_of("gru")))
    monkeypatch.setattr("export.packaging.graph_bytes", lambda predictor: wrong)
    path = tmp_path / "gru.onnx"
    with pytest.raises(CheckFailed, match="no file was written"):
        export_predictor(predictor_of("gru"), config_of("gru"), episodes, path)
    assert not path.exists()
    assert not list(tmp_path.iterdir())


def copy_with_noise(predictor: Predictor) -> Predictor:
    changed = copy.deepcopy(predictor)
    with torch.no_grad():
        next(changed.parameters()).mul_(1.01)
    return changed


def test_too_few_samples_cannot_prove_parity(episodes: tuple[Episode, ...], tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match="3200"):
        export_predictor(predictor_of("gru"), config_of("gru"), episodes[:2], tmp_path / "gru.onnx")


def test_a_replay_that_differs_is_told(episodes: tuple[Episode, ...], tmp_path: Path) -> None:
    made = export_predictor(
        predictor_of("agile-mlp"), config_of("agile-mlp"), episodes, tmp_path / "a.onnx"
    )
    force = made.example.force.copy()
    force[100] += 0.01
    example = type(made.example)(made.example.seed, made.example.observation, force)
    altered = make_package(made.model_bytes, made.manifest, example)
    write_package(altered, tmp_path / "b.onnx")
    with pytest.raises(CheckFailed, match="force_z_n at step 100"):
        replay(read_package(tmp_path / "b.onnx"))


def test_the_window_model_starts_from_its_first_observation_repeated(
    episodes: tuple[Episode, ...], tmp_path: Path
) -> None:
    predictor = predictor_of("history-mlp")
    package = export_predictor(predictor, config_of("history-mlp"), episodes, tmp_path / "h.onnx")
    series = episodes[0].observation[:5]
    with torch.no_grad():
        expected = predictor.rollout(torch.from_numpy(series)[None])[0].numpy()
    assert compare(rolled_out(PackagePredictor(package), series), expected).max_rel < 1e-5
    assert isinstance(package.manifest, Manifest)
    assert package.manifest.warm_up_steps == 17
