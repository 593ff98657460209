"""What a run can fly: a package's file in onnxruntime, or a folder of C in a shared library.

Both are read, tried and stepped the same way; onnxruntime is loaded for the first alone.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import numpy.typing as npt

from runtime.compiled.folder import CFolder, read_c_folder
from runtime.compiled.predictor import CompiledPredictor
from runtime.compiled.proof import require_proof
from wakedeploy.core.manifest import FloatArray, Manifest
from wakedeploy.core.package import Package, read_package

Flyable = Package | CFolder


class Predicting(Protocol):
    """A predictor at work, whatever computes it."""

    manifest: Manifest

    @property
    def warm_up_steps(self) -> int:
        """The step, counted from 1 after a reset, whose force is the first that counts."""

    @property
    def lead_s(self) -> float:
        """How far ahead of the newest observation the force is predicted, in seconds."""

    @property
    def ready(self) -> bool:
        """Whether the memory is full."""

    def reset(self) -> None:
        """Forget everything."""

    def step(self, observation: npt.ArrayLike) -> FloatArray:
        """The force (o,) for an observation (d,); with a batch (B, o) for (B, d)."""


def read_flyable(path: Path) -> Flyable:
    """A package's file or a folder of C; UnusableInput where it is neither."""
    return read_c_folder(path) if path.is_dir() else read_package(path)


def predictor_of(flyable: Flyable, batch: int = 1) -> Predicting:
    """A predictor at its first step, of `batch` independent series."""
    if isinstance(flyable, CFolder):
        return CompiledPredictor(flyable, batch=batch)
    from runtime.predictor import PackagePredictor

    return PackagePredictor(flyable, batch=batch)


def is_bounded(flyable: Flyable) -> bool:
    """Whether each step takes about the same time and waits for nothing, as in C."""
    return isinstance(flyable, CFolder)


def require_tried(flyable: Flyable, waiting: Callable[[], None] = lambda: None) -> None:
    """CheckFailed unless it holds its promises on this computer; once for each in a process."""
    if isinstance(flyable, CFolder):
        require_proof(flyable, waiting)
        return
    from runtime.trial import require_trial

    require_trial(flyable, waiting)


def inputs_of(flyable: Flyable) -> "Sequence[FloatArray] | FloatArray":
    """Observations (T, d) to try it with."""
    return flyable.inputs if isinstance(flyable, CFolder) else flyable.example.observation
