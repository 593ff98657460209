"""The example rollout that travels with a package: made inputs, never a recording."""

import numpy as np
import torch

from trainers.model import Predictor
from wakedeploy.package import Example, FloatArray, ObservationChannel

STEPS = 512
_FASTEST_HZ = 2.0


def example_rollout(
    predictor: Predictor, channels: tuple[ObservationChannel, ...], rate_hz: float, seed: int
) -> Example:
    """512 seeded inputs inside the ranges seen in training; the training-time forward over them."""
    observation = band_limited(channels, rate_hz, seed)  # (T, d)
    with torch.no_grad():
        force = predictor.rollout(torch.from_numpy(observation)[None])[0]  # (T, o)
    return Example(seed, observation, force.numpy())


def band_limited(channels: tuple[ObservationChannel, ...], rate_hz: float, seed: int) -> FloatArray:
    """Sums of five sines up to 2 Hz per channel, (T, d), scaled to stay within its range."""
    rng = np.random.default_rng(seed)
    t = np.arange(STEPS)[:, None] / rate_hz  # (T, 1)
    columns = []
    for channel in channels:
        frequency = rng.uniform(0.05, _FASTEST_HZ, 5)  # (5,)
        phase, weight = rng.uniform(0, 2 * np.pi, 5), rng.dirichlet(np.ones(5))
        wave = np.sin(2 * np.pi * frequency * t + phase) @ weight  # (T,), within ±1
        middle, half = 0.5 * (channel.max + channel.min), 0.5 * (channel.max - channel.min)
        columns.append(np.clip(middle + half * wave, channel.min, channel.max))
    return np.stack(columns, axis=1).astype(np.float32)
