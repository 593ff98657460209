"""What a predictor remembers, and the sizes that a core is built for."""

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Literal

from wakedeploy.core.episodes import whole_steps, window_shape
from wakedeploy.core.errors import UnusableInput


@dataclass(frozen=True)
class Memory:
    """A predictor's one memory: nothing, a window of past snapshots, or carried state tensors.

    Shapes: `states` maps a state's name to its shape without the batch axis; every state starts
    at zero. Units: `stride` is in samples between two neighbouring snapshots of the window.
    """

    kind: Literal["none", "window", "state"]
    k: int = 1
    stride: int = 1
    states: dict[str, tuple[int, ...]] = field(default_factory=dict)

    @property
    def reach(self) -> int:
        """How many samples before the newest a window begins; 0 without a window."""
        return (self.k - 1) * self.stride


@dataclass(frozen=True)
class Sizes:
    """What a core has to fit: d inputs, o outputs, and the domain's window at its rate."""

    inputs: int
    outputs: int
    k: int
    stride: int
    rate_hz: float

    @property
    def window_memory(self) -> Memory:
        """The memory of a window model: K snapshots, `stride` samples apart."""
        return Memory("window", k=self.k, stride=self.stride)

    def looking_back(self, history_s: float | None, snapshots: int | None = None) -> "Sizes":
        """The same with another window; None keeps what the domain says.

        The window spans `history_s` seconds. `snapshots` is how many it has at most, evenly spaced
        over all of it: where the rate does not allow that many so spaced, it has fewer. Raises
        UnusableInput for a `history_s` shorter than a sample, which would be no memory at all.
        """
        if history_s is not None and whole_steps(history_s * self.rate_hz) < 1:
            sample_s = 1.0 / self.rate_hz
            raise UnusableInput(
                f"history_s = {history_s:g} is shorter than the {sample_s:.4g} s from sample to"
                f" sample, at {self.rate_hz:g} Hz; give at least that, or leave it out for the"
                " set's window_s."
            )
        if snapshots is None:
            shape = (self.k, self.stride)
            if history_s is not None:
                shape = window_shape(history_s, self.rate_hz)
            return dataclasses.replace(self, k=shape[0], stride=shape[1])
        steps = (self.k - 1) * self.stride
        if history_s is not None:
            steps = whole_steps(history_s * self.rate_hz)
        stride = max(1, math.ceil(steps / (snapshots - 1)))
        return dataclasses.replace(self, k=steps // stride + 1, stride=stride)

    @property
    def ages_s(self) -> list[float]:
        """Age of each snapshot in seconds, oldest first; the newest has age 0."""
        return [(self.k - 1 - i) * self.stride / self.rate_hz for i in range(self.k)]
