"""The eight architectures at the shapes of the paper's Table I, untrained, as packages.

For measuring what a shape costs before anything has been trained: weights are as drawn, but graph,
manifest and parity gate are those of every package.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from export.example import rollout
from export.limits import force_channels
from export.packaging import export_predictor
from trainers.build import ARCHITECTURES
from trainers.training.runs import RunConfig, new_predictor
from wakedeploy.core.episodes import Episode
from wakedeploy.core.manifest import PARITY_STEPS, ObservationChannel, Quantity

RATE_HZ = 32.0
WINDOW_S = 30.0 / RATE_HZ  # 31 snapshots, as in Table I
INPUTS, OUTPUTS = 8, 2


def write_reference_packages(
    folder: Path, progress: Callable[[int, int], None] = lambda done, total: None
) -> list[Path]:
    """Write one package per architecture into `folder`; their paths in Table I's order."""
    paths = []
    for arch in ARCHITECTURES:
        paths.append(_written(arch, folder / f"{arch}.onnx"))
        progress(len(paths), len(ARCHITECTURES))
    return paths


def _written(arch: str, path: Path) -> Path:
    config = reference_config(arch)
    predictor = new_predictor(config).eval()
    rng = np.random.default_rng(0)
    with torch.no_grad():
        # What starts at zero, as Delay Embedding's selector does, would hide what it multiplies.
        for weights in predictor.parameters():
            if weights.requires_grad and not torch.any(weights):
                weights.copy_(torch.from_numpy(0.1 * rng.standard_normal(weights.shape)))
    observation = rng.uniform(-1.0, 1.0, (PARITY_STEPS, INPUTS)).astype(np.float32)
    force = rollout(predictor, observation)
    channels = force_channels(config.force, [force])
    export_predictor(predictor, config, channels, (Episode("noise", observation, force),), path)
    return path


def reference_config(arch: str) -> RunConfig:
    """Eight inputs, two outputs, reference hyper-parameters."""
    inputs = [ObservationChannel(name=f"o{i}", unit="1", min=-1.0, max=1.0) for i in range(INPUTS)]
    return RunConfig(
        arch=arch,
        hyper={},
        domain="reference",
        rate_hz=RATE_HZ,
        lead_s=0.0,
        window_s=WINDOW_S,
        warm_up_steps=round(WINDOW_S * RATE_HZ),
        observation=tuple(inputs),
        force=tuple(Quantity(name=f"f{i}", unit="N") for i in range(OUTPUTS)),
        loss_weights=(1.0,) * OUTPUTS,
        data_sha256="0" * 64,
        seed=0,
        settings={},
    )
