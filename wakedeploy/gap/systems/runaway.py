"""States that run away on the logs, by the model as it is stated: no fit says anything then.

In: a `LogModel`. Out: sentences.
"""

import numpy as np

from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.wording import counted

_AHEAD, _PLACES = 10, 200  # samples on from places that are tried
_AWAY = 1e3  # times as large as it usually is: nothing that the logs hold goes there so soon


def runaways(model: LogModel) -> list[str]:
    """Which state goes far beyond all that the logs hold, from most places, and how soon.

    Of several the first: it takes the others along.
    """
    sizes = np.array([model.sizes[name] for name in model.system.states])
    usual = np.maximum(sizes, np.abs(model.along_logs()).max(axis=1))
    for k, states in enumerate(_onward(model), 1):
        away = ~(np.abs(states) < _AWAY * usual[:, None])  # also what is no number
        share = away.mean(axis=1)
        if share.max() > 0.5:
            name = list(model.system.states)[int(share.argmax())]
            return [
                f"state {name} runs away: from most places of the logs the model as stated takes "
                f"it to over {_AWAY:,.0f} times what they hold, within {counted(k, 'sample')}. "
                "Check its equation, signs, units and `rate_hz`: until then nothing here can be "
                "learnt."
            ]
    return []


def _onward(model: LogModel) -> list[FloatArray]:
    """The states (n, S), one sample and more after places of the logs."""
    ends = np.cumsum([log.outputs.shape[1] for log in model.logs])
    begins = ends - [log.outputs.shape[1] for log in model.logs]
    inside = [np.arange(a, b - _AHEAD) for a, b in zip(begins, ends, strict=True) if b - a > _AHEAD]
    if not inside:
        return []
    every = np.concatenate(inside)
    at = every[np.unique(np.linspace(0, len(every) - 1, _PLACES).astype(np.int64))]
    values = {free.name: np.array([free.neutral]) for free in model.free(())}
    with np.errstate(all="ignore"):
        return list(model.filter.onward(model.acting(()), values, at, _AHEAD))
