"""Delay Embedding: a selector looks at the window and says when to look back to.

A Gaussian kernel over the ages of the snapshots, centre μ and width σ in seconds, weighs the past
observations; the head sees the present and the delayed one (Yang et al. 2019; paper, § Delay
Embedding).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn

from trainers.architecture import Architecture
from trainers.architectures.agile_mlp import mlp
from trainers.bounds import LAYERS, SECONDS, Bound
from trainers.dimensions import HISTORY, WINDOW_FIT, Dimension, Span
from trainers.memory import Sizes
from trainers.model import WakeModel

_NARROWEST = 0.1  # of the time between snapshots
_WIDEST = 100.0  # windows


@dataclass(frozen=True)
class DelayEmbeddingHyper:
    """Hyper-parameters; the widths are the reference shape of Table I.

    Units: seconds. `initial_delay_s` is μ₀ at the start of training: where it starts decides what
    it converges to on periodic data; None means half the window. `initial_spread_s` is σ₀, None
    an eighth of the window. Snapshots younger than `gap_s` are masked; None masks the present one
    only. The window spans `history_s`, None the domain's.
    """

    selector: int = 64
    hidden: int = 128
    layers: int = 2
    initial_delay_s: float | None = None
    initial_spread_s: float | None = None
    gap_s: float | None = None
    history_s: float | None = None

    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Span("initial_delay_s", 0.0, 1.0, of_window=True),
        Span("initial_spread_s", 0.02, 0.5, log=True, of_window=True),
        Span("selector", 8, 128, log=True),
        HISTORY,
        *WINDOW_FIT,
    )
    bounds: ClassVar[Mapping[str, Bound]] = {
        "layers": LAYERS,
        "initial_delay_s": SECONDS,
        "initial_spread_s": SECONDS,
        "gap_s": SECONDS,
        "history_s": SECONDS,
    }


class DelayEmbedding(WakeModel):
    """Maps a window to the force through one delayed observation: (B, K, d) -> (B, o)."""

    ages_s: Tensor

    def __init__(self, sizes: Sizes, hyper: DelayEmbeddingHyper) -> None:
        super().__init__()
        sizes = sizes.looking_back(hyper.history_s)
        self.memory = sizes.window_memory
        ages_s = sizes.ages_s
        gap_s = min(hyper.gap_s if hyper.gap_s is not None else 1e-9, ages_s[0])
        self.past = sum(age_s >= gap_s for age_s in ages_s)  # how many snapshots may be chosen
        apart_s = sizes.stride / sizes.rate_hz
        self.spreads_s = _NARROWEST * apart_s, _WIDEST * max(ages_s[0], apart_s)  # the bounds of σ
        self.register_buffer("ages_s", torch.tensor(ages_s[: self.past]), persistent=False)
        self.delay_s = nn.Parameter(torch.tensor(_or(hyper.initial_delay_s, ages_s[0] / 2)))
        spread_s = max(_or(hyper.initial_spread_s, ages_s[0] / 8), 1 / sizes.rate_hz)
        self.log_spread = nn.Parameter(torch.tensor(spread_s).log())
        self.selector = mlp(sizes.k * sizes.inputs, hyper.selector, 1, 2)
        self.head = mlp(2 * sizes.inputs, hyper.hidden, hyper.layers, sizes.outputs)
        _start_at_zero(self.selector)

    def kernel(self, window: Tensor) -> tuple[Tensor, Tensor]:
        """The delay μ and the width σ chosen for each window, in seconds: (B, K, d) -> (B, 1)."""
        shift = self.selector(window.flatten(1))  # (B, 2)
        delay_s = self.delay_s + shift[:, :1]  # (B, 1)
        log_spread = self.log_spread + shift[:, 1:]  # (B, 1)
        # Far narrower than the snapshots stand apart, every weight would be 0 over 0; far wider
        # than the window all are alike, and e to the 89 is no float32 any more.
        narrowest, widest = (math.log(s) for s in self.spreads_s)
        log_spread = torch.where(log_spread > narrowest, log_spread, narrowest)
        return delay_s, torch.where(log_spread > widest, widest, log_spread).exp()  # (B, 1)

    def weigh(self, delay_s: Tensor, spread_s: Tensor) -> Tensor:
        """Kernels as weights of the past snapshots, which sum to 1: (B, 1), (B, 1) -> (B, P)."""
        distance = (self.ages_s - delay_s) / spread_s  # (B, P)
        return torch.softmax(-0.5 * distance.square(), dim=1)

    def forward(self, window: Tensor) -> Tensor:
        """(B, K, d), oldest first -> (B, o)."""
        weights = self.weigh(*self.kernel(window))  # (B, P)
        delayed = (weights.unsqueeze(2) * window[:, : self.past]).sum(1)  # (B, d)
        force: Tensor = self.head(torch.cat([window[:, -1], delayed], 1))  # (B, o)
        return force


def _or(value: float | None, default: float) -> float:
    return default if value is None else float(value)


def _start_at_zero(selector: nn.Sequential) -> None:
    """Let training begin exactly at μ₀ and σ₀, whatever the window holds."""
    last = selector[-1]
    assert isinstance(last, nn.Linear)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)


ARCHITECTURE = Architecture(
    DelayEmbedding, DelayEmbeddingHyper, training_s=16, colour="#56B4E9", marker="^"
)
