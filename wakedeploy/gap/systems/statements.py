"""What a user's system states: each of the form that it has to have, and all of it together.

In: a `StateSpace`. Out: nothing, or UnusableInput with one sentence: what, where, what to write.
"""

import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.names import one_of
from wakedeploy.core.units import SHOWN_ALONE, is_known, same_unit
from wakedeploy.gap.systems.ports import Port
from wakedeploy.gap.systems.system import Constant, Input, Output, StateSpace

HOLDS = ("step", "linear", "bandlimited")
MOST_STEPS = 64
_MOST_OUTLIERS = 0.5  # where more are wrong than right, no reading says which


def check_statements(system: StateSpace) -> None:
    """UnusableInput for what is missing, of another form, unknown, or does not go together."""
    for attribute in ("rate_hz", "inputs", "states", "outputs"):
        if not hasattr(system, attribute):
            raise UnusableInput(f"{system.name}: no `{attribute}`; state it in the class.")
    if not (_is_real(system.rate_hz) and 0.0 < system.rate_hz < math.inf):
        raise UnusableInput(f"{system.name}.rate_hz is {system.rate_hz!r}; give samples a second.")
    _check_forms(system)
    _check_noise(system)
    if type(system.costs_by_point) is not bool:
        raise UnusableInput(
            f"{system.name}.costs_by_point is {system.costs_by_point!r}; give True or False."
        )
    if isinstance(system.exported, str) or not all(
        isinstance(name, str) and Path(name).name == name for name in system.exported
    ):
        raise UnusableInput(
            f"{system.name}.exported is {system.exported!r}; give a list of file names."
        )
    if type(system.steps) is not int or not 1 <= system.steps <= MOST_STEPS:
        raise UnusableInput(
            f"{system.name}.steps is {system.steps!r}; give a whole number from 1 to {MOST_STEPS}."
        )
    if system.has_step and system.steps > 1:
        raise UnusableInput(
            f"{system.name} has a `step` of its own, a sample long; leave out `steps`, or write a "
            "`derivative`."
        )
    stated: list[Input | Output | Constant]
    stated = [*system.inputs, *system.outputs, *system.constants]
    for each in stated:
        _check_numbers(system, each)
    if not system.states or not system.outputs:
        raise UnusableInput(f"{system.name}: at least one state and one output are needed.")
    if system.has_step == callable(getattr(system, "derivative", None)):
        which = "both" if system.has_step else "neither"
        raise UnusableInput(
            f"{system.name} has {which} of `derivative` and `step`; write one of them."
        )
    _check_names(system)


def _check_forms(system: StateSpace) -> None:
    """UnusableInput for one thing where a list of them is asked for, or no dict of states."""
    stated = {"inputs": Input, "outputs": Output, "constants": Constant, "ports": Port}
    for attribute, kind in stated.items():
        given = getattr(system, attribute)
        written = "Port.input(name), …" if kind is Port else f"{kind.__name__}(name, …)"
        if isinstance(given, (str, Mapping, kind)) or not isinstance(given, Iterable):
            raise UnusableInput(
                f"{system.name}.{attribute} is {given!r:.60}; give a list, as [{written}]."
            )
        for each in given:
            if not isinstance(each, kind):
                raise UnusableInput(f"{system.name}.{attribute} has {each!r:.60}; write {written}.")
    states = system.states
    if not isinstance(states, Mapping) or not all(isinstance(n, str) for n in states):
        raise UnusableInput(
            f"{system.name}.states is {states!r:.60}; give the unit of each by its name, as "
            '{"speed_mps": "m/s"}.'
        )


def _check_noise(system: StateSpace) -> None:
    """UnusableInput for a share, a time or sizes by state that cannot be one."""
    share, ahead_s = system.outlier_share, system.forecast_s
    if not (_is_real(share) and 0.0 <= share < _MOST_OUTLIERS):
        raise UnusableInput(
            f"{system.name}.outlier_share is {share!r}; give a share of the readings, from 0 to "
            f"below {_MOST_OUTLIERS:g}, as 0.01."
        )
    if ahead_s is not None and not (_is_real(ahead_s) and 0.0 < ahead_s < math.inf):
        raise UnusableInput(
            f"{system.name}.forecast_s is {ahead_s!r}; give seconds above 0, or leave it out."
        )
    for attribute in ("process_noise", "start_spread"):
        sizes = getattr(system, attribute)
        if not isinstance(sizes, Mapping):
            raise UnusableInput(
                f"{system.name}.{attribute} is {sizes!r:.60}; give a size by the name of each "
                f'state, as {{"{next(iter(system.states), "speed_mps")}": 0.1}}.'
            )
        for name, size in sizes.items():
            if name not in system.states:
                raise UnusableInput(
                    f"{system.name}: {attribute} names {name!r}, which is no state; there are: "
                    f"{', '.join(system.states)}."
                )
            if not (_is_real(size) and 0.0 <= size < math.inf):
                raise UnusableInput(
                    f"{system.name}: {attribute} of {name!r} is {size!r:.60}; give a number from 0."
                )


