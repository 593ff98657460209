"""A gated recurrent unit over a whole sequence, with its gradient written out.

torch's own backward pass on a CPU adds each step's small gradient to the weights. The adjoint
below carries only what has to be carried, the gradient of h; everything else is one operation over
all steps, the weights' gradient a single matrix product.
"""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable


def gru_sequence(from_input: Tensor, hidden: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """All of h_1 … h_T, differentiable once: r, z = σ(·), n = tanh(·), h ← n + z ∘ (h − n).

    Shapes: from_input (T, B, 3H), what the input adds to r, z and n before their nonlinearity;
    hidden h_0 (B, H); weight (3H, H) and bias (3H,) of the recurrence -> (T, B, H). Gates stand in
    torch's order, so that `nn.GRU` holds the weights.
    """
    history: Tensor = _GruSequence.apply(from_input, hidden, weight, bias)  # type: ignore[no-untyped-call]
    return history


class _GruSequence(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, from_input: Tensor, hidden: Tensor, weight: Tensor, bias: Tensor) -> Any:
        steps, batch, width = len(from_input), *hidden.shape
        history = hidden.new_empty(steps + 1, batch, width)
        gates = hidden.new_empty(steps, batch, 2 * width)  # r, z
        candidate = hidden.new_empty(steps, batch, width)  # n
        recurrent = hidden.new_empty(steps, batch, 3 * width)  # what h adds to r, z and n
        history[0] = hidden
        across = weight.t().contiguous()
        for t, x in enumerate(from_input.unbind()):
            h, gate, n, added = history[t], gates[t], candidate[t], recurrent[t]
            torch.addmm(bias, h, across, out=added)
            torch.add(x[:, : 2 * width], added[:, : 2 * width], out=gate).sigmoid_()
            reset, update = gate[:, :width], gate[:, width:]
            torch.addcmul(x[:, 2 * width :], reset, added[:, 2 * width :], out=n).tanh_()
            torch.lerp(n, h, update, out=history[t + 1])
        ctx.save_for_backward(history, gates, candidate, recurrent[:, :, 2 * width :], weight)
        return history[1:]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        history, gates, candidate, candidate_h, weight = ctx.saved_tensors
        reset, update = gates.chunk(2, 2)  # (T, B, H) each
        before = history[:-1]
        # Factors of h's gradient: what enters n before tanh, and r, z and n through the weights.
        into_n = (1 - update) * (1 - candidate.square())
        factors = candidate.new_empty(*before.shape[:2], 3, before.shape[2])  # (T, B, 3, H)
        torch.mul(into_n * candidate_h, reset * (1 - reset), out=factors[:, :, 0])
        torch.mul(before - candidate, update * (1 - update), out=factors[:, :, 1])
        torch.mul(into_n, reset, out=factors[:, :, 2])
        carried = torch.empty_like(candidate)  # the gradient of each h_t
        through = torch.empty_like(factors)
        flat = through.flatten(2)  # (T, B, 3H)
        onward = torch.zeros_like(history[0])
        for t in reversed(range(len(candidate))):
            torch.add(gradients[0][t], onward, out=carried[t])
            torch.mul(carried[t].unsqueeze(1), factors[t], out=through[t])
            onward = torch.addmm(carried[t] * update[t], flat[t], weight)
        rows = flat.flatten(0, 1)  # (T·B, 3H)
        inputs = torch.cat([through[:, :, :2].flatten(2), carried * into_n], 2)  # (T, B, 3H)
        return inputs, onward, rows.t() @ before.flatten(0, 1), rows.sum(0)
