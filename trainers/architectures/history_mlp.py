"""History MLP: an evenly spaced window of snapshots, flattened (Bourlard & Kamp 1988)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from trainers.architecture import Architecture
from trainers.architectures.agile_mlp import mlp
from trainers.bounds import LAYERS, SECONDS, Bound
from trainers.dimensions import HISTORY, WINDOW_FIT, Dimension, Span
from trainers.memory import Sizes
from trainers.model import WakeModel


@dataclass(frozen=True)
class HistoryMlpHyper:
    """Hyper-parameters; the values are the reference shape K·d–128–128–o of Table I.

    The window spans `history_s` seconds (None: the domain's) in at most `snapshots` (None: as many
    as the domain's window has).
    """

    hidden: int = 128
    layers: int = 2
    history_s: float | None = None
    snapshots: int | None = None

    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Span("snapshots", 4, 48),
        Span("hidden", 16, 256, log=True),
        HISTORY,
        *WINDOW_FIT,
    )
    bounds: ClassVar[Mapping[str, Bound]] = {
        "layers": LAYERS,
        "history_s": SECONDS,
        "snapshots": Bound(2, 1000, whole=True),
    }


class HistoryMlp(WakeModel):
    """Maps a flattened window to the force: (B, K, d) -> (B, o)."""

    def __init__(self, sizes: Sizes, hyper: HistoryMlpHyper) -> None:
        super().__init__()
        sizes = sizes.looking_back(hyper.history_s, hyper.snapshots)
        self.memory = sizes.window_memory
        self.net = mlp(sizes.k * sizes.inputs, hyper.hidden, hyper.layers, sizes.outputs)

    def forward(self, window: Tensor) -> Tensor:
        """(B, K, d), oldest first -> (B, o)."""
        force: Tensor = self.net(window.flatten(1))  # (B, o)
        return force


ARCHITECTURE = Architecture(
    HistoryMlp, HistoryMlpHyper, training_s=11, colour="#E69F00", marker="o"
)
