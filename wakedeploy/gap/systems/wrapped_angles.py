"""Angles of a system that begin again after a turn: in its logs, and in its own equations.

In: a system with recordings, or a `LogModel`. Out: recordings in which angles go on, and sentences.
A filter takes the jump of a turn for motion, on either side.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from wakedeploy.core.angles import Unwrapped, turn_in, unwrapped
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.ports import Point
from wakedeploy.gap.systems.system import StateSpace
from wakedeploy.gap.wording import counted, minus

_BASES, _ALONG = 8, 401  # points from which a state goes on, and values that it then has
_TURNS, _FAR = 1.5, 3.0  # how far an angle goes to each side, and any other state, in usual sizes
_BESIDE = 0.01  # of a turn, by which a reading may lie beyond one


def going_on(system: StateSpace, recording: Recording) -> tuple[Recording, list[str]]:
    """The recording with outputs that are angles going on, and what was done about each."""
    found = _wrapped(system, recording)
    columns = {**recording.columns, **{name: each.values for name, each in found.items()}}
    notes = [
        f"{recording.name}: {name} unwrapped at {counted(each.places, 'place')}; a columns.toml "
        "with wraps = false keeps it as it is"
        for name, each in found.items()
    ]
    return replace(recording, columns=columns), notes


def jumps(system: StateSpace, recording: Recording) -> list[str]:
    """What is said of outputs that are angles and begin again after a turn."""
    return [
        f"{recording.name}: {name} jumps by a turn at {counted(each.places, 'place')}, which counts"
        " as motion; let it go on (np.unwrap)"
        for name, each in _wrapped(system, recording).items()
    ]


def own_wraps(model: LogModel) -> list[str]:
    """Angles that the system itself begins again after a turn, where its logs do otherwise."""
    system = model.system
    found = [("measure", o.name, o.unit) for o in system.outputs if hasattr(system, "measure")]
    found += [("step", name, unit) for name, unit in system.states.items() if system.has_step]
    return [
        f"{system.name}.{method} begins {name} again after a turn, from {_ends(shown)} {unit}, and "
        "the log goes on, so that a jump of a turn counts as an error; return it without np.mod, "
        "or arctan2 of its sine and cosine."
        for method, name, unit in found
        for turn in [turn_in(unit)]
        if turn is not None
        for shown in [_begun_again(model, method, name, turn)]
        if shown is not None and _leaves(model, name, turn, shown)
    ]


def _wrapped(system: StateSpace, recording: Recording) -> dict[str, Unwrapped]:
    """Outputs of a recording that are angles and jump by whole turns, as they would go on."""
    found = {}
    for output in system.outputs:
        turn, values = turn_in(output.unit), recording.columns.get(output.name)
        if turn is not None and values is not None:
            found[output.name] = unwrapped(values, turn, recording.time_s)
    return {name: each for name, each in found.items() if each.places}


def _begun_again(model: LogModel, method: str, name: str, turn: float) -> FloatArray | None:
    """What a function gives for an angle as one state after another goes on, where that jumps."""
    along = np.linspace(-1.0, 1.0, _ALONG)
    still = np.zeros((_BASES, _ALONG))
    inputs = Point("input", {i.name: still for i in model.system.inputs})
    ask = model.system.readings if method == "measure" else model.system.rates
    for states in _ways(model, along):
        try:
            with np.errstate(all="ignore"):
                given = ask(Point("state", states), inputs, model.system.values())[name]
        except UnusableInput:  # so far away nobody asks the function otherwise
            continue
        shown = np.broadcast_to(np.asarray(given, dtype=float), (_BASES, _ALONG))
        if any(unwrapped(row, turn, along).places for row in shown):
            return np.asarray(shown)
    return None


def _ways(model: LogModel, along: FloatArray) -> Iterator[dict[str, FloatArray]]:
    """States (bases, along): from points of usual size each, one of them goes far to both sides."""
    rng = np.random.default_rng(0)
    states = model.system.states
    at = {n: model.sizes[n] * rng.standard_normal((_BASES, 1)) for n in states}
    for name, unit in states.items():
        turn = turn_in(unit)
        far = _FAR * model.sizes[name] if turn is None else _TURNS * turn
        yield {n: np.broadcast_to(v, (_BASES, _ALONG)) for n, v in at.items()} | {
            name: at[name] + far * along
        }


def _leaves(model: LogModel, name: str, turn: float, shown: FloatArray) -> bool:
    """Whether readings go where a function never does, or jump themselves; True for no output."""
    names = [output.name for output in model.system.outputs]
    if name not in names:
        return True
    rows = [log.outputs[names.index(name)] for log in model.logs]
    beside = _BESIDE * turn
    low, high = float(np.nanmin(shown)) - beside, float(np.nanmax(shown)) + beside
    return any(
        np.nanmin(row) < low
        or np.nanmax(row) > high
        or unwrapped(row, turn, np.arange(len(row), dtype=float)).places > 0
        for row in rows
    )


def _ends(shown: FloatArray) -> str:
    return minus(f"{np.nanmin(shown):.3g} to {np.nanmax(shown):.3g}")
