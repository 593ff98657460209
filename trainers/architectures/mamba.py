"""Mamba: one selective state-space block (Gu & Dao 2023; equations in the project's paper notes).

[x, z] = W_in u; x ← silu(causal convolution over the last 4 x); (δ, B, C) = W_x x;
Δ = softplus(W_dt δ + b); h ← e^{ΔA} ∘ h + (ΔB) ∘ x with A = −e^{A_log}; y = C·h + D ∘ x;
out = W_out (y ∘ silu z); RMSNorm before and after, residual around the block.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from trainers.architecture import Architecture
from trainers.bounds import Bound
from trainers.dimensions import SEQUENCE_FIT, Dimension, Span
from trainers.memory import Memory, Sizes
from trainers.model import State, StateModel
from trainers.recurrences.linear import linear_recurrence


@dataclass(frozen=True)
class MambaHyper:
    """Hyper-parameters; the values are the reference shape of Table I."""

    d_model: int = 32
    d_state: int = 8
    d_conv: int = 4
    expand: int = 2
    dt_rank: int = 2

    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Span("d_model", 8, 96, log=True),
        Span("d_state", 2, 32, log=True),
        Span("d_conv", 2, 8),
        *SEQUENCE_FIT,
    )
    bounds: ClassVar[Mapping[str, Bound]] = {
        "d_conv": Bound(2, 64)
    }  # of one tap nothing is carried

    @property
    def d_inner(self) -> int:
        """Channels inside the block."""
        return self.expand * self.d_model


class RmsNorm(nn.Module):
    """x / rms(x) with a gain per channel, in plain operations that every exporter knows."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.gain = nn.Parameter(torch.ones(width))

    def forward(self, x: Tensor) -> Tensor:
        """(…, width) -> (…, width)."""
        return x * torch.rsqrt(x.square().mean(-1, keepdim=True) + 1e-5) * self.gain


class Mamba(StateModel):
    """Carries h (E, N) and the last d_conv − 1 inputs of the convolution (E, d_conv − 1)."""

    def __init__(self, sizes: Sizes, hyper: MambaHyper) -> None:
        super().__init__()
        inner, self.rank, self.order = hyper.d_inner, hyper.dt_rank, hyper.d_state
        self.memory = Memory(
            "state", states={"h": (inner, self.order), "conv": (inner, hyper.d_conv - 1)}
        )
        self.embed = nn.Linear(sizes.inputs, hyper.d_model)
        self.norm_before = RmsNorm(hyper.d_model)
        self.w_in = nn.Linear(hyper.d_model, 2 * inner, bias=False)
        self.conv = nn.Conv1d(inner, inner, hyper.d_conv, groups=inner)
        self.w_x = nn.Linear(inner, self.rank + 2 * self.order, bias=False)
        self.w_dt = nn.Linear(self.rank, inner)
        self.a_log = nn.Parameter(torch.arange(1.0, self.order + 1).log().repeat(inner, 1))
        self.skip = nn.Parameter(torch.ones(inner))
        self.w_out = nn.Linear(inner, hyper.d_model, bias=False)
        self.norm_after = RmsNorm(hyper.d_model)
        self.readout = nn.Linear(hyper.d_model, sizes.outputs)
        self._start_time_steps()

    def forward(self, sequence: Tensor, state: State | None = None) -> tuple[Tensor, State]:
        """(B, T, d), state -> (B, T, o), next state; the recurrence by a parallel scan."""
        held = self.initial_state(len(sequence)) if state is None else state
        u = self.embed(sequence)  # (B, T, M)
        x, z = self.w_in(self.norm_before(u)).chunk(2, -1)  # (B, T, E) each
        context = torch.cat([held["conv"], x.transpose(1, 2)], 2)  # (B, E, 3 + T)
        x = functional.silu(self.conv(context)).permute(2, 0, 1)  # (T, B, E)
        decay, drive, c = self._select(x)  # (T, B, E, N), (T, B, E, N), (T, B, N)
        first = drive[:1] + decay[:1] * held["h"]  # (1, B, E, N)
        h = linear_recurrence(decay, torch.cat([first, drive[1:]]))  # (T, B, E, N)
        y = (h @ c.unsqueeze(-1)).squeeze(-1) + self.skip * x  # (T, B, E)
        force = self._finish(u, y.transpose(0, 1), z)  # (B, T, o)
        return force, {"h": h[-1], "conv": context[:, :, -held["conv"].shape[2] :]}

    def step(self, observation: Tensor, state: State) -> tuple[Tensor, State]:
        """(B, d), state -> (B, o), next state; one turn of the recurrence itself."""
        u = self.embed(observation)  # (B, M)
        x, z = self.w_in(self.norm_before(u)).chunk(2, -1)  # (B, E) each
        context = torch.cat([state["conv"], x.unsqueeze(2)], 2)  # (B, E, 4)
        taps, bias = self.conv.weight.squeeze(1), self.conv.bias  # (E, 4), (E,)
        assert bias is not None
        x = functional.silu((context * taps).sum(2) + bias)  # (B, E)
        decay, drive, c = self._select(x)  # (B, E, N), (B, E, N), (B, N)
        h = decay * state["h"] + drive  # (B, E, N)
        y = (h * c.unsqueeze(1)).sum(-1) + self.skip * x  # (B, E)
        return self._finish(u, y, z), {"h": h, "conv": context[:, :, 1:]}  # (B, o)

    def _select(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """What the input decides: decay e^{ΔA}, drive (ΔB) ∘ x, both (…, E, N), and C (…, N)."""
        delta, b, c = self.w_x(x).split([self.rank, self.order, self.order], -1)
        dt = functional.softplus(self.w_dt(delta))  # (…, E)
        decay = torch.exp(dt.unsqueeze(-1) * -self.a_log.exp())  # (…, E, N)
        return decay, (dt * x).unsqueeze(-1) * b.unsqueeze(-2), c

    def _finish(self, u: Tensor, y: Tensor, z: Tensor) -> Tensor:
        """Gate, residual, norm, readout: (…, M), (…, E), (…, E) -> (…, o)."""
        out = u + self.w_out(y * functional.silu(z))  # (…, M)
        force: Tensor = self.readout(self.norm_after(out))  # (…, o)
        return force

    def _start_time_steps(self) -> None:
        """Δ starts log-uniform between 0.001 and 0.1, as in the reference (Gu & Dao)."""
        nn.init.uniform_(self.w_dt.weight, -(self.rank**-0.5), self.rank**-0.5)
        low, high = math.log(0.001), math.log(0.1)
        dt = torch.exp(low + (high - low) * torch.rand(self.w_dt.out_features))
        with torch.no_grad():
            self.w_dt.bias.copy_(dt + torch.log(-torch.expm1(-dt)))  # softplus⁻¹


ARCHITECTURE = Architecture(
    Mamba, MambaHyper, learning_rate=1e-2, training_s=39, colour="#CC79A7", marker="P"
)
