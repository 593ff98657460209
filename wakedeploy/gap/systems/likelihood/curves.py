"""Inputs that drive a system by a curve: no port stands behind a curve within its equations.

In: a `LogModel`. Out: these inputs, and what an answer may have taken for a lag behind their curve.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.system import Point

if TYPE_CHECKING:
    from wakedeploy.gap.systems.likelihood.logs import LogModel

_PLACES, _ALONG = 40, 9  # samples of the logs that are looked at, and values of an input there
_BENT = 0.05  # of the way that a rate goes: a curve is this far from a straight line
_MOVES = 1e-9  # of a rate: a smaller change is rounding


def curves(model: "LogModel") -> dict[str, tuple[str, ...]]:
    """By input, the states whose rates follow a curve of it in the range of the logs.

    A limit, a dead zone and a table are curves, too.
    """
    system = model.system
    inputs = np.concatenate([log.inputs for log in model.logs], axis=1)
    states = model.along_logs()
    at = np.linspace(0, inputs.shape[1] - 1, _PLACES).astype(np.int64)
    found: dict[str, tuple[str, ...]] = {}
    for i, stated in enumerate(system.inputs):
        tried = np.repeat(inputs[:, None, at], _ALONG, axis=1)  # (i, _ALONG, _PLACES)
        tried[i] = np.linspace(inputs[i].min(), inputs[i].max(), _ALONG)[:, None]
        there = np.repeat(states[:, None, at], _ALONG, axis=1)
        state = Point("state", dict(zip(system.states, there, strict=True)))
        driven = Point("input", dict(zip((s.name for s in system.inputs), tried, strict=True)))
        try:
            with np.errstate(all="ignore"):
                rates = system.rates(state, driven, system.values())
        except UnusableInput:  # a user's function need not work everywhere
            continue
        bent = [n for n, rate in rates.items() if _is_bent(np.broadcast_to(rate, tried[i].shape))]
        if bent:
            found[stated.name] = tuple(bent)
    return found


def _is_bent(rates: FloatArray) -> bool:
    """Whether rates (_ALONG, _PLACES) are off a straight line in most places."""
    along = np.linspace(-1.0, 1.0, _ALONG)[:, None]
    mean = rates.mean(axis=0)
    slope = (along * (rates - mean)).sum(axis=0) / (along**2).sum()
    off, way = np.abs(rates - mean - along * slope).max(axis=0), np.ptp(rates, axis=0)
    moves = way > _MOVES * np.abs(rates).max(axis=0)
    return bool(np.mean(moves & (off > _BENT * way)) > 0.5)


def taken_for(model: "LogModel", named: Sequence[str]) -> list[str]:
    """Inputs with a curve where a lag behind it may be what some named effects stand for.

    These effects say that the input is slow, or an output that the curve's states drive.
    """
    slow = [model.library[n].port for n in named if model.library[n].kind.is_slow]
    outputs = {o.name for o in model.system.outputs}
    found = []
    for name, states in model.curves.items() if slow else ():
        reached = {n for state in states for n in model.system.reached_from(state)}
        beyond = {*model.system.states} - reached
        if any(p.name == name or p.name in outputs - beyond for p in slow):
            found.append(name)
    return found
