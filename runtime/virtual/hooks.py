"""The plant's four hooks across a process boundary: named, not passed."""

import importlib
from typing import Any

from wakedeploy.errors import UnusableInput

HOOKS = ("command_hook", "force_hook", "sensor_hook", "wake_hook")


def load_hooks(name: str) -> dict[str, Any]:
    """Call `MODULE:FUNCTION`, which returns a mapping of hook names to functions.

    Raises UnusableInput when there is no such function or it returns something else.
    """
    module_name, _, function_name = name.partition(":")
    try:
        hooks = getattr(importlib.import_module(module_name), function_name)()
    except (ImportError, AttributeError, ValueError) as error:
        raise UnusableInput(
            f"--hooks {name}: no such function ({error}); name one as MODULE:FUNCTION."
        ) from error
    unknown = set(hooks) - set(HOOKS)
    if unknown:
        raise UnusableInput(f"--hooks {name}: {unknown.pop()!r} is none of {', '.join(HOOKS)}.")
    return dict(hooks)
