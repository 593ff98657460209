"""Weighted mean-squared error (paper, § Model Architectures), made dimensionless."""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import mse_loss


class WeightedMse:
    """Σ_c w_c MSE_c over Σ_c w_c var_c: 1 is what predicting the training mean would cost.

    It takes forces in normalised units. Dividing by a constant leaves the paper's minimum where it
    is, and makes one learning rate serve newtons and millimetres alike.
    """

    def __init__(self, weights: Sequence[float], force_sd: Tensor) -> None:
        shares = force_sd.new_tensor(weights) * force_sd.square()
        self.shares = shares / shares.sum()  # (o,)
        self._roots = self.shares.sqrt()

    def __call__(self, predicted: Tensor, target: Tensor, scored: Tensor | None = None) -> Tensor:
        """Mean over the scored samples: (…, o), (…, o), (…) -> ()."""
        if scored is None and len(self.shares) == 1:  # its weight is 1
            return mse_loss(predicted, target)
        if scored is None:
            of_all = mse_loss(predicted * self._roots, target * self._roots, reduction="sum")
            return of_all / target[..., 0].numel()
        per_sample = ((predicted - target) * self._roots).square().sum(-1)  # (…)
        return torch.where(scored, per_sample, 0.0).sum() / scored.sum().clamp(min=1)
