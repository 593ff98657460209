"""Arguments of the public functions: judged before minutes are spent, and named as Python has them.

In: what a caller gave. Out: the same, or one sentence with the argument, its value and its bounds.
"""

import functools
import inspect
import numbers
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any, ParamSpec, TypeVar, get_args

import numpy as np

from wakedeploy.core.errors import UnusableInput, WakedeployError, callers, is_callers, own_errors
from wakedeploy.core.names import near

P = ParamSpec("P")
R = TypeVar("R")

# Bounds that the options of the commands have, too.
MOST_SEEDS, MOST_TRIALS, MOST_PROCESSES = 1000, 1_000_000, 256
LEAST_MINUTES, MOST_MINUTES = 0.1, 10_000.0  # of a simulation

# Called while work goes on, from threads, too: what cannot be called is to be known before.
_CALLED = ("progress", "tell", "warn", "on_begun")

# Options whose argument is called otherwise; all others are called alike.
_ARGUMENTS = {
    "lead": "lead_s",
    "dimension": "dimensions",
    "start": "starts",
    "package": "packages",
    "cflags": "flags",
}
# Commands stay, in backticks or not; "--fresh (fresh=True)" has the argument already.
_OPTION = re.compile(
    r"`[^`]*`|\b(?:wakedeploy|run-gantry) [^;]*|--(?P<option>[a-z][a-z-]*)"
    r"(?: (?P<value>\w+))?(?: \((?:in Python, )?(?P<said>\w+=[^)]*)\))?"
)


def whole(name: str, value: object, low: int, high: int) -> int:
    """A whole number between two bounds, both allowed; UnusableInput names the argument."""
    is_whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not is_whole or not low <= int(value) <= high:  # type: ignore[call-overload]
        raise UnusableInput(f"{name} is {value!r:.60}: give a whole number from {low} to {high}.")
    return int(value)  # type: ignore[call-overload, no-any-return]


def real(name: str, value: object, low: float, high: float) -> float:
    """A number between two bounds, both allowed, and not nan; as `whole`."""
    is_real = isinstance(value, numbers.Real) and not isinstance(value, bool)
    if not is_real or not low <= float(value) <= high:  # type: ignore[arg-type]
        raise UnusableInput(f"{name} is {value!r:.60}: give a number from {low:g} to {high:g}.")
    return float(value)  # type: ignore[arg-type]


def one_of(name: str, value: object, known: Collection[str]) -> str:
    """One of some words; as `whole`."""
    if value not in known:
        raise UnusableInput(f"{name} is {value!r:.60}: give {' or '.join(known)}.")
    return str(value)


def words(name: str, given: str | Sequence[str]) -> tuple[str, ...]:
    """One word or several, in order; UnusableInput for what is no text."""
    several = (
        tuple(given) if isinstance(given, Iterable) and not isinstance(given, str) else (given,)
    )
    for each in several:
        if not isinstance(each, str):
            raise UnusableInput(f"{name} has {each!r:.60}: give text, such as {name}=('…',).")
    return several


def in_python(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function's errors name its arguments, where no command has called it.

    What it calls is shared with the command line, and names options: `--out` becomes `out`. A file
    that cannot be used is told as a command tells it. Keywords that are on or off, text or called
    are of that kind.
    """
    known, keywords, kinds = _names(function), _keywords(function), _kinds(function)

    @functools.wraps(function)
    def named(*args: P.args, **kwargs: P.kwargs) -> R:
        for name in kwargs if keywords else ():
            if name not in keywords:
                raise TypeError(_unexpected(function.__name__, name, keywords))
        if _in_command():
            return function(*args, **kwargs)
        try:
            for name, value in kwargs.items():
                _require_kind(name, value, kinds.get(name))
                if name in _CALLED and callable(value):
                    kwargs[name] = callers(value)
            with own_errors():
                return function(*args, **kwargs)
        except WakedeployError as error:
            if not is_callers(error):
                error.args = (_reworded(str(error), known), *error.args[1:])
            raise

    return named


def _kinds(function: Callable[..., object]) -> dict[str, Any]:
    """What each argument is annotated with, as far as Python knows it without other modules."""
    kinds: dict[str, Any] = {}
    for name, parameter in inspect.signature(function).parameters.items():
        kinds[name] = parameter.annotation
        for held in get_args(parameter.annotation):
            kinds |= getattr(held, "__annotations__", {})
    return kinds


def _require_kind(name: str, value: object, kind: Any) -> None:
    """UnusableInput for a value that is no switch, no text or cannot be called where it has to."""
    if value is None and "None" in str(kind):
        return
    if kind in (bool, bool | None) and not isinstance(value, bool | np.bool_):
        raise UnusableInput(f"{name} is {value!r:.60}: give True or False.")
    texts = str if kind == str | None else str | os.PathLike  # as the file of a preset
    if kind in (str, str | None) and not isinstance(value, texts):
        raise UnusableInput(f"{name} is {value!r:.60}: give text.")
    if name in _CALLED and not callable(value):
        raise UnusableInput(f"{name} is {value!r:.60}: give a function to call.")


def _names(function: Callable[..., object]) -> set[str]:
    """The arguments of a function, those included that a dictionary of keywords may hold."""
    parameters = inspect.signature(function).parameters
    names = set(parameters)
    for each in parameters.values():
        for held in get_args(each.annotation):
            names |= set(getattr(held, "__annotations__", ()))
    return names


def _keywords(function: Callable[..., object]) -> set[str]:
    """What a function may be given by name; empty where it judges the names itself."""
    parameters = inspect.signature(function).parameters.values()
    others = {p.name for p in parameters if p.kind is p.VAR_KEYWORD}
    is_open = any(p.name in others and not get_args(p.annotation) for p in parameters)
    return set() if is_open else _names(function) - others


def _unexpected(function: str, name: str, known: Collection[str]) -> str:
    """Python's own words for a keyword that a function does not have, and the one that is near.

    Python itself takes any that a dictionary of keywords holds: they were ignored, or told of as
    those of a class that nobody has called.
    """
    hint = f"; did you mean {close[0]}?" if (close := near(name, sorted(known))) else ""
    return f"{function}() got an unexpected keyword argument {name!r}{hint}"


def _in_command() -> bool:
    click = sys.modules.get("click")
    return click is not None and click.get_current_context(silent=True) is not None


def _reworded(sentence: str, known: Collection[str]) -> str:
    def argument(found: re.Match[str]) -> str:
        option = found["option"]
        if option is None:
            return found[0]
        is_off = option.startswith("no-")
        option = option.removeprefix("no-")
        name = _ARGUMENTS.get(option, option.replace("-", "_"))
        if found["said"]:
            return f"{found['said']}"
        if name not in known:
            return found[0]
        if is_off:
            return f"{name}=False{' ' + found['value'] if found['value'] else ''}"
        return name if found["value"] is None else f"{name} {found['value']}"

    return _OPTION.sub(argument, sentence)
