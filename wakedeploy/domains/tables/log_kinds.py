"""Which kind of log a file is, by its name or its first bytes; and its reader.

In: a path. Out: a `Log`, opened by the module of its kind in `formats`.
"""

import importlib
import itertools
import os
import re
from pathlib import Path

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats import seen_form as text
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

_SPREADSHEET = "is a spreadsheet; save its sheet as CSV"
_JSON = "is JSON; write it as CSV, as by pandas.read_json(…).to_csv(…)"
_JSON_LINES = _JSON.replace("(…)", "(…, lines=True)", 1)
_FOREIGN = {  # what people have besides, by how a name ends, and what to do
    ".xlsx": _SPREADSHEET, ".xls": _SPREADSHEET, ".xlsm": _SPREADSHEET, ".ods": _SPREADSHEET,
    ".bag": "is a bag of ROS 1; rosbags-convert --src {} --dst FOLDER makes one of rosbag2",
    ".json": _JSON, ".jsonl": _JSON_LINES, ".ndjson": _JSON_LINES,
    ".tdms": "is TDMS of LabVIEW; write it as CSV, as by nptdms.TdmsFile(…).as_dataframe()",
    ".mf4": "is MDF; export it as CSV or Parquet, as by asammdf",
    ".mdf": "is MDF; export it as CSV or Parquet, as by asammdf",
    ".npy": "is an array without names; give each column one, by np.savez(…, t=…, q=…)",
    ".pkl": "is a pickle, which is a program; write CSV, as by DataFrame.to_csv(…)",
    ".pickle": "is a pickle, which is a program; write CSV, as by DataFrame.to_csv(…)",
    ".feather": "is Feather; write Parquet, as by pandas.read_feather(…).to_parquet(…)",
    ".bin": "is a log of its own kind; convert it with the program that wrote it, to CSV",
    ".zstd": "is compressed; unpack it by zstd -d {}, or record bags without compression",
    ".zst": "is compressed; unpack it by zstd -d {}",
    ".tlog": "is a log of MAVLink; convert it, as by mavlogdump.py --format csv",
}  # fmt: skip
_DATAFLASH = (b"FMT, ", b"\xa3\x95")  # as ArduPilot begins its logs, as text and as bytes
_ARDUPILOT = (
    "is a log of ArduPilot; convert one kind of its messages, as by mavlogdump.py --format csv "
    "--types IMU"
)
_TEXTS = {".json", ".jsonl", ".ndjson"}  # of these, that are text and yet no table
_NUMBER = re.compile(r"_([0-9]+)$")  # of a part of a bag
_NAMED = 3  # bags of a folder
_MOST_FOLDERS = 1000  # that are looked through for logs
_TEXT_BYTES = 4096  # of a file without a known name that show whether it is text


def open_log(path: Path, csv: Delimited) -> Log:
    """Open a log of any kind that is known; UnusableInput says which kinds there are."""
    module = importlib.import_module(f"wakedeploy.domains.tables.formats.{_format(path)}")
    opened: Log = module.open_log(path, csv)
    return opened


def seen_form(path: Path) -> Delimited:
    """How a log that is a table of text is written, as far as it can be seen."""
    if _format(path) != "delimited":
        return Delimited()
    return text.seen_form(path)


def is_log(path: Path) -> bool:
    """Whether a path is one log: a file, or a folder that rosbag2 wrote.

    A recorder that was killed leaves no metadata.yaml. Its files are known by their names then.
    """
    return not path.is_dir() or (path / "metadata.yaml").is_file() or bool(_parts(path))


def _parts(folder: Path) -> list[Path]:
    """The files of a folder that are the parts of one bag, and all of its logs; else none.

    rosbag2 numbers them from 0 on behind the bag's name, which is the folder's. MCAP files of other
    names may be recordings of their own, and so may files with other numbers.
    """
    files = [p for p in folder.iterdir() if p.is_file() and is_named_as_log(p)]
    stems = {_NUMBER.sub("", p.stem) for p in files}
    kinds = {p.suffix.lower() for p in files}
    numbers = [int(number[1]) for p in files if (number := _NUMBER.search(p.stem))]
    is_bag = kinds == {".db3"} or (kinds == {".mcap"} and stems == {folder.absolute().name})
    is_one = len(files) == 1 or sorted(numbers) == list(range(len(files)))
    return files if is_bag and is_one and len(stems) == 1 else []


