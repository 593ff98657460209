"""The parity gate: the exported graph, through the runner that ships, beside the training forward.

The training-time forward sees whole sequences (parallel scan, causal convolution); the runner takes
one observation at a time and carries its memory. Both must tell the same force.
"""

import copy

import numpy as np
import torch

from runtime.predictor import PackagePredictor
from runtime.replay import Difference, compare, require_manners, rolled_out
from trainers.model import Predictor
from wakedeploy.episodes import Episode
from wakedeploy.errors import CheckFailed, UnusableInput
from wakedeploy.package import PARITY_STEPS, FloatArray, Package, Parity, parity_limit

# The reservoir multiplies rounding errors through a thousand neurons: its own float32 error is the
# yardstick there.
_SELF_MEASURED = "esn"


def joined(episodes: tuple[Episode, ...], steps: int = PARITY_STEPS) -> FloatArray:
    """Observations (T, d) of whole episodes in a row, at least `steps` of them, without a reset.

    Raises UnusableInput when the episodes are too few: parity is not proved on repeated samples.
    """
    chosen: list[FloatArray] = []
    for episode in episodes:
        chosen.append(episode.observation)
        if sum(map(len, chosen)) >= steps:
            return np.concatenate(chosen)
    raise UnusableInput(
        f"Parity needs {steps} samples of real episodes and the set holds "
        f"{sum(map(len, chosen))}; give a larger one with --data."
    )


def measure(package: Package, predictor: Predictor, observations: FloatArray) -> Parity:
    """Compare over (T, d) observations; the manifest's parity, passed or not."""
    reference = _rollout(predictor, observations)
    difference = compare(rolled_out(PackagePredictor(package), observations), reference)
    own = _float32_error(predictor, observations, reference)
    return Parity(
        max_abs=difference.max_abs,
        max_rel=difference.max_rel,
        steps=len(observations),
        limit=parity_limit(own),
        float64_rel=own,
    )


def require_parity(package: Package, observations: FloatArray) -> None:
    """CheckFailed unless the measured parity holds and the runner has its manners."""
    parity = package.manifest.parity
    if not parity.passed:
        raise CheckFailed(
            f"The exported {package.manifest.arch} differs from the trained one: relative "
            f"{parity.max_rel:.1e} over {parity.steps} steps, limit {parity.limit:.1e}; no file "
            "was written. Report this with the versions that `wakedeploy doctor` prints."
        )
    require_manners(package, observations)


def _rollout(predictor: Predictor, observations: FloatArray) -> FloatArray:
    with torch.no_grad():
        rolled: FloatArray = predictor.rollout(torch.from_numpy(observations)[None])[0].numpy()
    return rolled


def _float32_error(
    predictor: Predictor, observations: FloatArray, reference: FloatArray
) -> float | None:
    if predictor.arch != _SELF_MEASURED:
        return None
    wide = copy.deepcopy(predictor).double()
    with torch.no_grad():
        exact = wide.rollout(torch.from_numpy(observations).double()[None])[0].numpy()
    error: Difference = compare(reference, exact)
    return error.max_rel
