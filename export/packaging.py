"""A trained run becomes a package: graph, manifest, example rollout, parity, one file."""

import platform
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch
from pydantic import ValidationError

from export.example import example_rollout
from export.graph import graph_bytes
from export.limits import force_channels
from export.parity import measure, require_parity
from export.samples import joined
from runtime.replay import require_bounded
from trainers.model import Predictor
from trainers.trained_run import TrainedRun
from trainers.training.runs import RunConfig
from wakedeploy.core.episodes import Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import (
    PARITY_LIMIT,
    ForceChannel,
    Manifest,
    Memory,
    Parity,
    Scores,
    State,
)
from wakedeploy.core.package import Package, make_package, package_from_bytes, write_package
from wakedeploy.core.validation import first_problem
from wakedeploy.core.version import VERSION

Progress = Callable[[int, int], None]

_LIBRARIES = ("torch", "onnx", "onnxscript", "onnxruntime", "numpy")
_UNMEASURED = Parity(max_abs=0.0, max_rel=0.0, steps=0, limit=PARITY_LIMIT)


def export_run(
    run: TrainedRun, data: EpisodeSet, path: Path, progress: Progress | None = None
) -> Package:
    """Export a finished run to `path`, parity proved on its test and validation episodes first.

    `progress(done, total)` is called as it gets on. Raises UnusableInput for another set than the
    run was trained on, CheckFailed above the limit; neither leaves a file.
    """
    if data.sha256 != run.config.data_sha256:
        raise UnusableInput(
            f"{run.folder} was trained on another set than the one given, and a package has to"
            " say which forces were seen in training; give that set with --data."
        )
    force = force_channels(run.config.force, [e.force for e in data.part("train")])
    episodes = data.part("test") + data.part("validation") + data.part("train")
    return export_predictor(
        run.predictor, run.config, force, episodes, path, test=run.metrics.test, progress=progress
    )


def export_predictor(
    predictor: Predictor,
    config: RunConfig,
    force: tuple[ForceChannel, ...],
    episodes: tuple[Episode, ...],
    path: Path,
    *,
    test: Scores | None = None,
    progress: Progress | None = None,
) -> Package:
    """The same for a predictor in memory, trained or not.

    `force` says which forces were seen in training; `test` are its scores, if it has any.
    """
    report = progress or (lambda done, total: None)
    model = graph_bytes(predictor, force)
    report(1, 3)
    manifest = manifest_of(predictor, config, force, test)
    observations = joined(episodes, manifest)
    example = example_rollout(predictor, config, force)
    draft = make_package(model, manifest, example)
    parity = measure(draft, predictor, observations)
    report(2, 3)
    package = make_package(model, manifest.model_copy(update={"parity": parity}), example)
    require_parity(package, observations)
    require_bounded(package)
    package_from_bytes(package.model_bytes, path.name)  # nothing is written that would be refused
    write_package(package, path)
    report(3, 3)
    return package


def manifest_of(
    predictor: Predictor,
    config: RunConfig,
    force: tuple[ForceChannel, ...],
    test: Scores | None,
) -> Manifest:
    """What the package will say about itself, parity and graph hash still to be filled in.

    Raises UnusableInput for what no package may be, such as a window of an hour.
    """
    try:
        return _manifest(predictor, config, force, test)
    except ValidationError as error:
        raise UnusableInput(
            f"This {config.arch} cannot become a package: {first_problem(error)}."
        ) from error


def _manifest(
    predictor: Predictor,
    config: RunConfig,
    force: tuple[ForceChannel, ...],
    test: Scores | None,
) -> Manifest:
    return Manifest(
        arch=config.arch,
        hyper=dict(config.hyper),
        domain=config.domain,
        rate_hz=config.rate_hz,
        lead_s=config.lead_s,
        observation=config.observation,
        force=force,
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
    """Observations until its force counts, the newest among them.

    One, the window's span, or those before the first that the run's errors are of, and that one.
    """
    if predictor.memory.kind == "state":
        return config.warm_up_steps + 1
    return _memory(predictor).span


def _versions() -> dict[str, str]:
    versions = {"wakedeploy": VERSION, "python": platform.python_version()}
    return versions | {name: version(name) for name in _LIBRARIES}
