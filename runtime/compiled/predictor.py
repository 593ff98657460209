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
from runtime.stepped import SteppedPredictor
from wakedeploy.core.manifest import FloatArray

Call = Callable[..., None]


class CompiledPredictor(SteppedPredictor):
    """A folder of C; it is compiled at first, unless that has been done here before."""

    def __init__(
        self, folder: CFolder, *, batch: int = 1, flags: Sequence[str] | None = None
    ) -> None:
        super().__init__(folder.manifest, batch)
        step, reset = functions(shared_library(folder.source, flags), folder)
        d = len(self.manifest.observation)
        self._observation: FloatArray = np.zeros((batch, d), np.float32)
        # Of float32, so that the states lie where C expects them to.
        states = np.zeros((batch, folder.document.state_bytes // 4), np.float32)
        self._states = states
        parts = (states, self._observation, self._force)
        places = [tuple(ctypes.c_void_p(p[i].ctypes.data) for p in parts) for i in range(batch)]
        self._calls = [functools.partial(step, *place) for place in places]
        self._resets = [functools.partial(reset, place[0]) for place in places]
        self.reset()

    def _forget(self) -> None:
        for forget in self._resets:
            forget()

    def _compute(self, newest: npt.NDArray[np.generic]) -> None:
        self._observation[:] = newest
        for call in self._calls:
            call()


def functions(library: Path, folder: CFolder) -> tuple[Call, Call]:
    """The step and the reset of a folder's library."""
    loaded = ctypes.CDLL(str(library))
    step, reset = (getattr(loaded, f"{folder.document.name}_{what}") for what in ("step", "reset"))
    step.argtypes, step.restype = [ctypes.c_void_p] * 3, None
    reset.argtypes, reset.restype = [ctypes.c_void_p], None
    return step, reset
