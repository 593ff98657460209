"""A user's system, from a Python file: `my_robot.py`, or `my_robot.py:Robot` for one of several."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.gap.systems.system import System, checked


def read_system(place: str | Path) -> System:
    """The system that a file defines, checked.

    Raises UnusableInput for a file that is absent, does not run, or defines no system or several
    (then `FILE:CLASS` says which).
    """
    path, _, wanted = str(place).partition(".py:")
    file = Path(f"{path}.py" if wanted else path)
    found = _systems(_module(file))
    if wanted and wanted not in found:
        raise UnusableInput(f"{file}: no system {wanted!r}; there are: {', '.join(found)}.")
    if not found:
        raise UnusableInput(f"{file}: no class derived from System; write one, see `gap init`.")
    if not wanted and len(found) > 1:
        raise UnusableInput(f"{file} has the systems {', '.join(found)}; give {file}:NAME.")
    return checked(found[wanted or next(iter(found))]())


def _module(file: Path) -> ModuleType:
    if not file.is_file():
        raise UnusableInput(
            f"{file}: no such file; `wakedeploy gap init {file}` writes a first one."
        )
    spec = importlib.util.spec_from_file_location(f"system_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise UnusableInput(f"{file} is no Python file; give one that ends in .py.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise UnusableInput(f"{file}, line {error.lineno}: {error.msg}.") from error
    except Exception as error:  # whatever the user's file raises
        raise UnusableInput(f"{file}: {type(error).__name__}: {one_line(error)}.") from error
    return module


def _systems(module: ModuleType) -> dict[str, type[System]]:
    """Classes that the file itself defines, in its order."""
    return {
        name: value
        for name, value in vars(module).items()
        if isinstance(value, type)
        and issubclass(value, System)
        and value.__module__ == module.__name__
    }
