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
        # A mean over samples and channels alike, one operation, is then the weighted one.
        self._roots = (self.shares * len(self.shares)).sqrt()

    def __call__(self, predicted: Tensor, target: Tensor, scored: Tensor | None = None) -> Tensor:
        """Mean over the scored samples: (…, o), (…, o), (…) -> ()."""
        if scored is None:
            return mse_loss(predicted * self._roots, target * self._roots)
        per_sample = ((predicted - target) * self._roots).square().mean(-1)  # (…)
        return torch.where(scored, per_sample, 0.0).sum() / scored.sum().clamp(min=1)
