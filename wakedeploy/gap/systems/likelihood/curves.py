"""Inputs that drive a system by a curve: no port stands behind a curve within its equations.

In: a `LogModel`. Out: these inputs, and what an answer may have taken for a lag behind their curve.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.units import same_unit
from wakedeploy.gap.evidence.fits import FloatArray

if TYPE_CHECKING:
    from wakedeploy.gap.systems.likelihood.logs import LogModel

_PLACES, _ALONG = 40, 9  # samples of the logs that are looked at, and values of an input there
_BENT = 0.05  # of the way that a rate goes: a curve is this far from a straight line
_MOVES = 1e-9  # of a rate: a smaller change is rounding
_NUDGE, _FOLLOWS = 1e-3, 0.2  # of an input's range; of what the input does by itself
_NEXT_TO_NOTHING, _SOME = 0.05, 2  # of what an input usually does; places


def curves(model: "LogModel") -> dict[str, tuple[str, ...]]:
    """By input, the states whose rates follow a curve of it in the range of the logs.

    A limit, a dead zone and a table are curves, too. An input that asks for a state, as the command
    of a servo, is tried as far from that state as it was: a limit of what the servo does is no
    curve where it was never reached. Where it does nothing here and there, that is one.
    """
    system = model.system
    inputs = np.concatenate([log.inputs for log in model.logs], axis=1)
    states = model.along_logs()
    at = np.linspace(0, inputs.shape[1] - 1, _PLACES).astype(np.int64)
    found: dict[str, tuple[str, ...]] = {}
    for i, stated in enumerate(system.inputs):
        tried = np.repeat(inputs[:, None, at], _ALONG, axis=1)  # (i, _ALONG, _PLACES)
        there = np.repeat(states[:, None, at], _ALONG, axis=1)
        try:
            asked = _asked_for(model, i, inputs[:, at], states[:, at])
            about = np.zeros_like(inputs[i]) if asked is None else states[asked]
            ahead = inputs[i] - about
            tried[i] = about[at] + np.linspace(ahead.min(), ahead.max(), _ALONG)[:, None]
            rates = dict(zip(system.states, model.rates_at(there, tried), strict=True))
        except UnusableInput:  # a user's function need not work everywhere
            continue
        bent = [n for n, rate in rates.items() if _is_bent(rate)]
        if asked is not None:
            bent += [n for n in _idle(model, i, inputs[:, at], states[:, at]) if n not in bent]
        if bent:
            found[stated.name] = tuple(bent)
    return found


def _nudged(
    model: "LogModel", i: int, inputs: FloatArray, states: FloatArray, along: int | None = None
) -> dict[str, FloatArray]:
    """How rates change with a little more of an input, and as much of the state `along`."""
    little = _NUDGE * (float(np.ptp(inputs[i])) or 1.0)
    more, there = inputs.copy(), states.copy()
    more[i] += little
    if along is not None:
        there[along] += little
    change = np.abs(model.rates_at(there, more) - model.rates_at(states, inputs))
    return dict(zip(model.system.states, change, strict=True))


def _driven(pushed: dict[str, FloatArray]) -> list[str]:
    """The states whose rates an input moves by more than rounding does."""
    most = max(float(np.median(change)) for change in pushed.values())
    return [n for n, change in pushed.items() if np.median(change) > max(_MOVES * most, 0.0)]


def _asked_for(model: "LogModel", i: int, inputs: FloatArray, states: FloatArray) -> int | None:
    """The place of the state that an input asks for: if both move alike, hardly any rate does."""
    pushed = _nudged(model, i, inputs, states)
    driven = _driven(pushed)
    for j, unit in enumerate(model.system.states.values()):
        if driven and same_unit(unit, model.system.inputs[i].unit):
            both = _nudged(model, i, inputs, states, along=j)
            if all(np.median(both[n]) < _FOLLOWS * np.median(pushed[n]) for n in driven):
                return j
    return None


def _idle(model: "LogModel", i: int, inputs: FloatArray, states: FloatArray) -> list[str]:
    """Driven states that an input leaves alone in some places."""
    pushed = _nudged(model, i, inputs, states)
    return [
        n
        for n in _driven(pushed)
        if np.sum(pushed[n] < _NEXT_TO_NOTHING * np.median(pushed[n])) >= _SOME
    ]


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
