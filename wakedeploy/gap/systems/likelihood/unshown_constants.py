"""Constants that no output of the logs shows: no equation reads them, or nothing comes of it.

In: a `LogModel` and what a fit of it may move. Out: names. A likelihood is flat in such a constant,
so that rounding alone would take one without a limit of spread to a bound. All blocks are asked, as
a function may read a constant in few samples alone: a hard stop, where something hits it.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wakedeploy.gap.evidence.fits import LOST_NATS, FloatArray, Free, neutral
from wakedeploy.gap.systems.trial_points import named_by_ports

if TYPE_CHECKING:
    from wakedeploy.gap.systems.likelihood.logs import LogModel

_TIMES = (0.1, 10.0)  # of its value, at which a constant is tried
_ROUNDING = 1e-9  # of the standard deviation of a prediction error


def unshown(model: "LogModel", free: Sequence[Free]) -> set[str]:
    """Constants of unlimited spread that move no prediction of the logs; ports name none of them.

    None where the model as stated leaves its range on these logs: there nothing shows anything.
    """
    kept = {f"constant.{name}" for name in named_by_ports(model.system)}
    loose = [
        i
        for i, f in enumerate(free)
        if f.name.startswith("constant.") and np.isinf(f.prior_sd) and f.name not in kept
    ]
    if not loose:
        return set()
    points = _moved(free, loose)
    values = dict(zip((f.name for f in free), points.T, strict=True))
    with np.errstate(all="ignore"):
        run = model.filter.run(model.acting(()), values, range(model.episodes))
    innovation, variance, density, _ = run.statistics  # (T, m, K, parts) each
    lost = density == LOST_NATS
    if lost[:, :, 0].any():
        return set()
    sd = np.sqrt(variance[:, :, :1])
    off = np.abs(innovation - innovation[:, :, :1]) / sd
    off = np.maximum(off, np.abs(np.sqrt(variance) / sd - 1.0))
    off[lost] = np.inf
    most = off.max(axis=(0, 1, 3))[1:].reshape(len(loose), len(_TIMES)).max(axis=1)
    names = (free[i].quantity for i in loose)
    return {name for name, far in zip(names, most, strict=True) if far < _ROUNDING}


def _moved(free: Sequence[Free], loose: Sequence[int]) -> FloatArray:
    """What is stated, and each loose constant a decade below and above it, (1 + 2 n, p)."""
    points = np.tile(neutral(free), (1 + len(_TIMES) * len(loose), 1))
    for row, i in enumerate(loose):
        for k, times in enumerate(_TIMES):
            value = free[i].neutral * times if free[i].neutral else times
            points[1 + len(_TIMES) * row + k, i] = np.clip(value, free[i].low, free[i].high)
    return points
