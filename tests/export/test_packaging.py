"""All eight become packages that tell the training-time force, or no file is left."""

import copy
from pathlib import Path

import numpy as np
import onnx
import onnxruntime as ort
import pytest
import torch

from export.packaging import export_predictor
from export.samples import joined
from runtime.predictor import PackagePredictor
from runtime.replay import compare, replay, rolled_out
from trainers.build import ARCHITECTURES
from trainers.model import Predictor
from wakedeploy.core.episodes import Episode
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.manifest import PARITY_STEPS, Manifest
from wakedeploy.core.package import make_package, read_package, write_package


@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_a_package_carries_the_training_time_forward(arch: str, exported_arch) -> None:
    made, path = exported_arch(arch).package, exported_arch(arch).path
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
@pytest.mark.filterwarnings("error::torch.jit.TracerWarning")  # a size taken from a tensor
@pytest.mark.parametrize("arch", ["gru", "cross-attention"])
def test_the_older_exporter_gives_the_same_force(arch: str, exported_arch, tmp_path: Path) -> None:
    """The TorchScript exporter is a second opinion on the graph, step for step."""
    predictor = copy.deepcopy(exported_arch(arch).predictor)
    shape = (1, predictor.memory.k, 8) if predictor.memory.kind == "window" else (1, 8)
    state = predictor.initial_state(1)
    torch.manual_seed(0)  # quiet enough to stay within the force limits, which only a package has
    held = {name: 0.3 * torch.randn_like(value) for name, value in state.items()}
    source = 0.3 * torch.randn(shape)

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
    new = ort.InferenceSession(exported_arch(arch).package.model_bytes)
    new_force = new.run(
        None, {i.name: v.numpy() for i, v in zip(new.get_inputs(), inputs, strict=True)}
    )[0]
    assert np.allclose(np.ravel(old_force), np.ravel(new_force), rtol=1e-5, atol=1e-6)


def test_a_graph_that_differs_leaves_no_file(
    episodes: tuple[Episode, ...], exported_arch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if the exporter had got an equation wrong: another predictor's graph is written."""
    gru = exported_arch("gru")
    monkeypatch.setattr("export.packaging.graph_bytes", lambda *_: gru.package.model_bytes)
    path = tmp_path / "gru.onnx"
    with pytest.raises(CheckFailed, match="no file was written"):
        export_predictor(
            copy_with_noise(gru.predictor), gru.config, gru.package.manifest.force, episodes, path
        )
    assert not path.exists()
    assert not list(tmp_path.iterdir())


def copy_with_noise(predictor: Predictor) -> Predictor:
    changed = copy.deepcopy(predictor)
    with torch.no_grad():
        next(changed.parameters()).mul_(1.01)
    return changed


def test_made_samples_follow_where_a_set_has_too_few_for_parity(
    episodes: tuple[Episode, ...], exported_arch, tmp_path: Path
) -> None:
    gru = exported_arch("gru")
    manifest = gru.package.manifest
    few = episodes[:2]
    real = np.concatenate([e.observation for e in few])
    asked = joined(few, manifest)
    assert len(real) < PARITY_STEPS == len(asked)
    np.testing.assert_array_equal(asked[: len(real)], real)
    channels = manifest.observation
    low, high = (np.array([getattr(c, end) for c in channels]) for end in ("min", "max"))
    made = asked[len(real) :]
    assert np.all((made >= low - 1e-6) & (made <= high + 1e-6))
    assert np.all(made.std(axis=0) > 0.2 * (high - low))
    small = export_predictor(gru.predictor, gru.config, manifest.force, few, tmp_path / "gru.onnx")
    assert small.manifest.parity.passed


def test_progress_is_told_to_the_end(
    episodes: tuple[Episode, ...], exported_arch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mlp, told = exported_arch("agile-mlp"), []
    monkeypatch.setattr("export.packaging.graph_bytes", lambda *_: mlp.package.model_bytes)
    export_predictor(
        mlp.predictor,
        mlp.config,
        mlp.package.manifest.force,
        episodes,
        tmp_path / "a.onnx",
        progress=lambda *at: told.append(at),
    )
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_a_replay_that_differs_is_told(exported_arch, tmp_path: Path) -> None:
    made = exported_arch("agile-mlp").package
    force = made.example.force.copy()
    force[100, 1] += 0.01
    example = type(made.example)(made.example.seed, made.example.observation, force)
    altered = make_package(made.model_bytes, made.manifest, example)
    write_package(altered, tmp_path / "b.onnx")
    with pytest.raises(CheckFailed, match="f1 at step 100"):
        replay(read_package(tmp_path / "b.onnx"))


def test_the_window_model_starts_from_its_first_observation_repeated(
    episodes: tuple[Episode, ...], exported_arch
) -> None:
    predictor = exported_arch("history-mlp").predictor
    package = exported_arch("history-mlp").package
    series = episodes[0].observation[:5]
    with torch.no_grad():
        expected = predictor.rollout(torch.from_numpy(series)[None])[0].numpy()
    assert compare(rolled_out(PackagePredictor(package), series), expected).max_rel < 1e-5
    assert isinstance(package.manifest, Manifest)
    assert package.manifest.warm_up_steps == 31
