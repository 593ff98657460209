"""Multiply-adds of a training, counted from the shapes that a core's layers see."""

from typing import Any

from torch import Tensor, nn
from torch.utils.hooks import RemovableHandle

from trainers.architectures.cross_attention import CrossAttention
from trainers.architectures.delay_embedding import DelayEmbedding
from trainers.architectures.gru import Gru
from trainers.architectures.mamba import Mamba
from trainers.model import WakeModel


class MultiplyAdds:
    """Counts multiply-adds of a core's training from the shapes that its layers see.

    A matrix of W weights takes W for each row that goes through; the backward pass takes W a row
    for the weights' gradient and, unless the layer stands first, W for its input's. What has no
    weights is added by architecture: Mamba's recurrence, the weighing of a window.
    """

    def __init__(self, core: WakeModel) -> None:
        self.core, self.count = core, 0
        self._hooks: list[RemovableHandle] = []

    def __enter__(self) -> "MultiplyAdds":
        for module in self.core.modules():
            if isinstance(module, nn.Linear | nn.Conv1d | nn.GRU):
                self._hooks.append(module.register_forward_hook(self._layer))
        self._hooks.append(self.core.register_forward_hook(self._no_layer))
        return self

    def __exit__(self, *_: object) -> None:
        for hook in self._hooks:
            hook.remove()

    def _layer(self, module: nn.Module, inputs: tuple[Tensor, ...], output: Any) -> None:
        given = output[0] if isinstance(module, nn.GRU) else output
        rows = given.numel() // given.shape[1 if isinstance(module, nn.Conv1d) else -1]
        weights = sum(p.numel() for p in module.parameters() if p.dim() > 1)
        self.count += rows * weights * (3 if inputs[0].requires_grad else 2)

    def _no_layer(self, core: nn.Module, inputs: tuple[Tensor, ...], output: Any) -> None:
        samples = inputs[0].shape[0] * (inputs[0].shape[1] if inputs[0].dim() > 2 else 1)
        each = 0
        if isinstance(core, Gru):  # its own way through a sequence, past the module that it keeps
            each = sum(p.numel() for p in core.gru.parameters() if p.dim() > 1)
        elif isinstance(core, Mamba):
            each = 3 * core.a_log.numel()  # decay ∘ h + drive, dt·x ∘ B, C·h
        elif isinstance(core, DelayEmbedding):
            each = inputs[0].shape[2]  # weights·observation
        elif isinstance(core, CrossAttention):
            self._attention(core, *inputs[0].shape)
        self.count += 3 * samples * each

    def _attention(self, core: CrossAttention, batch: int, k: int, d: int) -> None:
        """Keys and values: their weights once, queries and means through those, then the window."""
        embed = core.heads * core.width
        seen = d + k  # an observation, and which of the window's positions
        self.count += 2 * 3 * embed * embed * seen
        given = 2 * core.heads * k * d  # of the window, which needs no gradient
        self.count += batch * (3 * 2 * embed * seen + 2 * given)
