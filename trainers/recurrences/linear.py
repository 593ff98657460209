"""The linear recurrence h_t = a_t ∘ h_{t−1} + b_t for a whole sequence in log₂ T rounds."""

from typing import Any

import torch
from torch import Tensor


def linear_recurrence(decay: Tensor, drive: Tensor) -> Tensor:
    """All of h_1 … h_T from h_0 = 0, differentiable.

    Shapes: (T, …) each, time first -> (T, …). Only products of decays are formed, never their
    inverses, so decays near 0 do no harm.
    """
    history: Tensor = _LinearRecurrence.apply(decay, drive)  # type: ignore[no-untyped-call]
    return history


def _scan(decay: Tensor, drive: Tensor) -> Tensor:
    """Odd–even recursion (Blelloch 1990): solve for every second sample, fill in the others."""
    length = len(drive)
    if length == 1:
        return drive.clone()
    even = 2 * (length // 2)
    later, earlier = decay[1:even:2], decay[0:even:2]
    odd_samples = _scan(later * earlier, torch.addcmul(drive[1:even:2], later, drive[0:even:2]))
    result = torch.empty_like(drive)
    result[0] = drive[0]
    result[1:even:2] = odd_samples
    previous = odd_samples[: (length - 1) // 2]
    torch.addcmul(drive[2::2], decay[2::2], previous, out=result[2::2])
    return result


class _LinearRecurrence(torch.autograd.Function):
    """The adjoint of a linear recurrence is the same recurrence run backwards in time."""

    @staticmethod
    def forward(ctx: Any, decay: Tensor, drive: Tensor) -> Tensor:
        result = _scan(decay, drive)
        ctx.save_for_backward(decay, result)
        return result

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor]:
        decay, result = ctx.saved_tensors
        reversed_decay = torch.cat(
            [decay[:1], decay[1:].flip(0)]
        )  # its first entry acts on h_0 = 0
        drive_gradient = _scan(reversed_decay, gradients[0].flip(0)).flip(0)
        decay_gradient = torch.zeros_like(decay)
        torch.mul(drive_gradient[1:], result[:-1], out=decay_gradient[1:])
        return decay_gradient, drive_gradient
