"""A system replayed along a recording, with what a correction says where it has one."""

from collections.abc import Mapping

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.systems.correction import Named
from wakedeploy.gap.systems.kinds.library import Effect, offered
from wakedeploy.gap.systems.likelihood.augmented import Acting
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.replay import Replay
from wakedeploy.gap.systems.system import StateSpace


def simulated(system: StateSpace, recording: Recording) -> Replay:
    """States and outputs by name, (n,) each, from the recording's first sample and its inputs."""
    model = LogModel(system, [recording])
    acting, values = _acting(model)
    states, shown = model.filter.free_run(acting, {n: np.array([v]) for n, v in values.items()})
    series = dict(zip(acting.system.states, states, strict=False))
    series |= {o.name: shown[i] for i, o in enumerate(system.outputs)}
    log = model.logs[0]
    measured = {o.name: log.outputs[i] for i, o in enumerate(system.outputs)}
    time_s = recording.time_s[:: log.rows][: log.outputs.shape[1]]
    return Replay(series, time_s, measured)


def replay_error(system: StateSpace, recording: Recording) -> dict[str, float]:
    """Root mean square of measured less simulated, by output."""
    replay = simulated(system, recording)
    return {
        name: float(np.sqrt(np.nanmean((measured - replay[name]) ** 2)))
        for name, measured in replay.measured.items()
    }


def _acting(model: LogModel) -> tuple[Acting, dict[str, float]]:
    correction = model.system.correction
    if correction is None or correction.is_empty:
        return Acting(model.system, (), model.sizes), {"nothing": 0.0}
    document = correction.document
    library = offered(model.system, document.sizes, (document.sample_s, document.span_s))
    effects = [_known(library, named, model) for named in document.effect]
    form = sorted({name.rsplit(".", 1)[0] for name in document.form})
    return Acting(model.system, effects, document.sizes, form), correction.values


def _known(library: Mapping[str, Effect], named: Named, model: LogModel) -> Effect:
    """The effect that a correction names; UnusableInput if the system no longer has it so."""
    effect = library.get(named.name)
    if effect is None:
        raise UnusableInput(
            f"{model.name}: the correction has {named.name!r}, which no port offers; run `gap add` "
            "for the system as it is now."
        )
    for free in effect.free:
        name = free.name.removeprefix(f"{named.name}.")
        if named.units.get(name, free.unit) != free.unit:
            raise UnusableInput(
                f"{model.name}: the correction has {name!r} of {named.name!r} in "
                f"{named.units[name]}, and the system has it in {free.unit}; run `gap add` for the "
                "system as it is now."
            )
    return effect
