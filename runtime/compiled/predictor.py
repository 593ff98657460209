"""A predictor in C, stepped through a shared library: the interface of `PackagePredictor`.

The interpreter's lock is free while C computes, so the loop can wait for a step with a time limit.
"""

import ctypes
import functools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from runtime.compiled.compiler import shared_library
from runtime.compiled.folder import CFolder
from wakedeploy.core.manifest import FloatArray, Manifest

Call = Callable[..., None]


class CompiledPredictor:
    """Steps a C folder through time, `batch` independent series in lockstep.

    It is compiled at first, unless that has been done here before. NaN in or out is passed on.
    """

    def __init__(
        self, folder: CFolder, *, batch: int = 1, flags: Sequence[str] | None = None
    ) -> None:
        self.manifest: Manifest = folder.manifest
        self.batch = batch
        self._seen = 0
        step, reset = functions(shared_library(folder.source, flags), folder)
        d, outputs = len(self.manifest.observation), len(self.manifest.force)
        self._observation: FloatArray = np.zeros((batch, d), np.float32)
        self._force: FloatArray = np.empty((batch, outputs), np.float32)
        # Of float32, so that the states lie where C expects them to.
        states = np.zeros((batch, folder.document.state_bytes // 4), np.float32)
        self._states = states
        parts = (states, self._observation, self._force)
        places = [tuple(ctypes.c_void_p(p[i].ctypes.data) for p in parts) for i in range(batch)]
        self._calls = [functools.partial(step, *place) for place in places]
        self._resets = [functools.partial(reset, place[0]) for place in places]
        self._shapes = {(batch, d)} | ({(d,)} if batch == 1 else set())
        self.reset()

    @property
    def warm_up_steps(self) -> int:
        """Observations after which the memory is full."""
        return self.manifest.warm_up_steps

    @property
    def lead_s(self) -> float:
        """How far ahead of the newest observation the force is predicted, in seconds."""
        return self.manifest.lead_s

    @property
    def ready(self) -> bool:
        """Whether the memory has been filled since the last reset."""
        return self._seen >= self.manifest.warm_up_steps

    def reset(self) -> None:
        """Forget everything: the next step is the first one."""
        self._seen = 0
        for forget in self._resets:
            forget()

    def step(self, observation: npt.ArrayLike) -> FloatArray:
        """The force, float32 (o,), for the newest observation (d,); with a batch (B, o), (B, d).

        SI units, channels in the manifest's order. Raises ValueError for another shape.
        """
        newest = np.asarray(observation)
        if newest.shape not in self._shapes:
            self._refuse(newest)
        self._observation[:] = newest
        for call in self._calls:
            call()
        self._seen += 1
        return self._force[0].copy() if newest.ndim == 1 else self._force.copy()

    def _refuse(self, observation: npt.NDArray[np.generic]) -> None:
        d = len(self.manifest.observation)
        raise ValueError(
            f"observation of shape {observation.shape} where this predictor expects"
            f" {(d,) if self.batch == 1 else (self.batch, d)}"
        )


def functions(library: Path, folder: CFolder) -> tuple[Call, Call]:
    """The step and the reset of a folder's library."""
    loaded = ctypes.CDLL(str(library))
    step, reset = (getattr(loaded, f"{folder.document.name}_{what}") for what in ("step", "reset"))
    step.argtypes, step.restype = [ctypes.c_void_p] * 3, None
    reset.argtypes, reset.restype = [ctypes.c_void_p], None
    return step, reset
