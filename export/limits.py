"""What a package's force is limited to: what is possible by its manifest, and no further.

Where a predictor is asked for what it has not seen, a reservoir most of all, its force may be
anything. The exported graph ends in these limits, so that whoever runs it, and however, gets a
force that the training episodes make possible, or one at a limit, which is none.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from wakedeploy.core.manifest import FloatArray, ForceChannel, Quantity


class Limits(nn.Module):
    """The limits inside the graph, by comparisons: a force that is no number stays none."""

    low: Tensor
    high: Tensor

    def __init__(self, force: Sequence[ForceChannel]) -> None:
        super().__init__()
        self.register_buffer("low", torch.tensor([channel.low for channel in force]))
        self.register_buffer("high", torch.tensor([channel.high for channel in force]))

    def forward(self, force: Tensor) -> Tensor:
        """(B, o) -> (B, o)."""
        below = torch.where(force > self.high, self.high, force)
        return torch.where(self.low > below, self.low, below)


def limited(force: FloatArray, channels: Sequence[ForceChannel]) -> FloatArray:
    """The same for the training-time forward's series (T, o)."""
    low, high = ([getattr(c, end) for c in channels] for end in ("low", "high"))
    kept: FloatArray = np.clip(force, np.array(low, force.dtype), np.array(high, force.dtype))
    return kept


def force_channels(
    quantities: Sequence[Quantity], forces: Sequence[FloatArray]
) -> tuple[ForceChannel, ...]:
    """The force channels with the range that each takes in some series, (T, o) each."""
    low = np.min([force.min(axis=0) for force in forces], axis=0)  # (o,)
    high = np.max([force.max(axis=0) for force in forces], axis=0)  # (o,)
    return tuple(
        ForceChannel(name=q.name, unit=q.unit, min=float(low[i]), max=float(high[i]))
        for i, q in enumerate(quantities)
    )