def is_named_as_log(path: Path) -> bool:
    """Whether a file is a log by how its name ends; `.txt` may be any text."""
    return path.suffix.lower() in _FORMATS and path.suffix.lower() != ".txt"


def of_bags(folder: Path) -> UnusableInput | None:
    """The sentence for a folder that holds bags of ROS; None for any other.

    Who keeps tables beside them has taken these from the bags, and means them.
    """
    inside = sorted(folder.iterdir())
    if any(is_named_as_log(p) for p in inside):
        return None
    old = next((p for p in inside if p.suffix.lower() == ".bag" and p.is_file()), None)
    if old is not None:
        return UnusableInput(f"{old}: {_FOREIGN['.bag'].format(old)}.")
    packed = next((p for p in inside if p.suffix.lower() == ".zstd" and p.is_file()), None)
    if packed is not None:
        return UnusableInput(f"{packed}: {_FOREIGN['.zstd'].format(packed)}.")
    bags = [name for p in inside if p.is_dir() and (name := _bag_in(p))]
    if not bags:
        return None
    named = ", ".join(bags[:_NAMED]) + (f" and {len(bags) - _NAMED} more" if bags[_NAMED:] else "")
    every = "" if any("/" in name for name in bags) else f", {folder}/*/"
    return UnusableInput(f"{folder}: is a folder that holds bags ({named}); give these{every}.")


def of_folders(folder: Path) -> UnusableInput | None:
    """The sentence for a folder whose logs lie in folders within it; None for any other."""
    if any(p.is_file() and is_named_as_log(p) for p in folder.iterdir()):
        return None
    for at, _, names in itertools.islice(os.walk(folder), _MOST_FOLDERS):
        inner = Path(at)
        logs = sorted(p for name in names if is_named_as_log(p := inner / name))
        if logs and inner != folder:
            files = f"{inner}/*{logs[0].suffix}"
            return UnusableInput(
                f"{folder}: its logs lie in {inner}; give these files, as {files}."
            )
    return None


def _bag_in(folder: Path) -> str:
    """A folder that is a bag, or its only part where it lacks a metadata.yaml; else nothing."""
    if (folder / "metadata.yaml").is_file() or len(_parts(folder)) > 1:
        return folder.name
    parts = (p.name for ending in ("db3", "zstd") for p in folder.glob(f"*.{ending}"))
    part = min(parts, default="")
    return f"{folder.name}/{part}" if part else ""


def _format(path: Path) -> str:
    if path.is_dir():
        return "rosbag"
    suffixes = [s.lower() for s in path.suffixes[-2:]]
    by_name = _FORMATS.get(suffixes[-1] if suffixes else "")
    if suffixes[-1:] == [".gz"] and len(suffixes) > 1:
        by_name = "delimited" if _FORMATS.get(suffixes[0]) == "delimited" else None
    found = by_name or _by_first_bytes(path)
    last = suffixes[-1] if suffixes else ""
    if by_name is None and last in _FOREIGN and (found in (None, "npz") or last in _TEXTS):
        raise UnusableInput(f"{path}: {_FOREIGN[last].format(path)}.")
    if found is None:
        known = "CSV (.gz), Parquet, npz, HDF5, MATLAB, MCAP, rosbag2 or ULog"
        raise UnusableInput(f"{path}: is no log of a kind that is known; give {known}.")
    return found


def _by_first_bytes(path: Path) -> str | None:
    try:
        with path.open("rb") as file:
            first = file.read(_TEXT_BYTES)
    except OSError as error:
        raise unreadable(path, error) from error
    if first.startswith(_DATAFLASH):
        raise UnusableInput(f"{path}: {_ARDUPILOT}.")
    known = next((kind for magic, kind in _MAGIC.items() if first.startswith(magic)), None)
    return known or ("delimited" if _is_table_of_text(first) else None)


def _is_table_of_text(begin: bytes) -> bool:
    """Whether a file begins as a table of text does, whatever its name: no JSON, XML or program."""
    text = begin.decode("latin-1").lstrip()
    is_printed = all(c >= " " or c in "\r\n\t\f" for c in text)
    return is_printed and bool(text) and text[0] not in "{[<" and "\n" in text
