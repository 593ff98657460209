"""A trained predictor flown: many episodes side by side, one sample of each at a time.

In: a predictor. Out: a function from the newest observations to forces that remembers what it was
shown before, as the deployed package does.
"""

import numpy as np
import torch
from numpy.typing import NDArray

from trainers.model import Predictor

Array = NDArray[np.float64]


class Lockstep:
    """Call with observations (E, d) in SI, step by step; gives forces (E, o) in SI.

    Every call must have as many episodes as the first one. A window is filled with the first
    observation until there are enough.
    """

    def __init__(self, predictor: Predictor) -> None:
        self._predictor = predictor.eval()
        self._past: torch.Tensor | None = None  # (E, L, d), a ring
        self._newest = 0
        self._state: dict[str, torch.Tensor] | None = None

    @torch.no_grad()
    def __call__(self, observation: Array) -> Array:
        """The forces that the predictor expects now."""
        seen = torch.as_tensor(observation, dtype=torch.float32)
        memory = self._predictor.memory
        if memory.kind == "state":
            force, self._state = self._predictor.step(seen, self._state)
        elif memory.kind == "window":
            force = self._predictor.step(self._windows(seen))
        else:
            force = self._predictor.step(seen)
        return np.asarray(force.numpy(), dtype=float)

    def _windows(self, seen: torch.Tensor) -> torch.Tensor:
        """Windows (E, K, d), oldest first, that end with what is seen now."""
        memory = self._predictor.memory
        length = (memory.k - 1) * memory.stride + 1
        if self._past is None:
            self._past = seen.unsqueeze(1).repeat(1, length, 1)
        self._newest = (self._newest + 1) % length
        self._past[:, self._newest] = seen
        ages = torch.arange(memory.k - 1, -1, -1) * memory.stride
        return self._past[:, (self._newest - ages) % length]
