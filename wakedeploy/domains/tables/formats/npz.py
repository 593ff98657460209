"""NumPy's `.npz`: an array for each column, or a table of which an index chooses."""

from collections.abc import Collection
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
            return read_archive(path, names)
        except (OSError, ValueError) as error:
            raise unreadable(path, error) from error

    return ArrayLog(path, load)
