"""NumPy's `.npz`: an array for each column, or a table of which an index or a field chooses."""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from wakedeploy.core.archive import read_archive
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats.arrays import ArrayLog
from wakedeploy.domains.tables.log import Values, require_size, unreadable


def open_log(path: Path, csv: Delimited) -> ArrayLog:
    """Open an archive of arrays."""
    require_size(path)

    def load(names: Collection[str] | None) -> dict[str, Values]:
        try:
            return dict(_columns(read_archive(path, names)))
        except (OSError, ValueError) as error:
            raise unreadable(path, error) from error

    return ArrayLog(path, load)


def _columns(arrays: Mapping[str, Values]) -> Iterator[tuple[str, Values]]:
    """The arrays, those whose rows hold several columns field by field."""
    for name, array in arrays.items():
        if array.dtype.names is None:
            yield name, array
        for field in array.dtype.names or ():
            yield f"{name}.{field}", array[field]
