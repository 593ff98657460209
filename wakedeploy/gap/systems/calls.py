"""Functions that a user wrote, called so that what fails in them is said by their name.

In: a function and its points. Out: what it returned, complete and in order; UnusableInput else.
"""

import re
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np

from wakedeploy.core.errors import UnusableInput

_REAL = ("f", "i", "u", "b")  # kinds of numpy's numbers: floats, integers, truths
_DO_NOT_FIT = "could not be broadcast"
_TOOK_ARRAYS = re.compile(r"truth value of an array|scalar arrays|0-dimensional arrays")

Returned = TypeVar("Returned")


def attempted(where: str, function: Callable[..., Returned], *given: Any) -> Returned:
    """What a user's function returns; `where` is what the user calls it."""
    try:
        return function(*given)
    except UnusableInput:
        raise
    except (Exception, SystemExit) as error:  # of a user's function, reported with its name
        raise UnusableInput(f"{where}: {_cause(error)}") from error


def called(where: str, method: Callable[..., Any], *points: Any) -> Mapping[str, Any]:
    """What a user's function returns, real numbers by name."""
    returned = attempted(where, method, *points)
    if type(returned) is not dict and not isinstance(returned, Mapping):
        raise UnusableInput(
            f"{where} returns {type(returned).__name__}; return a dict with a value by name."
        )
    for name, value in returned.items():
        if not _is_real(value):
            raise UnusableInput(
                f"{where} gives {_shortened(value)} for {name!r}, which is no real number; return "
                "a float, or an array of them."
            )
    return returned


def complete(
    returned: Mapping[str, Any], wanted: Mapping[str, str], where: str, what: str
) -> dict[str, Any]:
    """What was returned, in the order of what is wanted: nothing missing, nothing unknown."""
    if returned.keys() != wanted.keys():
        raise UnusableInput(_difference(returned, wanted, where, what))
    return {name: returned[name] for name in wanted}


def _difference(
    returned: Mapping[str, Any], wanted: Mapping[str, str], where: str, what: str
) -> str:
    """What is returned and not wanted, else what is wanted and not returned."""
    unknown = [name for name in returned if name not in wanted]
    if unknown:
        return (
            f"{where} returns {unknown[0]!r}, which is no {what}; there are: {', '.join(wanted)}."
        )
    missing = next(name for name in wanted if name not in returned)
    return f"{where} returns nothing for the {what} {missing!r}; add it."


def _is_real(value: Any) -> bool:
    """Whether numpy takes a value, or each of its parts, for a real number."""
    if type(value) is np.ndarray:
        return value.dtype.kind in _REAL
    if isinstance(value, (int, float)):
        return True
    if isinstance(value, (list, tuple)):
        return all(map(_is_real, value))
    return getattr(getattr(value, "dtype", None), "kind", "") in _REAL


def _shortened(value: Any) -> str:
    """A number as it is, an array by what it holds."""
    if isinstance(value, np.ndarray) and value.ndim:
        return f"an array of {value.dtype}"
    return f"{value!r:.60}"


def _cause(error: Exception | SystemExit) -> str:
    """What a user's function raised, and what to write where it took arrays for numbers."""
    if isinstance(error, SystemExit):
        return "it ends the program; let it return, or raise an error that says why."
    if _DO_NOT_FIT in str(error):
        return (
            f"its arrays do not fit each other ({str(error).strip(' .')}); it is called with "
            "arrays of several shapes, so leave each as it is: no reshape, no fixed length."
        )
    if _TOOK_ARRAYS.search(str(error)):
        return (
            f"it is called with arrays, and a line of it needs a single number ({error}); write "
            "np.where for if, np.maximum for max, np.sin for math.sin."
        )
    name = "" if isinstance(error, AttributeError) else f"{type(error).__name__}: "
    return f"{name}{str(error).rstrip('.')}."
