"""TCN: residual blocks of causal dilated convolutions (Bai, Kolter & Koltun 2018).

As a stream each convolution keeps a ring of its last (kernel − 1)·dilation input frames. It is the
left context of whole sequences, so nothing is padded twice and a sequence may be cut anywhere. For
a single sample the kernel's frames are picked from it and one matrix product is all there is to a
convolution.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from trainers.architecture import Architecture
from trainers.bounds import DROPOUT, Bound
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
    bounds: ClassVar[Mapping[str, Bound]] = {
        "kernel": Bound(2, 64),  # of one tap nothing is carried
        "blocks": Bound(1, 12),  # the dilation doubles with each
        "dropout": DROPOUT,
    }


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

    def step(self, observation: Tensor, state: State) -> tuple[Tensor, State]:
        """(B, d), state -> (B, o), next state."""
        rings: State = {}
        frame = observation  # (B, d)
        shortcut = self.shortcut(frame.unsqueeze(2)).squeeze(2)  # (B, C)
        for first in range(0, len(self.convolutions), 2):
            inner = self._convolve_newest(first, frame, state, rings)  # (B, C)
            outer = self._convolve_newest(first + 1, inner, state, rings)  # (B, C)
            frame = torch.relu(outer + shortcut)  # (B, C)
            shortcut = frame
        return self.readout(frame), rings  # (B, o)

    def _convolve_newest(self, index: int, frame: Tensor, held: State, rings: State) -> Tensor:
        """What `_convolve` gives for the newest frame alone, (B, C) -> (B, C)."""
        name, kernel = f"ring_{index}", cast(nn.Conv1d, self.convolutions[index])
        context = torch.cat([held[name], frame.unsqueeze(2)], 2)  # (B, C, R + 1)
        rings[name] = context[:, :, 1:]  # (B, C, R)
        taps = context[:, :, :: kernel.dilation[0]]  # (B, C, kernel)
        summed = functional.linear(taps.flatten(1), kernel.weight.flatten(1), kernel.bias)  # (B, C)
        convolved: Tensor = self.dropout(torch.relu(summed))  # (B, C)
        return convolved

    def _convolve(self, index: int, frames: Tensor, held: State, rings: State) -> Tensor:
        """One causal convolution with ReLU and dropout; leaves its next ring in `rings`."""
        name = f"ring_{index}"
        kept = self.memory.states[name][1]
        context = torch.cat([held[name], frames], 2)  # (B, C, R + T)
        rings[name] = context[:, :, -kept:]  # (B, C, R)
        convolved: Tensor = self.dropout(torch.relu(self.convolutions[index](context)))  # (B, C, T)
        return convolved


ARCHITECTURE = Architecture(Tcn, TcnHyper, training_s=36, colour="#0072B2", marker="v")
