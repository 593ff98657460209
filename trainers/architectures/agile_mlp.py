"""Agile MLP: the present observation alone, two hidden layers (the memoryless baseline)."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

from torch import Tensor, nn

from trainers.architecture import Architecture
from trainers.bounds import LAYERS, Bound
from trainers.dimensions import WINDOW_FIT, Dimension, Span
from trainers.memory import Memory, Sizes
from trainers.model import WakeModel
from wakedeploy.core import figures


@dataclass(frozen=True)
class AgileMlpHyper:
    """Hyper-parameters; the values are the reference shape d–128–128–o of Table I."""

    hidden: int = 128
    layers: int = 2

    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Span("layers", 1, 4),
        Span("hidden", 16, 256, log=True),
        *WINDOW_FIT,
    )
    bounds: ClassVar[Mapping[str, Bound]] = {"layers": LAYERS}


def mlp(inputs: int, hidden: int, layers: int, outputs: int) -> nn.Sequential:
    """`layers` hidden layers of width `hidden` with ReLU, then a linear output."""
    widths = [inputs] + [hidden] * layers
    stack: list[nn.Module] = []
    for width, next_width in pairwise(widths):
        # In place: one array less to write.
        stack += [nn.Linear(width, next_width), nn.ReLU(inplace=True)]
    return nn.Sequential(*stack, nn.Linear(widths[-1], outputs))


class AgileMlp(WakeModel):
    """Maps one observation to the force: (B, d) -> (B, o)."""

    def __init__(self, sizes: Sizes, hyper: AgileMlpHyper) -> None:
        super().__init__()
        self.memory = Memory("none")
        self.net = mlp(sizes.inputs, hyper.hidden, hyper.layers, sizes.outputs)

    def forward(self, observation: Tensor) -> Tensor:
        """(B, d) -> (B, o)."""
        force: Tensor = self.net(observation)  # (B, o)
        return force


ARCHITECTURE = Architecture(AgileMlp, AgileMlpHyper, training_s=4, colour=figures.LIMIT, marker="s")
