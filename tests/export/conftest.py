"""One package of each architecture, exported once for everything that looks at it."""

import functools
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from wakedeploy.core.episodes import Episode
from wakedeploy.core.locks import one_at_a_time
from wakedeploy.core.package import Package, read_package


@dataclass(frozen=True, eq=False)
class Exported:
    """What went in and what came out; Table I's shape, eight inputs, two outputs."""

    predictor: object
    config: object
    package: Package
    path: Path


def predictor_of(arch: str):
    """Untrained weights, but a normalisation that is not the identity, and no weight that is 0."""
    torch = pytest.importorskip("torch")
    from export.reference import INPUTS, OUTPUTS, reference_config
    from trainers.training.runs import new_predictor

    predictor = new_predictor(reference_config(arch)).eval()
    torch.manual_seed(5)
    forces = torch.randn(500, OUTPUTS) * 0.4 - 0.3
    predictor.set_normalisation(torch.randn(500, INPUTS) * 2 + 1, forces)
    with torch.no_grad():
        for weight in predictor.parameters():
            if weight.requires_grad and not weight.any():
                weight.normal_(0.0, 0.05)
    return predictor


def seen_by(predictor, config, episodes: tuple[Episode, ...]):
    """The forces of an untrained predictor over the episodes, as if it had learned them."""
    from export.example import rollout
    from export.limits import force_channels

    told = [rollout(predictor, episode.observation) for episode in episodes]
    return force_channels(config.force, told)


@pytest.fixture(scope="session")
def episodes() -> tuple[Episode, ...]:
    rng = np.random.default_rng(0)
    walk = np.cumsum(rng.standard_normal((4, 900, 8)), axis=1) * 0.1
    forces = np.zeros((900, 2), np.float32)
    return tuple(Episode(f"e{i}", w.astype(np.float32), forces, {}) for i, w in enumerate(walk))


@pytest.fixture(scope="session")
def exported_arch(
    episodes: tuple[Episode, ...], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], Exported]:
    """A function of the architecture's name. The predictor must not be changed.

    An export takes seconds: what one worker has exported, the others read.
    """
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "exported"

    @functools.cache
    def export(arch: str) -> Exported:
        from export.packaging import export_predictor
        from export.reference import reference_config

        predictor, config = predictor_of(arch), reference_config(arch)
        path = folder / f"{arch}.onnx"
        with one_at_a_time(folder, arch):
            if path.exists():
                package = read_package(path)
            else:
                force = seen_by(predictor, config, episodes)
                package = export_predictor(predictor, config, force, episodes, path)
        return Exported(predictor, config, package, path)

    return export
