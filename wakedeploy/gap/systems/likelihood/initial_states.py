"""First guesses of a system's states along its logs, before anything is fitted.

In: a system and its logs. Out: for each log, the states along it that follow from outputs, their
slopes and the user's `start`, and where the others begin.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.likelihood.blocks import Log
from wakedeploy.gap.systems.ports import Point
from wakedeploy.gap.systems.system import StateSpace

_SMOOTHED = 11  # samples, for a first guess of speeds


@dataclass(frozen=True, eq=False)
class InitialStates:
    """States known `along` a log (N,), by name, and those known only at its `first` sample."""

    along: Mapping[str, FloatArray]
    first: Mapping[str, float]

    def stacked(self, system: StateSpace, count: int) -> FloatArray:
        """States (n, N): those known only at first keep that value; unknown ones are 0."""
        rows = [self.along.get(n, np.full(count, self.first.get(n, 0.0))) for n in system.states]
        return np.array(rows)


def initial_states(system: StateSpace, log: Log, kinematic: Mapping[str, str]) -> InitialStates:
    """What a log shows of states. `kinematic` names the state that each is the derivative of.

    Raises UnusableInput for a `start` that does not return finite numbers.
    """
    smooth = {
        o.name: _smoothed(_filled(values))
        for o, values in zip(system.outputs, log.outputs, strict=True)
    }
    along = {n: v for n, v in smooth.items() if n in system.states}
    for _ in system.states:
        for name, other in kinematic.items():
            if name in along and other not in along:
                along[other] = _smoothed(np.gradient(along[name], 1.0 / system.rate_hz))
    count, first = log.outputs.shape[1], {}
    for name, value in system.first(Point("output", smooth)).items():
        row = np.asarray(value, dtype=float)
        if row.shape not in ((), (1,), (count,)) or not np.all(np.isfinite(row)):
            raise UnusableInput(
                f"{system.name}.start gives {name!r} the shape {row.shape}, or something that is "
                f"no number, where outputs have the shape {(count,)}; return one finite number "
                "for each."
            )
        if row.shape == (count,):
            along[name] = row
        elif name in along:
            along[name] = np.concatenate([row.reshape(1), along[name][1:]])
        else:
            first[name] = float(row.reshape(()))
    return InitialStates(along, first)


def _filled(values: FloatArray) -> FloatArray:
    """Gaps bridged by straight lines."""
    known = np.isfinite(values)
    at = np.arange(len(values))
    return np.asarray(np.interp(at, at[known], values[known]))


def _smoothed(values: FloatArray) -> FloatArray:
    if len(values) < _SMOOTHED:
        return values
    return np.asarray(savgol_filter(values, _SMOOTHED, 2))
