"""TCN: residual blocks of causal dilated convolutions (Bai, Kolter & Koltun 2018).

As a stream each convolution keeps a ring of its last (kernel − 1)·dilation input frames. The same
code runs whole sequences and single samples: the ring is the left context, so nothing is padded
twice and a sequence may be cut anywhere.
"""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn

from trainers.dimensions import SEQUENCE_FIT, Dimension, Span
from trainers.memory import Memory, Sizes
from trainers.model import State, StateModel


@dataclass(frozen=True)
class TcnHyper:
    """Hyper-parameters; the values are the reference shape of Table I (receptive field 379)."""

    channels: int = 40
    kernel: int = 4
    blocks: int = 6
    dropout: float = 0.0

    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Span("blocks", 2, 8),
        Span("kernel", 2, 8),
        Span("dropout", 0.0, 0.5),
        *SEQUENCE_FIT,
    )


class Tcn(StateModel):
    """Carries one ring per convolution, `ring_0` first: (channels, (kernel − 1)·dilation)."""

    def __init__(self, sizes: Sizes, hyper: TcnHyper) -> None:
        super().__init__()
        widths = [sizes.inputs] + [hyper.channels] * (2 * hyper.blocks)
        dilations = [2 ** (i // 2) for i in range(2 * hyper.blocks)]
        shapes = [(c, (hyper.kernel - 1) * d) for c, d in zip(widths, dilations, strict=False)]
        self.memory = Memory("state", states={f"ring_{i}": s for i, s in enumerate(shapes)})
        self.convolutions = nn.ModuleList(
            nn.Conv1d(widths[i], widths[i + 1], hyper.kernel, dilation=dilations[i])
            for i in range(2 * hyper.blocks)
        )
        self.shortcut = nn.Conv1d(sizes.inputs, hyper.channels, 1)
        self.dropout = nn.Dropout(hyper.dropout)
        self.readout = nn.Linear(hyper.channels, sizes.outputs)

    def forward(self, sequence: Tensor, state: State | None = None) -> tuple[Tensor, State]:
        """(B, T, d), state -> (B, T, o), next state."""
        held = self.initial_state(len(sequence)) if state is None else state
        rings: State = {}
        frames = sequence.transpose(1, 2)  # (B, d, T)
        shortcut = self.shortcut(frames)  # (B, C, T)
        for first in range(0, len(self.convolutions), 2):
            inner = self._convolve(first, frames, held, rings)  # (B, C, T)
            outer = self._convolve(first + 1, inner, held, rings)  # (B, C, T)
            frames = torch.relu(outer + shortcut)  # (B, C, T)
            shortcut = frames
        return self.readout(frames.transpose(1, 2)), rings  # (B, T, o)

    def _convolve(self, index: int, frames: Tensor, held: State, rings: State) -> Tensor:
        """One causal convolution with ReLU and dropout; leaves its next ring in `rings`."""
        name = f"ring_{index}"
        kept = self.memory.states[name][1]
        context = torch.cat([held[name], frames], 2)  # (B, C, R + T)
        rings[name] = context[:, :, -kept:]  # (B, C, R)
        convolved: Tensor = self.dropout(torch.relu(self.convolutions[index](context)))  # (B, C, T)
        return convolved
