"""The plant's four hooks across a process boundary: named, not passed."""

import importlib
from collections.abc import Mapping
from typing import Any

from wakedeploy.errors import UnusableInput, one_line

HOOKS = ("command_hook", "force_hook", "sensor_hook", "wake_hook")


def load_hooks(name: str) -> dict[str, Any]:
    """Call `MODULE:FUNCTION`, which returns a mapping of hook names to functions.

    The module is looked for where Python looks, the current folder of a plant process included.
    Raises UnusableInput when there is no such function, it fails, or it returns something else.
    """
    module_name, _, function_name = name.partition(":")
    try:
        function = getattr(importlib.import_module(module_name), function_name)
    except (ImportError, AttributeError, ValueError) as error:
        raise UnusableInput(
            f"--hooks {name}: no such function ({one_line(error)}); name one as MODULE:FUNCTION."
        ) from error
    except (Exception, SystemExit) as error:  # a module may do anything while it is imported
        raise UnusableInput(f"--hooks {name}: {module_name} fails: {_told(error)}.") from error
    try:
        hooks = function()
    except (Exception, SystemExit) as error:
        raise UnusableInput(f"--hooks {name}: {function_name} fails: {_told(error)}.") from error
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
    return dict(hooks)


def _told(error: BaseException) -> str:
    return f"{type(error).__name__}: {one_line(error)}"
