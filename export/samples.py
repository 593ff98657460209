"""Real samples in a row, for the gates of packages and of C; no torch, which a Pi has not."""

import numpy as np

from runtime.compiled.driven import driven
from wakedeploy.core.episodes import Episode
from wakedeploy.core.manifest import PARITY_STEPS, FloatArray, Manifest


def joined(
    episodes: tuple[Episode, ...], manifest: Manifest, steps: int = PARITY_STEPS
) -> FloatArray:
    """Observations (T, d) of whole episodes in a row, at least `steps` of them, without a reset.

    Where the episodes are fewer, made ones over the ranges seen in training follow: repeated
    samples would prove nothing more.
    """
    chosen: list[FloatArray] = []
    for episode in episodes:
        chosen.append(episode.observation)
        if sum(map(len, chosen)) >= steps:
            return np.concatenate(chosen)
    return np.concatenate([*chosen, driven(manifest, steps - sum(map(len, chosen)))])
