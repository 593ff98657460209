"""Cross-Attention: the present observation asks, the window answers (Vaswani et al. 2017)."""

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn

from trainers.dimensions import HISTORY, WINDOW_FIT, Choice, Dimension, Span
from trainers.memory import Sizes
from trainers.model import WakeModel


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

    def attend(self, window: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Asking token (B, E), values (B, K, H, E/H), weights (B, K, H) that sum to 1 over K."""
        asking = self.embed_query(window[:, -1]) + self.positions[-1]  # (B, E)
        past = self.embed_past(window) + self.positions  # (B, K, E)
        query = self.query(asking).unflatten(1, (1, self.heads, self.width))  # (B, 1, H, E/H)
        key = self.key(past).unflatten(2, (self.heads, self.width))  # (B, K, H, E/H)
        value = self.value(past).unflatten(2, (self.heads, self.width))  # (B, K, H, E/H)
        likeness = (query * key).sum(3) / math.sqrt(self.width)  # (B, K, H)
        return asking, value, torch.softmax(likeness, dim=1)

    def forward(self, window: Tensor) -> Tensor:
        """(B, K, d), oldest first -> (B, o)."""
        asking, value, weights = self.attend(window)
        attended = (weights.unsqueeze(3) * value).sum(1).flatten(1)  # (B, E)
        x = self.norm_attended(asking + self.mix(attended))  # (B, E)
        x = self.norm_fed(x + self.feed_forward(x))  # (B, E)
        force: Tensor = self.head(x)  # (B, o)
        return force


def sinusoids(length: int, width: int) -> Tensor:
    """Fixed positions (length, width), sines then cosines; the last row is the newest sample."""
    ages = torch.arange(length - 1, -1, -1.0).unsqueeze(1)  # (K, 1)
    rates = torch.exp(torch.arange(0, width, 2) * (-math.log(10_000.0) / width))  # (E/2,)
    return torch.cat([torch.sin(ages * rates), torch.cos(ages * rates)], 1)
