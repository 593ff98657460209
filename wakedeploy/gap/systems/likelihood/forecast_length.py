"""How far ahead forecasts of a system's logs are asked to be right.

In: a `LogModel`. Out: samples. Where a model runs away, as a pendulum that stands on its end, an
error of the first state grows e-fold in every so many seconds, whatever is missing: far ahead
nothing forecasts better than the last reading, and no effect can.
"""

from typing import TYPE_CHECKING

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.fits import FloatArray

if TYPE_CHECKING:
    from wakedeploy.gap.systems.likelihood.logs import LogModel

_FEWEST, _MOST = 10, 100  # samples
_FEWEST_UNSTABLE = 3
_GROWN = 3.0  # e-folds of an error, some twentyfold, after which a forecast tells little
_PLACES = 40  # samples of the logs at which the model is looked at
_NUDGE = 1e-4  # of a state's usual size


def samples_ahead(model: "LogModel") -> int:
    """As stated; else a quarter of the shortest block, and no more than errors bear."""
    if model.system.forecast_s is not None:
        return max(round(model.system.forecast_s / model.dt_s), 1)
    shortest = min(b.stop - b.start for b in model.blocks)
    usual = int(np.clip(shortest // 4, _FEWEST, _MOST))
    growth = growth_per_s(model)
    if growth * usual * model.dt_s <= _GROWN:
        return usual
    return max(int(_GROWN / (growth * model.dt_s)), _FEWEST_UNSTABLE)


def growth_per_s(model: "LogModel") -> float:
    """By how many e-folds a second a small error of the state usually grows along the logs [1/s].

    The median of what the eigenvalues of the model's Jacobian say at most: their real part, and of
    a model in steps the logarithm of their size over the step. 0 for a model that forgets.
    """
    inputs = np.concatenate([log.inputs for log in model.logs], axis=1)
    states = model.along_logs()
    at = np.linspace(0, inputs.shape[1] - 1, _PLACES).astype(np.int64)
    x, u = states[:, at], inputs[:, at]
    steps = _NUDGE * np.array([model.sizes[name] for name in model.system.states])
    columns = []
    try:
        for i, step in enumerate(steps):
            aside = np.zeros_like(x)
            aside[i] = step
            change = model.rates_at(x + aside, u) - model.rates_at(x - aside, u)
            columns.append(change / (2.0 * step))
    except UnusableInput:  # a user's function need not work everywhere
        return 0.0
    jacobian = np.array(columns).transpose(2, 1, 0)  # (places, n, n)
    known = np.isfinite(jacobian).all(axis=(1, 2))
    if not known.any():
        return 0.0
    return max(float(np.median(_largest(model, jacobian[known]))), 0.0)


def _largest(model: "LogModel", jacobian: FloatArray) -> FloatArray:
    """The growth of what grows most [1/s], (places,), by Jacobians (places, n, n) of rates."""
    if not model.system.has_step:
        return np.asarray(np.linalg.eigvals(jacobian).real.max(axis=1))
    stepped = np.eye(jacobian.shape[-1]) + model.dt_s * jacobian
    sizes = np.abs(np.linalg.eigvals(stepped)).max(axis=1)
    return np.asarray(np.log(np.maximum(sizes, 1e-300)) / model.dt_s)
