"""HDF5, MATLAB's version 7.3 among it: a dataset for each column, by its path in the file."""

import importlib.util
import json
import subprocess
import sys
import tempfile
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from wakedeploy.core.errors import UnusableInput, installs, shown
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats.cells import unit_in_brackets
from wakedeploy.domains.tables.log import (
    Arrays,
    Clock,
    Field,
    Values,
    elements,
    refused,
    require_size,
    require_values,
)

_READER = Path(__file__).with_name("hdf5_process.py")
_SLOWEST_S = 10  # for a small file
_BYTES_PER_S = 2_000_000  # one second more for this many bytes
_MOST_KEPT_BYTES = 16 << 20  # of what was read of a file


def open_log(path: Path, csv: Delimited) -> "Hdf5Log":
    """Open an HDF5 file."""
    if importlib.util.find_spec("h5py") is None:
        raise UnusableInput(f"{path}: needs h5py: {installs('hdf5')}.")
    return Hdf5Log(path)


class Hdf5Log:
    """An HDF5 file's datasets of numbers; `/arm/q` and `arm/q` are the same."""

    def __init__(self, path: Path) -> None:
        self.path, self.notes = path, list[str]()
        self._limit_s = _SLOWEST_S + require_size(path) // _BYTES_PER_S
        with tempfile.TemporaryDirectory() as folder:
            self._run(folder)
            about = json.loads((Path(folder) / "about.json").read_text("utf-8"))
        self._shapes = {name: tuple(shape) for name, (shape, _, _) in about.items()}
        self._kinds: dict[str, str] = {name: kind for name, (_, kind, _) in about.items()}
        self._units: dict[str, str | None] = {name: unit for name, (_, _, unit) in about.items()}
        self._arrays = Arrays(path, self._shapes)
        self._kept: dict[str, Values] = {}  # datasets that were read, while they are small

    def fields(self) -> list[Field]:
        """Every dataset, tables number by number."""
        return [
            Field(
                name,
                unit=self._units[key] or unit_in_brackets(key),
                example=_example(self._kinds[key]),
            )
            for key, shape in self._shapes.items()
            for name in elements(key, shape)
        ]

    def clock_of(self, address: str) -> Clock | None:
        """None: stamps are a dataset."""
        return None

    def read(self, addresses: Collection[str], stamps: Collection[str]) -> dict[str, Values]:
        """The columns of these addresses; each dataset is read whole."""
        plain = {address: address.lstrip("/") for address in addresses}
        keys = {address: self._arrays.split(name)[0] for address, name in plain.items()}
        for address, key in keys.items():
            if self._kinds[key] not in "fiub":
                raise refused(self.path, address, "does not hold real numbers", "choose another")
        needed = sorted(set(keys.values()))
        require_values(self.path, sum(int(np.prod(self._shapes[key])) for key in needed))
        held = self._datasets(needed)
        return {a: self._arrays.column(name, held[keys[a]]) for a, name in plain.items()}

    def place(self, address: str, index: int) -> str:
        """The number of a sample, from 0 on."""
        return f"sample {index}"

    def _datasets(self, names: Sequence[str]) -> dict[str, Values]:
        """Whole datasets. Who guesses what columns mean asks for the same ones again and again."""
        found = {name: self._kept[name].copy() for name in names if name in self._kept}
        found |= self._read([name for name in names if name not in found])
        if sum(array.nbytes for array in (self._kept | found).values()) <= _MOST_KEPT_BYTES:
            self._kept |= {n: array.copy() for n, array in found.items() if n not in self._kept}
        return found

    def _read(self, names: Sequence[str]) -> dict[str, Values]:
        if not names:
            return {}
        with tempfile.TemporaryDirectory() as folder:
            self._run(folder, *names)
            files = [Path(folder) / f"{number}.npy" for number in range(len(names))]
            return {n: np.load(f, allow_pickle=False) for n, f in zip(names, files, strict=True)}

    def _run(self, folder: str, *names: str) -> None:
        """Let a process list the file, or read datasets of it, into a folder."""
        limit = str(self._limit_s)
        command = [sys.executable, "-P", str(_READER), str(self.path), folder, limit, *names]
        try:
            ended = subprocess.run(  # noqa: S603 - our own file, and no shell
                command, capture_output=True, timeout=4 * self._limit_s, check=False
            )
            reason = shown(ended.stderr.decode("utf-8", "replace"))
        except subprocess.TimeoutExpired:
            ended, reason = None, ""
        if ended is None or ended.returncode < 0:
            reason = "the HDF5 library does not come to an end with it"
        if ended is None or ended.returncode:
            raise UnusableInput(f"{self.path}: cannot be read ({reason}); copy or record it again.")


def _example(kind: str) -> float | None:
    return 0.0 if kind in "fiub" else None
