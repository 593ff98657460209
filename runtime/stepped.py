"""What every runner of a predictor shares: what it says of itself, and the order of a step."""

import abc

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.manifest import FloatArray, Manifest
from wakedeploy.core.observations import real_numbers


class SteppedPredictor(abc.ABC):
    """A predictor that is stepped through time, `batch` independent series in lockstep.

    NaN in or out is passed on: what to do about it is the caller's decision.
    """

    def __init__(self, manifest: Manifest, batch: int) -> None:
        self.manifest, self.batch = manifest, batch
        d, outputs = len(manifest.observation), len(manifest.force)
        self._shapes = {(batch, d)} | ({(d,)} if batch == 1 else set())
        self._force: FloatArray = np.empty((batch, outputs), np.float32)
        self._seen = 0

    @property
    def warm_up_steps(self) -> int:
        """The step, counted from 1 after a reset, whose force is the first that counts."""
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
        self._forget()

    def step(self, observation: npt.ArrayLike) -> FloatArray:
        """The force, float32 (o,), for the newest observation (d,); with a batch (B, o), (B, d).

        Channels and their units are the manifest's. Raises UnusableInput for another shape and what
        is no number, CheckFailed where the step cannot be computed.
        """
        try:
            newest = real_numbers(observation)
        except ValueError as error:
            raise UnusableInput(self._refusal(one_line(error))) from error
        if newest.shape not in self._shapes:
            raise UnusableInput(self._refusal(f"it has shape {newest.shape}"))
        self._compute(newest)
        self._seen += 1
        return self._force[0].copy() if newest.ndim == 1 else self._force.copy()

    @abc.abstractmethod
    def _forget(self) -> None:
        """Let the memory be as it was before the first step."""

    @abc.abstractmethod
    def _compute(self, newest: npt.NDArray[np.generic]) -> None:
        """Take the observation in, leave the force in `_force`; `_seen` steps came before."""

    def _refusal(self, why: str) -> str:
        d = len(self.manifest.observation)
        expected = (d,) if self.batch == 1 else (self.batch, d)
        names = ", ".join(channel.name for channel in self.manifest.observation)
        return f"The observation cannot be used ({why}); give shape {expected}: {names}."