def _check_numbers(system: StateSpace, stated: Input | Output | Constant) -> None:
    """UnusableInput for a field that is to be a number, and is a text or a list."""
    for each in fields(stated):
        value = getattr(stated, each.name)
        kind = str(each.type)
        if each.name == "delay_s" or "float" not in kind or (value is None and "None" in kind):
            continue  # a delay has a sentence of its own
        if not _is_real(value):
            raise UnusableInput(
                f"{system.name}: {each.name} of {type(stated).__name__}({stated.name!r}) is "
                f"{value!r:.60}; give a number."
            )


def _check_names(system: StateSpace) -> None:
    groups = (system.inputs, system.outputs, system.constants)
    for group in groups:
        names = [each.name for each in group]
        for name in names:
            if not isinstance(name, str) or not name.isidentifier():
                raise UnusableInput(f"{system.name}: {name!r} is no name; use letters and _.")
            if names.count(name) > 1:
                raise UnusableInput(f"{system.name}: {name!r} is stated twice; drop one.")
    for name in {i.name for i in system.inputs} & {*system.states, *names_of(system.outputs)}:
        raise UnusableInput(f"{system.name}: {name!r} is an input and a state; rename one.")
    for i in system.inputs:
        if i.low is not None and i.high is not None and not i.low < i.high:
            raise UnusableInput(
                f"{system.name}: input {i.name!r} has the limits {i.low} and {i.high}; give the "
                "lower one first."
            )
        if not isinstance(i.delay_s, int | float) or not 0.0 <= i.delay_s < math.inf:
            raise UnusableInput(
                f"{system.name}: input {i.name!r} has the delay_s {i.delay_s!r}; give seconds, of "
                "0 or more."
            )
        _check_law(system, i)
        if i.hold not in HOLDS:
            raise UnusableInput(
                f"{system.name}: input {i.name!r} holds {i.hold!r}, not {one_of(HOLDS)}; give one "
                "of these."
            )
    for o in system.outputs:
        if o.noise is not None and not 0.0 <= o.noise < math.inf:
            raise UnusableInput(
                f"{system.name}: output {o.name!r} has the noise {o.noise}; give one from 0."
            )
    for c in system.constants:
        low, high = c.bounds
        if not (math.isfinite(c.value) and c.spread >= 0.0 and low <= c.value <= high):
            raise UnusableInput(
                f"{system.name}: constant {c.name!r} is {c.value:g} with spread {c.spread:g} in "
                f"[{low:g}, {high:g}]; give a finite value within its bounds, and a spread from 0."
            )
    _check_units(system)


def _check_law(system: StateSpace, stated: Input) -> None:
    """Refuse a hold or limits on a computed input: its sources have them."""
    if stated.law is None:
        return
    where = f"{system.name}: the law of input {stated.name!r}"
    if not callable(stated.law):
        raise UnusableInput(f"{where} is {stated.law!r}; give a function of the logged inputs.")
    if stated.hold != "step" or stated.low is not None or stated.high is not None:
        raise UnusableInput(
            f"{where} makes it of what is logged: state `hold`, `low` and `high` of that."
        )


def _check_units(system: StateSpace) -> None:
    """Refuse an unknown unit, and another one of an output than of the state that it is.

    "" means none, or for a constant the unit that its name says.
    """
    stated = [("input", i.name, i.unit) for i in system.inputs]
    stated += [("output", o.name, o.unit) for o in system.outputs]
    stated += [("state", name, unit) for name, unit in system.states.items()]
    stated += [("constant", c.name, c.unit) for c in system.constants]
    for what, name, unit in stated:
        if not is_unit(unit):
            raise UnusableInput(
                f"{system.name}: {what} {name!r} has the unit {unit!r}, which is not known; give "
                'one such as m, rad, N m, V, A or m/s^2, "1" for none.'
            )
    if hasattr(system, "measure"):  # which may convert
        return
    for output in system.outputs:
        unit = system.states.get(output.name, output.unit)
        if not {unit, output.unit} & {"", "1"} and not same_unit(unit, output.unit):
            raise UnusableInput(
                f"{system.name}: output {output.name!r} is the state of that name, which is in "
                f"{unit}, and not in {output.unit}; state one unit, or convert it in `measure`."
            )


def is_unit(given: Any) -> bool:
    """Whether it is a unit that the project knows, "" for none."""
    return isinstance(given, str) and (given in SHOWN_ALONE or is_known(given))


def _is_real(value: Any) -> bool:
    """Whether it is one number; an array of no dimension is, as a calculation leaves one."""
    value = value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def names_of(stated: Sequence[Input] | Sequence[Output] | Sequence[Constant]) -> tuple[str, ...]:
    """The names of what is stated, in its order."""
    return tuple(each.name for each in stated)
