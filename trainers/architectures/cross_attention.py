"""Cross-Attention: the present observation asks, the window answers (Vaswani et al. 2017)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn

from trainers.architecture import Architecture
from trainers.bounds import SECONDS, Bound
from trainers.dimensions import HISTORY, WINDOW_FIT, Choice, Dimension, Span
from trainers.memory import Sizes
from trainers.model import WakeModel
from wakedeploy.core.errors import UnusableInput


@dataclass(frozen=True)
class CrossAttentionHyper:
    """Hyper-parameters; the values are the reference shape of Table I.

    The window spans `history_s` seconds, None the domain's.
    """

    embed: int = 32
    heads: int = 4
    feed_forward: int = 128
    head: int = 64
    history_s: float | None = None

    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Span("embed", 8, 96, step=8),
        Choice("heads", (1, 2, 4, 8)),
        HISTORY,
        *WINDOW_FIT,
    )
    bounds: ClassVar[Mapping[str, Bound]] = {"history_s": SECONDS}

    def __post_init__(self) -> None:
        """Every head has its share of the width; half of the positions are sines, half cosines."""
        step = math.lcm(2, self.heads)
        if self.embed % step:
            raise UnusableInput(
                f"cross-attention: embed = {self.embed} with heads = {self.heads} has to be a"
                f" multiple of {step}."
            )


class CrossAttention(WakeModel):
    """Maps a window to the force: (B, K, d) -> (B, o)."""

    positions: Tensor

    def __init__(self, sizes: Sizes, hyper: CrossAttentionHyper) -> None:
        super().__init__()
        sizes = sizes.looking_back(hyper.history_s)
        self.memory = sizes.window_memory
        self.heads, embed = hyper.heads, hyper.embed
        self.width = embed // self.heads  # of one head
        self.register_buffer("positions", sinusoids(sizes.k, embed), persistent=False)
        self.embed_query = nn.Linear(sizes.inputs, embed)
        self.embed_past = nn.Linear(sizes.inputs, embed)
        self.query = nn.Linear(embed, embed)
        self.key = nn.Linear(embed, embed)
        self.value = nn.Linear(embed, embed)
        self.mix = nn.Linear(embed, embed)
        self.norm_attended = nn.LayerNorm(embed)
        self.feed_forward = nn.Sequential(
            nn.Linear(embed, hyper.feed_forward),
            nn.ReLU(),
            nn.Linear(hyper.feed_forward, embed),
        )
        self.norm_fed = nn.LayerNorm(embed)
        self.head = nn.Sequential(
            nn.Linear(embed, hyper.head), nn.ReLU(), nn.Linear(hyper.head, sizes.outputs)
        )

    def attend(self, window: Tensor) -> tuple[Tensor, Tensor]:
        """Asking token (B, E) and the weights (B, H, K) of the snapshots, which sum to 1 over K.

        Keys are linear in their snapshots and positions, so that the query is taken through the
        weights once instead of every snapshot. Biases of keys and of the embedding add the same to
        all snapshots and fall out of the softmax.
        """
        _, past, inputs = window.shape
        asking = self.embed_query(window[:, -1]) + self.positions[-1]  # (B, E)
        query = self.query(asking) / math.sqrt(self.width)  # (B, E)
        query = query.unflatten(1, (self.heads, self.width))  # (B, H, E/H)
        asked = _each_by_its_own(query, self._of_past(self.key))  # (B, H, d + K)
        of_observations, of_positions = torch.split(asked, [inputs, past], 2)
        likeness = of_observations @ window.transpose(1, 2) + of_positions  # (B, H, K)
        return asking, torch.softmax(likeness, dim=2)

    def forward(self, window: Tensor) -> Tensor:
        """(B, K, d), oldest first -> (B, o)."""
        asking, weights = self.attend(window)
        # Values are linear too: the value of the mean snapshot instead of the mean of all values.
        past = torch.cat([weights @ window, weights], 2)  # (B, H, d + K)
        value = _each_by_its_own(past, self._of_past(self.value).transpose(1, 2))  # (B, H, E/H)
        bias = self.value(self.embed_past.bias)  # (E,)
        x = self.norm_attended(asking + self.mix(value.flatten(1) + bias))  # (B, E)
        x = self.norm_fed(x + self.feed_forward(x))  # (B, E)
        force: Tensor = self.head(x)  # (B, o)
        return force

    def _of_past(self, linear: nn.Linear) -> Tensor:
        """Its weights by head, taken back to an observation and a position: (H, E/H, d + K)."""
        embedded = torch.cat([self.embed_past.weight, self.positions.t()], 1)  # (E, d + K)
        return (linear.weight @ embedded).view(self.heads, self.width, -1)


def _each_by_its_own(vectors: Tensor, matrices: Tensor) -> Tensor:
    """Each head's vectors times its own matrix: (B, H, m), (H, m, n) -> (B, H, n)."""
    return (vectors.transpose(0, 1) @ matrices).transpose(0, 1)


def sinusoids(length: int, width: int) -> Tensor:
    """Fixed positions (length, width), sines then cosines; the last row is the newest sample."""
    ages = torch.arange(length - 1, -1, -1.0).unsqueeze(1)  # (K, 1)
    rates = torch.exp(torch.arange(0, width, 2) * (-math.log(10_000.0) / width))  # (E/2,)
    return torch.cat([torch.sin(ages * rates), torch.cos(ages * rates)], 1)


ARCHITECTURE = Architecture(
    CrossAttention, CrossAttentionHyper, training_s=19, colour="#6A3D9A", marker="p"
)
