"""What reads HDF5 in a process of its own: `python hdf5_process.py FILE FOLDER SECONDS [DATASET…]`.

HDF5's C library hangs on some damaged files, and may crash on others; a process can be ended. It
lists the datasets of FILE in FOLDER/about.json, or writes the named ones as FOLDER/0.npy and so on.
What cannot be read is said on stderr. Imports neither the project nor anything but h5py and NumPy.
"""

import json
import resource
import sys
from pathlib import Path
from typing import Any

MOST_DATASETS = 10_000
MOST_BYTES = 2 << 30


def main() -> int:
    """List or read; 1 for a file that cannot be read."""
    file, folder, seconds, *names = sys.argv[1:]
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import h5py

    try:
        with h5py.File(file, "r") as opened:
            (_read if names else _list)(opened, Path(folder), names)
    except Exception as error:  # h5py raises whatever is near to what its C library says
        sys.stderr.write(str(error) or type(error).__name__)
        return 1
    return 0


def _read(opened: Any, folder: Path, names: list[str]) -> None:
    import numpy as np

    for number, name in enumerate(names):
        table, _, field = name.rpartition(".")
        array = opened[name][()] if name in opened else opened[table][field]
        np.save(folder / f"{number}.npy", array, allow_pickle=False)


def _list(opened: Any, folder: Path, names: list[str]) -> None:
    import h5py

    found: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or item.shape is None:
            return
        if len(found) >= MOST_DATASETS or item.nbytes > MOST_BYTES or item.external:
            raise ValueError(f"{name} is larger than a log is, or lies elsewhere")
        if not item.dtype.names and not item.dtype.hasobject:
            found[name] = [list(item.shape), item.dtype.kind, _unit(item)]
        for field in item.dtype.names or ():  # of a table whose rows hold several columns
            kind = item.dtype[field]
            if not kind.names and not kind.hasobject:
                shape = [*item.shape, *kind.shape]
                found[f"{name}.{field}"] = [shape, kind.base.kind, None]

    opened.visititems(visit)
    (folder / "about.json").write_text(json.dumps(found), "utf-8")


def _unit(item: Any) -> str | None:
    unit = next((item.attrs[name] for name in ("unit", "units") if name in item.attrs), None)
    if isinstance(unit, bytes):
        unit = unit.decode("utf-8", "replace")
    return unit if isinstance(unit, str) and unit else None


if __name__ == "__main__":
    sys.exit(main())
