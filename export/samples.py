"""Real samples in a row, for the gates of packages and of C; no torch, which a Pi has not."""

import numpy as np

from wakedeploy.core.episodes import Episode
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import PARITY_STEPS, FloatArray


def joined(episodes: tuple[Episode, ...], steps: int = PARITY_STEPS) -> FloatArray:
    """Observations (T, d) of whole episodes in a row, at least `steps` of them, without a reset.

    Raises UnusableInput when the episodes are too few: parity is not proved on repeated samples.
    """
    chosen: list[FloatArray] = []
    for episode in episodes:
        chosen.append(episode.observation)
        if sum(map(len, chosen)) >= steps:
            return np.concatenate(chosen)
    raise UnusableInput(
        f"Parity needs {steps} samples of real episodes and the set holds "
        f"{sum(map(len, chosen))}; give a larger one with --data."
    )
