"""NumPy's `.npz`: an array for each column, or a table of which an index or a field chooses."""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import numpy as np

from wakedeploy.core.archive import arrays_in, read_archive
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats.arrays import ArrayLog
from wakedeploy.domains.tables.log import Values, require_size, unreadable

_PICKLED = (
    "holds pickled objects of Python, which are not read",
    "where it is a column, save it as numbers: np.savez(…, NAME=np.array(…, dtype=float))",
)


def open_log(path: Path, csv: Delimited) -> ArrayLog:
    """Open an archive of arrays; objects of Python beside them are named and left."""
    require_size(path)
    try:
        is_read = arrays_in(path)
        arrays = dict(_columns(read_archive(path, {name for name, can in is_read.items() if can})))
    except (OSError, ValueError) as error:
        raise unreadable(path, error) from error
    unread = {name: _PICKLED for name, can in is_read.items() if not can}

    def load(names: Collection[str] | None) -> dict[str, Values]:
        return {**arrays, **{name: np.array([], dtype=object) for name in unread}}

    return ArrayLog(path, load, unread=unread)


def _columns(arrays: Mapping[str, Values]) -> Iterator[tuple[str, Values]]:
    """The arrays, those whose rows hold several columns field by field."""
    for name, array in arrays.items():
        if array.dtype.names is None:
            yield name, array
        for field in array.dtype.names or ():
            yield f"{name}.{field}", array[field]
