"""A trained run becomes a package: graph, manifest, example rollout, parity, one file."""

import platform
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch

import wakedeploy
from export.example import example_rollout
from export.graph import graph_bytes
from export.parity import joined, measure, require_parity
from trainers.model import Predictor
from trainers.runs import RunConfig, TrainedRun
from wakedeploy.episodes import Episode, EpisodeSet
from wakedeploy.errors import UnusableInput
from wakedeploy.package import (
    PARITY_LIMIT,
    Manifest,
    Memory,
    Package,
    Parity,
    Scores,
    State,
    make_package,
    write_package,
)

Progress = Callable[[int, int], None]

_LIBRARIES = ("torch", "onnx", "onnxscript", "onnxruntime", "numpy")
_UNMEASURED = Parity(max_abs=0.0, max_rel=0.0, steps=0, limit=PARITY_LIMIT)


def export_run(
    run: TrainedRun, data: EpisodeSet, path: Path, progress: Progress | None = None
) -> Package:
    """Export a finished run to `path`, parity proved on its test and validation episodes first.

    `progress(done, total)` is called as it gets on. Raises UnusableInput when the set does not have
    the run's channels, CheckFailed above the limit; neither leaves a file.
    """
    asked = [channel.name for channel in run.config.observation]
    given = [channel.name for channel in data.observation]
    if asked != given:
        raise UnusableInput(
            f"The run observes {', '.join(asked)} and the set holds {', '.join(given)}; "
            "give the set it was trained on with --data."
        )
    episodes = data.part("test") + data.part("validation") + data.part("train")
    return export_predictor(
        run.predictor, run.config, episodes, path, test=run.metrics.test, progress=progress
    )


def export_predictor(
    predictor: Predictor,
    config: RunConfig,
    episodes: tuple[Episode, ...],
    path: Path,
    *,
    test: Scores | None = None,
    progress: Progress | None = None,
) -> Package:
    """The same for a predictor in memory, trained or not; `test` are its scores, if it has any."""
    told = progress or (lambda done, total: None)
    observations = joined(episodes)
    model = graph_bytes(predictor)
    told(1, 3)
    example = example_rollout(predictor, config.observation, config.rate_hz, config.seed)
    manifest = manifest_of(predictor, config, test)
    draft = make_package(model, manifest, example)
    parity = measure(draft, predictor, observations)
    told(2, 3)
    package = make_package(model, manifest.model_copy(update={"parity": parity}), example)
    require_parity(package, observations)
    write_package(package, path)
    told(3, 3)
    return package


def manifest_of(predictor: Predictor, config: RunConfig, test: Scores | None) -> Manifest:
    """What the package will say about itself, parity and graph hash still to be filled in."""
    return Manifest(
        arch=config.arch,
        hyper=dict(config.hyper),
        domain=config.domain,
        rate_hz=config.rate_hz,
        lead_s=config.lead_s,
        observation=config.observation,
        force=config.force,
        memory=_memory(predictor),
        warm_up_steps=_warm_up_steps(predictor, config),
        trainable=predictor.trainable,
        frozen=predictor.frozen,
        data_sha256=config.data_sha256,
        seed=config.seed,
        test=test,
        parity=_UNMEASURED,
        versions=_versions(),
        graph_sha256="0" * 64,
    )


def _memory(predictor: Predictor) -> Memory:
    memory = predictor.memory
    states = {
        name: State(shape=shape, initial=_initial(predictor, name))
        for name, shape in memory.states.items()
    }
    return Memory(kind=memory.kind, k=memory.k, stride=memory.stride, states=states)


def _initial(predictor: Predictor, name: str) -> float | tuple[float, ...]:
    """One number where all elements start alike, else every element."""
    with torch.no_grad():
        values = predictor.initial_state(1)[name].numpy().ravel().astype(np.float64)
    return float(values[0]) if np.all(values == values[0]) else tuple(map(float, values))


def _warm_up_steps(predictor: Predictor, config: RunConfig) -> int:
    """Observations until the memory is full: one, the window's span, or the domain's warm-up."""
    memory = predictor.memory
    if memory.kind == "none":
        return 1
    return (memory.k - 1) * memory.stride + 1 if memory.kind == "window" else config.warm_up_steps


def _versions() -> dict[str, str]:
    own = {"wakedeploy": wakedeploy.__version__, "python": platform.python_version()}
    return own | {name: version(name) for name in _LIBRARIES}
