"""The example rollout that travels with a package: made inputs, never a recording."""

from collections.abc import Sequence

import numpy as np
import torch

from export.limits import limited
from trainers.model import Predictor
from trainers.training.runs import RunConfig
from wakedeploy.core.manifest import FloatArray, ForceChannel, ObservationChannel
from wakedeploy.core.package import EXAMPLE_STEPS, Example

_FASTEST_HZ = 2.0


def example_rollout(
    predictor: Predictor, config: RunConfig, force: Sequence[ForceChannel]
) -> Example:
    """512 seeded inputs inside the ranges seen in training; the training-time forward over them.

    Its force is limited as the exported graph's is.
    """
    observation = band_limited(config.observation, config.rate_hz, config.seed)  # (T, d)
    force_n = rollout(predictor, observation)
    return Example(config.seed, observation, limited(force_n, force))


def rollout(predictor: Predictor, observation: FloatArray) -> FloatArray:
    """The training-time forward from a cold start, (T, d) -> (T, o)."""
    with torch.no_grad():
        force_n: FloatArray = predictor.rollout(torch.from_numpy(observation)[None])[0].numpy()
    return force_n


def band_limited(channels: tuple[ObservationChannel, ...], rate_hz: float, seed: int) -> FloatArray:
    """Sums of five sines up to 2 Hz per channel, (T, d), scaled to stay within its range."""
    rng = np.random.default_rng(seed)
    t = np.arange(EXAMPLE_STEPS)[:, None] / rate_hz  # (T, 1)
    columns = []
    for channel in channels:
        frequency = rng.uniform(0.05, _FASTEST_HZ, 5)  # (5,)
        phase, weight = rng.uniform(0, 2 * np.pi, 5), rng.dirichlet(np.ones(5))
        wave = np.sin(2 * np.pi * frequency * t + phase) @ weight  # (T,), within ±1
        middle, half = 0.5 * (channel.max + channel.min), 0.5 * (channel.max - channel.min)
        columns.append(np.clip(middle + half * wave, channel.min, channel.max))
    return np.stack(columns, axis=1).astype(np.float32)
