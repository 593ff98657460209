"""What a predictor remembers, and the sizes that a core is built for."""

from dataclasses import dataclass, field
from typing import Literal


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

    @property
    def ages_s(self) -> list[float]:
        """Age of each snapshot in seconds, oldest first; the newest has age 0."""
        return [(self.k - 1 - i) * self.stride / self.rate_hz for i in range(self.k)]
