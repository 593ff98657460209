"""A user's system, from a Python file: `my_robot.py`, or `my_robot.py:Robot` for one of several."""

import importlib.util
import shlex
import sys
import warnings
from collections.abc import Sequence
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType

import numpy as np

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.even_time import evened, unevenness
from wakedeploy.core.recording import Recording
from wakedeploy.domains.tables.formats.cells import is_missing, is_number
from wakedeploy.gap.systems.calls import attempted
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.own_system import System
from wakedeploy.gap.systems.system import FloatArray

OF_MJCF = (
    "is a MuJoCo model; `wakedeploy gap init my_robot.py --mjcf MODEL.xml` makes it a system, and "
    "that file is what --system takes."
)
_LATEST_S = 1e11  # seconds: clocks since 1970 show a sixtieth of it
_ENCODING = "utf-8-sig"  # with the mark before it that a spreadsheet writes, or without
_LARGEST = 1e15  # in any unit, nothing that was measured is so large


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
    name = wanted or next(iter(found))
    return checked(attempted(f"{file}, {name}()", found[name]))


def is_mjcf(path: Path) -> bool:
    """Whether a file is a MuJoCo model, by its name."""
    return path.suffix.lower() in (".xml", ".mjcf")


def read_plain(path: Path, system: System) -> Recording:
    """A CSV file whose columns have the system's names, and a `time_s` that rises evenly.

    A cell that is blank, or says that there is no number, is NaN. Raises UnusableInput for any
    other file; a `columns.toml` can say what that holds.
    """
    if path.is_dir():
        raise UnusableInput(f"{path} is a folder, not a CSV file; {_by_columns(path, system)}")
    try:
        with path.open(encoding=_ENCODING) as file:
            names = [n.strip().strip('"') for n in file.readline().split(",")]
            with warnings.catch_warnings():  # about a file without rows, which is refused below
                warnings.simplefilter("ignore")
                table = np.genfromtxt(file, delimiter=",", ndmin=2)
    except OSError as error:
        raise UnusableInput(f"{path}: {one_line(error)}; give a log that can be read.") from error
    except ValueError as error:  # UnicodeDecodeError is one
        raise UnusableInput(
            f"{path} is no CSV file of numbers; {_by_columns(path, system)}"
        ) from error
    if names == [""] and not table.size:
        raise UnusableInput(f"{path}: is empty; give a log with a header and rows.")
    if "time_s" in names and not table.size:
        raise UnusableInput(
            f"{path}: time_s needs two rows or more, and has none below the header; give another "
            "log."
        )
    if "time_s" not in names or table.shape[1:] != (len(names),):
        raise UnusableInput(
            f"{path}: no CSV with a time_s among {len(names)} columns; {_by_columns(path, system)}"
        )
    doubled = next((name for name in names if names.count(name) > 1), None)
    if doubled is not None:
        raise UnusableInput(f"{path}: two columns are called {doubled!r}; rename or remove one.")
    wanted = [*(i.name for i in system.logged), *(o.name for o in system.outputs)]
    _refuse_text(path, system, names, [k for k, name in enumerate(names) if name in wanted], table)
    columns = dict(zip(names, table.T, strict=True))
    time_s = columns.pop("time_s")
    if len(time_s) < 2 or not np.all(np.abs(time_s) < _LATEST_S):  # false for NaN, too
        raise UnusableInput(
            f"{path}: time_s needs two rows or more, each a number of seconds; mend the file."
        )
    for name in wanted:
        if np.any(np.abs(columns.get(name, 0.0)) > _LARGEST):  # NaN is a reading that is missing
            raise UnusableInput(
                f"{path}: column {name!r} has numbers beyond ±{_LARGEST:g}; mend the file."
            )
    if unevenness(time_s) is not None:
        raise UnusableInput(
            f"{path}: time_s does not rise evenly; say by --columns how to resample it."
        )
    return Recording(path.stem, evened(time_s), columns)


def _refuse_text(
    path: Path, system: System, names: Sequence[str], places: Sequence[int], table: FloatArray
) -> None:
    """Refuse a cell with text: where nothing was read, it has to say that there is no number."""
    if not np.isnan(table[:, places]).any():
        return
    with path.open(encoding=_ENCODING) as file:
        for number, line in enumerate(file, start=1):
            cells = line.partition("#")[0].split(",")
            if number == 1 or len(cells) != len(names):
                continue
            for k in places:
                cell = cells[k].strip()
                if not is_missing(cell.strip('"')) and not is_number(cell):
                    raise UnusableInput(
                        f"{path}: column {names[k]!r} holds {cell[:40]!r} in line {number}, which "
                        f"is no number; mend the file, or {_by_columns(path, system)}"
                    )


class _FromSource(SourceFileLoader):
    """Compiles a file each time it is read, and keeps nothing beside it.

    Bytecode that is kept passes for a file of the same size that was changed in the same second.
    """

    def get_code(self, fullname: str) -> CodeType:
        """The file's code as it is now."""
        return self.source_to_code(self.get_data(self.path), self.path)


def _module(file: Path) -> ModuleType:
    if is_mjcf(file):
        raise UnusableInput(f"{file} {OF_MJCF}")
    if not file.is_file():
        first = shlex.quote(str(file.with_suffix(".py")))
        raise UnusableInput(
            f"{file}: no such file; `wakedeploy gap init {first}` writes a first one."
        )
    if file.suffix != ".py":
        raise UnusableInput(f"{file} is no Python file; give one that ends in .py.")
    name = f"system_{file.stem}"
    loader = _FromSource(name, str(file))
    spec = importlib.util.spec_from_file_location(name, file, loader=loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module
    try:
        loader.exec_module(module)
    except SyntaxError as error:
        raise UnusableInput(f"{file}, line {error.lineno}: {error.msg}.") from error
    except SystemExit as error:
        raise UnusableInput(
            f"{file} ends the program while it is read; put what runs as a script under "
            '`if __name__ == "__main__":`.'
        ) from error
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


def _by_columns(path: Path, system: System) -> str:
    return (
        "say by --columns what it holds, and begin it with: wakedeploy data import table "
        f"{shlex.quote(str(path))} --guess{_by_system(system)} --columns columns.toml"
    )


def _by_system(system: System) -> str:
    """The option that names a system's file; nothing where it was not read from one."""
    kind = type(system)
    module = sys.modules.get(kind.__module__)
    if module is None or not isinstance(module.__loader__, _FromSource):
        return ""
    several = f":{kind.__name__}" if len(_systems(module)) > 1 else ""
    return f" --system {shlex.quote(f'{module.__loader__.path}{several}')}"
