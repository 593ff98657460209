"""GRU: a gated recurrent unit between a linear projection and a small head (Cho et al. 2014)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from trainers.architecture import Architecture
from trainers.bounds import DROPOUT, Bound
from trainers.dimensions import SEQUENCE_FIT, Dimension, Span
from trainers.memory import Memory, Sizes
from trainers.model import State, StateModel
from trainers.recurrences.gated import gru_sequence


@dataclass(frozen=True)
class GruHyper:
    """Hyper-parameters; the values are the reference shape d–32–GRU 128–64–o of Table I."""

    projection: int = 32
    hidden: int = 128
    head: int = 64
    dropout: float = 0.0

    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Span("hidden", 16, 192, log=True),
        Span("dropout", 0.0, 0.5),
        *SEQUENCE_FIT,
    )
    bounds: ClassVar[Mapping[str, Bound]] = {"dropout": DROPOUT}


class Gru(StateModel):
    """Carries one hidden vector h (H,)."""

    def __init__(self, sizes: Sizes, hyper: GruHyper) -> None:
        super().__init__()
        self.memory = Memory("state", states={"hidden": (hyper.hidden,)})
        self.projection = nn.Linear(sizes.inputs, hyper.projection)
        self.gru = nn.GRU(hyper.projection, hyper.hidden, batch_first=True)
        self.head = nn.Sequential(
            nn.Linear(hyper.hidden, hyper.head),
            nn.ReLU(),
            nn.Dropout(hyper.dropout),
            nn.Linear(hyper.head, sizes.outputs),
        )

    def forward(self, sequence: Tensor, state: State | None = None) -> tuple[Tensor, State]:
        """(B, T, d), state -> (B, T, o), next state."""
        held = self.initial_state(len(sequence)) if state is None else state
        inputs = self.projection(sequence)  # (B, T, P)
        if sequence.is_cuda:  # there one kernel does all steps
            hidden, last = self.gru(inputs, held["hidden"].unsqueeze(0))  # (B, T, H), (1, B, H)
            return self.head(hidden), {"hidden": last.squeeze(0)}  # (B, T, o)
        unit: Any = self.gru  # torch does not declare the types of its weights
        width = unit.hidden_size
        gates, new_h = unit.bias_hh_l0.split((2 * width, width))  # the gates' only adds to theirs
        bias = unit.bias_ih_l0 + functional.pad(gates, (0, width))
        from_input = functional.linear(inputs.transpose(0, 1), unit.weight_ih_l0, bias)
        history = gru_sequence(from_input, held["hidden"], unit.weight_hh_l0, new_h)
        return self.head(history.transpose(0, 1)), {"hidden": history[-1]}  # (B, T, o)

    def step(self, observation: Tensor, state: State) -> tuple[Tensor, State]:
        """(B, d), state -> (B, o), next state, by the unit's equations with the same weights.

        Written out instead of calling `nn.GRU` on one sample, so that the exported graph is the
        equations themselves: r, z = σ(·), n = tanh(W_n x + r ∘ (U_n h + c)), h ← n + z ∘ (h − n).
        """
        unit: Any = self.gru  # torch does not declare the types of its weights
        hidden = state["hidden"]  # (B, H)
        inputs = self.projection(observation)  # (B, P)
        from_input = functional.linear(inputs, unit.weight_ih_l0, unit.bias_ih_l0)
        from_hidden = functional.linear(hidden, unit.weight_hh_l0, unit.bias_hh_l0)
        reset_x, update_x, new_x = from_input.chunk(3, 1)  # each (B, H)
        reset_h, update_h, new_h = from_hidden.chunk(3, 1)  # each (B, H)
        reset = torch.sigmoid(reset_x + reset_h)  # (B, H)
        update = torch.sigmoid(update_x + update_h)  # (B, H)
        candidate = torch.tanh(new_x + reset * new_h)  # (B, H)
        hidden = candidate + update * (hidden - candidate)  # (B, H)
        return self.head(hidden), {"hidden": hidden}  # (B, o)


ARCHITECTURE = Architecture(Gru, GruHyper, training_s=41, colour="#D55E00", marker="D")
