"""Which kind of log a file is, by its name or its first bytes; and its reader.

In: a path. Out: a `Log`, opened by the module of its kind in `formats`.
"""

import importlib
from pathlib import Path

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats import delimited
from wakedeploy.domains.tables.log import Log, unreadable

_FORMATS = {  # by how a name ends
    ".csv": "delimited", ".tsv": "delimited", ".txt": "delimited", ".dat": "delimited",
    ".parquet": "parquet", ".pq": "parquet", ".npz": "npz",
    ".h5": "hdf5", ".hdf5": "hdf5", ".hdf": "hdf5", ".mat": "mat",
    ".mcap": "mcap", ".db3": "rosbag", ".ulg": "ulog", ".ulog": "ulog",
}  # fmt: skip
_MAGIC = {
    b"PAR1": "parquet", b"PK\x03\x04": "npz", b"\x89HDF": "hdf5", b"MATLAB": "mat",
    b"\x89MCAP0": "mcap", b"SQLite": "rosbag", b"ULog\x01": "ulog",
}  # fmt: skip


def open_log(path: Path, csv: Delimited) -> Log:
    """Open a log of any kind that is known; UnusableInput says which kinds there are."""
    module = importlib.import_module(f"wakedeploy.domains.tables.formats.{_format(path)}")
    opened: Log = module.open_log(path, csv)
    return opened


def seen_form(path: Path) -> Delimited:
    """How a log that is a table of text is written, as far as it can be seen."""
    if _format(path) != "delimited":
        return Delimited()
    return delimited.seen_form(path)


def is_log(path: Path) -> bool:
    """Whether a path is one log: a file, or a folder that rosbag2 wrote."""
    return not path.is_dir() or (path / "metadata.yaml").is_file()


def _format(path: Path) -> str:
    if path.is_dir():
        return "rosbag"
    suffixes = [s.lower() for s in path.suffixes[-2:]]
    by_name = _FORMATS.get(suffixes[-1] if suffixes else "")
    if suffixes[-1:] == [".gz"] and len(suffixes) > 1:
        by_name = "delimited" if _FORMATS.get(suffixes[0]) == "delimited" else None
    found = by_name or _by_first_bytes(path)
    if found is None:
        known = "CSV (.gz), Parquet, npz, HDF5, MATLAB, MCAP, rosbag2 or ULog"
        raise UnusableInput(f"{path}: is no log of a kind that is known; give {known}.")
    return found


def _by_first_bytes(path: Path) -> str | None:
    try:
        with path.open("rb") as file:
            first = file.read(8)
    except OSError as error:
        raise unreadable(path, error) from error
    return next((kind for magic, kind in _MAGIC.items() if first.startswith(magic)), None)
