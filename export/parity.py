"""The parity gate: the exported graph, through the runner that ships, beside the training forward.

The training-time forward sees whole sequences (parallel scan, causal convolution); the runner takes
one observation at a time and carries its memory. Both must give the same force.
"""

import copy
import math
from collections.abc import Sequence

import torch

from export.example import rollout
from export.limits import limited
from runtime.predictor import PackagePredictor
from runtime.replay import Difference, compare, require_manners, rolled_out
from trainers.model import Predictor
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.manifest import (
    WORST_FLOAT32_ERROR,
    FloatArray,
    ForceChannel,
    Parity,
    parity_limit,
)
from wakedeploy.core.package import Package


def measure(package: Package, predictor: Predictor, observations: FloatArray) -> Parity:
    """Compare over (T, d) observations; the manifest's parity, passed or not."""
    force = package.manifest.force
    reference = limited(rollout(predictor, observations), force)
    difference = compare(rolled_out(PackagePredictor(package), observations), reference)
    rounding = _float32_error(predictor, force, observations, reference)
    if not math.isfinite(difference.max_abs) or not (rounding or 0.0) <= WORST_FLOAT32_ERROR:
        raise CheckFailed(
            f"This {predictor.arch} cannot be computed in float32: its force is not finite, or off"
            f" by {rounding or math.inf:.1e} against float64; no file was written. Choose another "
            "shape, for a reservoir a smaller spectral_radius."
        )
    return Parity(
        max_abs=difference.max_abs,
        max_rel=difference.max_rel,
        steps=len(observations),
        limit=parity_limit(rounding),
        float64_rel=rounding,
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


def _float32_error(
    predictor: Predictor,
    force: Sequence[ForceChannel],
    observations: FloatArray,
    reference: FloatArray,
) -> float | None:
    if not predictor.core.amplifies_rounding:
        return None
    wide = copy.deepcopy(predictor).double()
    with torch.no_grad():
        exact = wide.rollout(torch.from_numpy(observations).double()[None])[0].numpy()
    error: Difference = compare(reference, limited(exact, force))
    return error.max_rel
