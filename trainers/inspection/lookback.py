"""Where in the past a trained predictor looks, for those two architectures that say so.

In: a predictor and a tape. Out: Delay Embedding's kernels, Cross-Attention's weights, for the
tape's scored samples in their order.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from trainers.architectures.cross_attention import CrossAttention
from trainers.architectures.delay_embedding import DelayEmbedding
from trainers.model import Predictor
from trainers.training.predict import Seen
from trainers.training.tape import Tape

FloatArray = npt.NDArray[np.float64]

_SAMPLES_AT_ONCE = 4_096  # bounds memory, does not change the result


@dataclass(frozen=True, eq=False)
class Kernels:
    """What Delay Embedding chose at M samples, each (M,) in seconds.

    `delay_s` is the kernel's centre μ, `width_s` its σ. `mean_age_s` is the mean age of what it
    weighs: another number than μ where the kernel hangs over an end of the window.
    """

    delay_s: FloatArray
    width_s: FloatArray
    mean_age_s: FloatArray


@torch.no_grad()
def kernels(predictor: Predictor, tape: Tape) -> Kernels:
    """The delays chosen at the scored samples. TypeError for another architecture."""
    core = predictor.core
    if not isinstance(core, DelayEmbedding):
        raise TypeError(f"{predictor.arch} chooses no delay")
    shares = []
    for window in _windows(predictor, tape):
        delay_s, width_s = core.kernel(window)  # (B, 1)
        weights = core.weigh(delay_s, width_s)  # (B, P)
        mean_age_s = (weights * core.ages_s).sum(1, keepdim=True)  # (B, 1)
        shares.append(torch.cat([delay_s, width_s, mean_age_s], 1))
    return Kernels(*torch.cat(shares).double().numpy().T)


@torch.no_grad()
def attention(predictor: Predictor, tape: Tape) -> FloatArray:
    """Weights over the window, oldest first, averaged over the scored samples: (K, H).

    Each head's weights sum to 1. TypeError for another architecture.
    """
    core = predictor.core
    if not isinstance(core, CrossAttention):
        raise TypeError(f"{predictor.arch} attends to nothing")
    total = torch.zeros(predictor.memory.k, core.heads, dtype=torch.float64)
    for window in _windows(predictor, tape):
        _, weights = core.attend(window)  # (B, H, K)
        total += weights.double().sum(0).t()
    return np.asarray((total / tape.scored.sum()).numpy())


def _windows(predictor: Predictor, tape: Tape) -> list[torch.Tensor]:
    """The normalised windows of the scored samples, in batches of (B, K, d)."""
    scored = torch.nonzero(tape.scored).squeeze(1)
    seen = Seen(tape.observation, tape.first, predictor.memory)
    batches = torch.split(scored, _SAMPLES_AT_ONCE)
    return [predictor.normalise(seen.at(index)) for index in batches]
