"""Logs of any kind as recordings: what the gap workflow and training both begin with.

In: files, or folders of files that belong together, and `Columns`. Out: a `Reading`: recordings in
the units that were asked for, and remarks on what was noticed and handled.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.domains.tables.columns import Columns
from wakedeploy.domains.tables.file_reader import FileReader
from wakedeploy.domains.tables.wanted import Wanted

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Reading:
    """Recordings by the file that each is a piece of, their units by column, and remarks."""

    pieces: Mapping[Path, tuple[Recording, ...]]
    units: Mapping[str, str]
    notes: tuple[str, ...]

    @property
    def recordings(self) -> tuple[Recording, ...]:
        """All of them, in the order of the files."""
        return tuple(recording for pieces in self.pieces.values() for recording in pieces)


def read_recordings(
    paths: Sequence[Path | str],
    columns: Columns,
    units: Mapping[str, str] | None = None,
    progress: Progress | None = None,
) -> Reading:
    """Read logs as recordings at an even rate.

    Args:
        paths: Files, folders of rosbag2, or folders of files that belong together.
        columns: What their columns mean; those without a role are left out.
        units: The unit that a column's numbers are wanted in, by the column's name; `to` of
            `columns.toml`, or the SI unit, where nothing is said.
        progress: Called with the files done and their number.

    Returns:
        Recordings whose columns are (n,) each, by their names in `columns`.

    Raises:
        UnusableInput: Names file, column, row and reason.
    """
    if not paths:
        raise UnusableInput("No log was given; name at least one file.")
    wanted = {
        name: Wanted(name, c, (units or {}).get(name), columns) for name, c in columns.used.items()
    }
    if not units:  # where a system asks, its units count
        for column in wanted.values():
            column.require_honest_name()
    pieces: dict[Path, tuple[Recording, ...]] = {}
    notes: list[str] = []
    names = _distinct([Path(path) for path in paths])
    for done, (path, name) in enumerate(names.items(), 1):
        pieces[path] = tuple(FileReader(path, name, columns, wanted, notes).recordings())
        if progress is not None:
            progress(done, len(names))
    return Reading(pieces, {name: column.unit for name, column in wanted.items()}, tuple(notes))


def _distinct(paths: Sequence[Path]) -> dict[Path, str]:
    """A name for each log: of its file, with its folder's where two files have one name."""
    names = {path: _plain(path.name) for path in paths}
    doubled = [name for name in names.values() if list(names.values()).count(name) > 1]
    chosen = {
        path: _plain(f"{path.absolute().parent.name}-{path.name}") if name in doubled else name
        for path, name in names.items()
    }
    for path, name in chosen.items():
        if list(chosen.values()).count(name) > 1:
            raise UnusableInput(f"{path}: two logs are called {name}; rename one of them.")
    return chosen


def _plain(name: str) -> str:
    """A file's name as a recording's: without its endings, letters that episodes may have."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "-", without_ending(name))
    return plain.strip("._-")[:80] or "log"


def without_ending(name: str) -> str:
    """A log's name without the ending of its format, such as `.csv` or `.csv.gz`."""
    formats = r"\.(gz|csv|tsv|txt|dat|parquet|pq|npz|h5|hdf5?|mat|mcap|db3|ulo?g)$"
    stem = re.sub(formats, "", name, flags=re.IGNORECASE)
    return re.sub(r"\.(csv|tsv|txt|dat)$", "", stem, flags=re.IGNORECASE)
