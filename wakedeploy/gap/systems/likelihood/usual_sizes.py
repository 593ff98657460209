"""How large inputs, states, rates and readings usually are in some logs.

In: a system, its logs and states along them. Out: sizes by name, from which effects, noise and the
steps of a fit have their scale.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.likelihood.blocks import Log
from wakedeploy.gap.systems.system import StateSpace

Sizes = Mapping[str, float]

_TRIFLE = 0.02  # of a usual size
_USUAL = 0.98  # quantile of what is usual
_ENDS = 0.995  # the same for how far a state goes: one stray reading is no end of it


def usual_sizes(
    system: StateSpace,
    logs: Sequence[Log],
    states: Sequence[FloatArray],
    rates_at: Callable[[FloatArray, FloatArray], FloatArray],
) -> dict[str, float]:
    """Usual sizes of inputs, states and rates (`d …`), and how outputs vary and reach.

    `states` (n, N) are those along each log; `rates_at` says the model's rates at states and
    inputs. `parts …` is the size of a rate if its inputs do not hold against its states. `least …`
    is how near to 0 an input or a known state comes; `turns …` is 1 if it changes its sign, else 0.
    `largest …` is how far from 0 an input goes; `lowest …` and `highest …` are the ends of a known
    state. `y …` is the size about an output's mean; `top …` and `bottom …` are its largest and
    least reading, and `readings at top …` is how often it shows that.
    """
    sizes = _of_inputs(system, logs) | _of_outputs(system, logs)
    sizes |= _of_states(system, np.concatenate(states, axis=1), sizes)
    inputs = np.concatenate([log.inputs for log in logs], axis=1)
    return sizes | _of_rates(system, states, inputs, rates_at)


def _of_inputs(system: StateSpace, logs: Sequence[Log]) -> dict[str, float]:
    sizes = {}
    inputs = np.concatenate([log.inputs for log in logs], axis=1)
    driving = np.concatenate([log.driving for log in logs], axis=1)
    for stated, row, driven in zip(system.inputs, inputs, driving, strict=True):
        sizes[stated.name] = _usual(row)
        sizes |= _signs(stated.name, row, sizes[stated.name])
        sizes[f"largest {stated.name}"] = float(np.abs(driven).max())
    return sizes


def _of_outputs(system: StateSpace, logs: Sequence[Log]) -> dict[str, float]:
    sizes = {}
    outputs = np.concatenate([log.outputs for log in logs], axis=1)
    for o, row in zip(system.outputs, outputs, strict=True):
        sizes[f"y {o.name}"] = _usual(row - np.nanmean(row))
        for end, reached in (("top", np.nanmax(row)), ("bottom", np.nanmin(row))):
            sizes[f"{end} {o.name}"] = float(reached)
            sizes[f"readings at {end} {o.name}"] = float((row == reached).sum())
    return sizes


def _of_states(system: StateSpace, states: FloatArray, known: Sizes) -> dict[str, float]:
    """Of states (n, N) along all logs; what nothing shows is as large as the largest output."""
    sizes = {}
    first = max(known[f"y {o.name}"] for o in system.outputs)
    for name, row in zip(system.states, states, strict=True):
        sizes[name] = float(system.start_spread.get(name, first))
        if np.ptp(row) > 0.0:
            sizes[name] = _usual(row)
            sizes |= _signs(name, row, sizes[name])
            sizes |= _way(name, row)
    return sizes | _of_differences(system, states)


def _of_differences(system: StateSpace, states: FloatArray) -> dict[str, float]:
    """Of how far one body is ahead of another, and how fast, by the port's names for them."""
    sizes, named = {}, dict(zip(system.states, states, strict=True))
    for port in (p for p in system.ports if p.speeds):
        for name, pair in ((port.name, port.speeds), (port.position, port.positions)):
            if pair:
                row = port.ahead(named, pair)
                sizes[name] = _usual(row)
                sizes |= _signs(name, row, sizes[name]) | _way(name, row)
    return sizes


def _way(name: str, row: FloatArray) -> dict[str, float]:
    low, high = np.quantile(row, [1.0 - _ENDS, _ENDS])
    return {f"lowest {name}": float(low), f"highest {name}": float(high)}


def _of_rates(
    system: StateSpace,
    states: Sequence[FloatArray],
    inputs: FloatArray,
    rates_at: Callable[[FloatArray, FloatArray], FloatArray],
) -> dict[str, float]:
    sizes = {}
    along = np.concatenate(states, axis=1)
    rates, dt_s = rates_at(along, inputs), 1.0 / system.rate_hz
    apart = np.sqrt(np.mean(rates_at(*_at_other_times(along, inputs)) ** 2, axis=1))
    for i, name in enumerate(system.states):
        moved = np.concatenate([np.gradient(each[i], dt_s) for each in states])
        size = float(np.sqrt(np.mean(rates[i] ** 2)))
        sizes[f"d {name}"] = size if size > 0.0 and np.isfinite(size) else _usual(moved)
        parts = float(apart[i]) if np.isfinite(apart[i]) else 0.0
        sizes[f"parts {name}"] = max(parts, sizes[f"d {name}"])
    return sizes


def _at_other_times(*columns: FloatArray) -> list[FloatArray]:
    """The same columns, (n, N) and (i, N), each of the two in an order of samples of its own.

    States stay together: a spring between two of them would else be as long as both wander.
    """
    rng = np.random.default_rng(0)
    return [each[:, rng.permutation(each.shape[1])] for each in columns]


def _signs(name: str, values: FloatArray, size: float) -> dict[str, float]:
    """How near to 0 values come, and whether their sign changes by more than a trifle."""
    low, high = float(values.min()), float(values.max())
    turns = low < -_TRIFLE * size and high > _TRIFLE * size
    return {f"least {name}": float(np.abs(values).min()), f"turns {name}": float(turns)}


def _usual(values: FloatArray) -> float:
    """The size that is seldom exceeded; 1 for what is always 0."""
    size = float(np.nanquantile(np.abs(values), _USUAL))
    return size if size > 0.0 else float(np.nanmax(np.abs(values))) or 1.0
