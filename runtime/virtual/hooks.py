"""The plant's four hooks by name: a person's own module says what the simulation shall hide."""

import functools
import importlib
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from wakedeploy.core.errors import CheckFailed, UnusableInput, one_line

HOOKS = ("command_hook", "force_hook", "sensor_hook", "wake_hook")


def load_hooks(name: str) -> dict[str, Any]:
    """Call `MODULE:FUNCTION`, which returns a mapping of hook names to functions.

    The module is looked for where Python looks, and first in the current folder. Raises
    UnusableInput when there is no such function, it fails, or it returns something else. A hook
    that fails later, in flight, raises CheckFailed with its name.
    """
    here = str(Path.cwd())
    if here not in sys.path and "" not in sys.path:
        sys.path.insert(0, here)  # which an installed command's own folder replaces
    module_name, _, function_name = name.partition(":")
    try:
        function = getattr(importlib.import_module(module_name), function_name)
    except (ImportError, AttributeError, ValueError) as error:
        raise UnusableInput(
            f"--hooks {name}: no such function ({one_line(error)}); name one as MODULE:FUNCTION."
        ) from error
    except (Exception, SystemExit) as error:  # a module may do anything while it is imported
        raise UnusableInput(
            f"--hooks {name}: {module_name} fails: {_error_text(error)}."
        ) from error
    try:
        hooks = function()
    except (Exception, SystemExit) as error:
        raise UnusableInput(
            f"--hooks {name}: {function_name} fails: {_error_text(error)}."
        ) from error
    return _checked(hooks, name)


def _checked(hooks: Any, name: str) -> dict[str, Any]:
    if not isinstance(hooks, Mapping):
        raise UnusableInput(
            f"--hooks {name}: it returns a {type(hooks).__name__}, not a mapping of hook names to "
            "functions."
        )
    for hook, function in hooks.items():
        if hook not in HOOKS:
            raise UnusableInput(f"--hooks {name}: {hook!r} is none of {', '.join(HOOKS)}.")
        if not callable(function):
            raise UnusableInput(f"--hooks {name}: its {hook} is no function.")
    return {hook: _named(hook, function, name) for hook, function in hooks.items()}


def _named(hook: str, function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """The hook, whose own errors say where they come from."""

    @functools.wraps(function)
    def called(t_s: float, *values: Any) -> Any:
        try:
            return function(t_s, *values)
        except Exception as error:  # a person's function may raise anything
            raise CheckFailed(
                f"--hooks {name}: its {hook} fails at {t_s:.3f} s: {_error_text(error)}."
            ) from error

    return called


def _error_text(error: BaseException) -> str:
    return f"{type(error).__name__}: {one_line(error)}"
