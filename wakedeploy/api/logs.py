"""Logs of any system: as a set for training, as recordings, and a first `columns.toml`."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from wakedeploy.api.arguments import in_python
from wakedeploy.api.inputs import PathLike
from wakedeploy.core.caller import warn_caller
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import path_from
from wakedeploy.core.names import unknown
from wakedeploy.gap.progress import Progress, quiet

if TYPE_CHECKING:
    from wakedeploy.api.systems import SystemLike
    from wakedeploy.core.episodes import EpisodeSet
    from wakedeploy.core.recording import Recording
    from wakedeploy.domains.tables.columns import Columns

Paths = PathLike | Sequence[PathLike]


@in_python
def import_table(
    files: Paths, columns: "Columns | PathLike", *, progress: Progress = quiet
) -> "EpisodeSet":
    """Read logs of any system as a set for training.

    Args:
        files: A log or several: CSV, Parquet, npz, HDF5, MATLAB, MCAP, rosbag2 or ULog; or folders
            of files that belong together.
        columns: What their columns mean, or the `columns.toml` that says so; some have the role
            observation and some the role force.
        progress: Called with a stage, the files done and their number.

    Returns:
        Episodes of observations (T, d) and forces (T, o) in the units of the set's channels; what
        was noticed is in `provenance["notes"]`.

    Raises:
        UnusableInput: Names file, column, row and reason.
    """
    from wakedeploy.domains.tables.training import import_set

    progress("Importing", 0, 1)
    return import_set(_paths(files), _columns(columns), _stage(progress))


@in_python
def read_log(
    files: Paths, columns: "Columns | PathLike", *, units: dict[str, str] | None = None
) -> "tuple[Recording, ...]":
    """Read logs of any system as recordings.

    What was noticed and handled, such as values that were held, comes as Python's warnings.

    Args:
        files: As for `import_table`.
        columns: What their columns mean, or the `columns.toml` that says so.
        units: The unit that a column's numbers are wanted in, by the column's name; that of
            `columns.toml`, or the SI unit, where nothing is said.

    Returns:
        A recording for each uninterrupted piece: `time_s` (T,) rises evenly, `columns` has arrays
        (T,) by name, `rate_hz` is the samples a second. What was not measured is NaN.

    Raises:
        UnusableInput: Names file, column, row and reason.
    """
    from wakedeploy.domains.tables.reading import read_recordings

    paths, known = _paths(files), _columns(columns)
    reading = read_recordings(paths, known, _units(units, known))
    for note in reading.notes:
        warn_caller(note)
    return reading.recordings


@in_python
def guess_columns(log: PathLike, system: "SystemLike | None" = None) -> str:
    """Write a first `columns.toml` for a log: its columns, and guesses of their units and clock.

    Args:
        log: A log, or a folder of files that belong together.
        system: What the log is of. A column that is called as one of its inputs or outputs, or is
            the only one in such a unit, gets its name, its role, and its unit where the log says
            none.

    Returns:
        The text of the file, in which a person gives some columns a role, or looks at what they
        got; a table (T, 6) of a log is six columns.

    Raises:
        UnusableInput: The log cannot be read, or holds no numbers; or the system cannot be used.
    """
    from wakedeploy.domains.tables.guess import guess_columns as guess

    paths = _paths(log)
    if len(paths) != 1:
        raise UnusableInput("Columns are guessed of one log; give a log, or a folder of its files.")
    path = paths[0]
    if system is None:
        return guess(path)
    from wakedeploy.api.systems import asked_of_logs, system_of

    known = system_of(system)
    return guess(path, asked_of_logs(known), known.rate_hz)


def _paths(files: Paths) -> list[Path]:
    if isinstance(files, str | bytes) or not isinstance(files, Sequence):
        files = [files]
    paths = [path_from(path, "log") for path in files]
    for path in paths:
        if not path.exists():
            is_pattern = not {"*", "?"}.isdisjoint(str(path))
            pattern = " A pattern is no path: give sorted(Path().glob(…))." if is_pattern else ""
            raise UnusableInput(f"{path}: is not there; correct the path of this log.{pattern}")
    return paths


def _columns(columns: "Columns | PathLike") -> "Columns":
    from wakedeploy.domains.tables.columns import Columns, read_columns

    return columns if isinstance(columns, Columns) else read_columns(path_from(columns, "columns"))


def _units(units: Mapping[str, str] | None, columns: "Columns") -> Mapping[str, str] | None:
    """The units by the columns' names; UnusableInput for a name that no column has."""
    if units is None:
        return None
    if not isinstance(units, Mapping):
        raise UnusableInput(f"units is {units!r:.60}: give {{NAME: unit}}.")
    for name, unit in units.items():
        if name not in columns.used:
            raise UnusableInput(f"units: {unknown(name, 'column of a role', columns.used)}.")
        if not isinstance(unit, str):
            raise UnusableInput(f"units has {unit!r:.60} for {name}: give text.")
    return units


def _stage(progress: Progress) -> Callable[[int, int], None]:
    return lambda done, total: progress("Importing", done, total)
