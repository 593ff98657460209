"""MATLAB's `.mat` of versions 5 to 7, read here, and 7.3, which is HDF5."""

from collections.abc import Collection
from pathlib import Path

import numpy as np

from wakedeploy.domains.matfile import Unread, read_mat
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats import hdf5
from wakedeploy.domains.tables.formats.arrays import ArrayLog
from wakedeploy.domains.tables.log import Log, Values, require_size, unreadable


def open_log(path: Path, csv: Delimited) -> Log:
    """Open a MATLAB file of any version from 5 on."""
    require_size(path)
    if _is_hdf5(path):
        return hdf5.open_log(path, csv)

    try:
        variables = read_mat(path)
    except (OSError, ValueError) as error:
        raise unreadable(path, error) from error
    arrays = {n: v for n, v in variables.items() if not isinstance(v, Unread)}
    unread = {n: v for n, v in variables.items() if isinstance(v, Unread)}

    def load(names: Collection[str] | None) -> dict[str, Values]:
        return {**arrays, **{name: np.array([], dtype=object) for name in unread}}

    return ArrayLog(path, load, unread=unread)


def _is_hdf5(path: Path) -> bool:
    """Whether it is version 7.3, which has MATLAB's header before HDF5's, or none."""
    try:
        with path.open("rb") as file:
            head = file.read(520)
    except OSError as error:
        raise unreadable(path, error) from error
    return b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:520])
