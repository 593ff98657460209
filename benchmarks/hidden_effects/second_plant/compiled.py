"""Compilation with numba, remembered on disk where that is possible."""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

_F = TypeVar("_F", bound=Callable[..., Any])


def compiled(function: _F) -> _F:
    """The function in machine code."""
    compiler: Any = numba.njit
    try:
        fast: _F = compiler(cache=True, error_model="numpy")(function)
    except RuntimeError:  # neither the package's folder nor the user's cache can be written to
        fast = compiler(error_model="numpy")(function)
    return fast
