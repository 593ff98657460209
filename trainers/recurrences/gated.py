"""A gated recurrent unit over a whole sequence, with its gradient written out.

torch's own backward pass on a CPU adds each step's small gradient to the weights. The adjoint
below carries only what has to be carried, the gradient of h. The weights' gradient is a single
matrix product over all steps, and what else is needed is made for a few steps at once, which a
core's own cache holds.
"""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

_BLOCK = 8  # steps whose factors are made at once: as many as stay in a core's own cache


def gru_sequence(from_input: Tensor, hidden: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """All of h_1 … h_T, differentiable once: r, z = σ(·), n = tanh(·), h ← n + z ∘ (h − n).

    Shapes: from_input (T, B, 3H), what input and biases add to r, z and n before their
    nonlinearity; hidden h_0 (B, H); weight (3H, H) of the recurrence and bias (H,), which r gates
    with h's part of n -> (T, B, H). Gates stand in torch's order, so that `nn.GRU` holds the
    weights.
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
        candidate_h = hidden.new_empty(steps, batch, width)  # what h adds to n
        history[0] = hidden
        both, only = slice(2 * width), slice(2 * width, None)  # r and z, n
        to_gates, to_n = weight[both].t().contiguous(), weight[only].t().contiguous()
        # Each step's views, taken at once: one by one they would cost as much as the sums.
        given = (history[:-1], from_input[:, :, both], from_input[:, :, only])
        made = (gates, *gates.chunk(2, 2), candidate_h, candidate, history[1:])
        for h, x_gates, x_n, gate, reset, update, n_h, n, following in _steps(*given, *made):
            torch.addmm(x_gates, h, to_gates, out=gate).sigmoid_()
            torch.addmm(bias, h, to_n, out=n_h)
            torch.addcmul(x_n, reset, n_h, out=n).tanh_()
            torch.lerp(n, h, update, out=following)
        ctx.save_for_backward(history, gates, candidate, candidate_h, weight)
        return history[1:]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        history, gates, candidate, candidate_h, weight = ctx.saved_tensors
        before, (steps, batch, width) = history[:-1], candidate.shape
        carried = torch.empty_like(candidate)  # the gradient of each h_t
        # That of n's part of h, of r, of z and of n before their nonlinearity: the first three
        # reach the recurrent weights, the last three the input's.
        through = candidate.new_empty(steps, batch, 4, width)
        to_weights, to_input = through[:, :, :3].flatten(2), through[:, :, 1:].flatten(2)
        weights = weight.roll(width, 0)  # n, r, z
        onward = torch.zeros_like(history[0])
        wide = carried.unsqueeze(2)
        each = _steps(gradients[0], carried, wide, through, to_weights, gates[:, :, width:])
        for first in reversed(range(0, steps, _BLOCK)):
            at = slice(first, first + _BLOCK)
            reset, update = gates[at].chunk(2, 2)
            factors = _factors(reset, update, candidate[at], candidate_h[at], before[at])
            for t, factor in reversed(list(enumerate(factors.unbind(), first))):
                given, h, h_wide, ways, rows, kept = each[t]
                torch.add(given, onward, out=h)
                torch.mul(h_wide, factor, out=ways)
                onward = torch.addmm(h * kept, rows, weights)
        rows = to_weights.flatten(0, 1)  # (T·B, 3H)
        to_weight = rows.t() @ before.flatten(0, 1)  # (3H, H)
        return to_input, onward, to_weight.roll(-width, 0), rows[:, :width].sum(0)


def _steps(*tensors: Tensor) -> list[tuple[Tensor, ...]]:
    """Views of tensors (T, …), step by step."""
    return list(zip(*(tensor.unbind() for tensor in tensors), strict=True))


def _factors(reset: Tensor, update: Tensor, n: Tensor, n_h: Tensor, before: Tensor) -> Tensor:
    """(T, B, H) each -> (T, B, 4, H): what a gradient of h is multiplied with on its ways back.

    To what h adds to n, and to r, z and n before their nonlinearity.
    """
    factors = n.new_empty(*n.shape[:2], 4, n.shape[2])
    into_n = torch.mul(1 - update, 1 - n.square(), out=factors[:, :, 3])
    torch.mul(into_n, reset, out=factors[:, :, 0])
    torch.mul(into_n * n_h, reset * (1 - reset), out=factors[:, :, 1])
    torch.mul(before - n, update * (1 - update), out=factors[:, :, 2])
    return factors
