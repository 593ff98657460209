"""A system replayed along a recording, with what a correction says where it has one."""

import numpy as np

from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.kinds.library import offered
from wakedeploy.gap.systems.likelihood.augmented import Acting
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.system import StateSpace


def simulated(system: StateSpace, recording: Recording) -> dict[str, FloatArray]:
    """States and outputs by name, (n,) each, from the recording's first sample and its inputs."""
    model = LogModel(system, [recording])
    acting, values = _acting(model)
    states, shown = model.filter.free_run(acting, {n: np.array([v]) for n, v in values.items()})
    series = dict(zip(acting.system.states, states, strict=False))
    return series | {o.name: shown[i] for i, o in enumerate(system.outputs)}


def replay_error(system: StateSpace, recording: Recording) -> dict[str, float]:
    """Root mean square of measured less simulated, by output."""
    series = simulated(system, recording)
    logged = LogModel(system, [recording]).logs[0].outputs
    return {
        o.name: float(np.sqrt(np.nanmean((logged[i] - series[o.name]) ** 2)))
        for i, o in enumerate(system.outputs)
    }


def _acting(model: LogModel) -> tuple[Acting, dict[str, float]]:
    correction = model.system.correction
    if correction is None or correction.is_empty:
        return Acting(model.system, (), model.sizes), {"nothing": 0.0}
    document = correction.document
    library = offered(model.system, document.sizes, (document.sample_s, document.span_s))
    effects = [library[name] for name in correction.effects]
    form = sorted({name.rsplit(".", 1)[0] for name in document.form})
    return Acting(model.system, effects, document.sizes, form), correction.values
