"""HDF5, MATLAB's version 7.3 among it: a dataset for each column, by its path in the file."""

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.log import (
    MOST_BYTES,
    Arrays,
    Clock,
    Field,
    Values,
    elements,
    library,
    refused,
    require_size,
    require_values,
    unreadable,
)

_MOST_DATASETS = 10_000


def open_log(path: Path, csv: Delimited) -> "Hdf5Log":
    """Open an HDF5 file."""
    require_size(path)
    return Hdf5Log(path, library(path, "h5py", "h5py", "hdf5"))


class Hdf5Log:
    """An HDF5 file's datasets of numbers; `/arm/q` and `arm/q` are the same."""

    def __init__(self, path: Path, h5py: Any) -> None:
        self.path, self.notes = path, list[str]()
        self._h5py = h5py
        self._shapes: dict[str, tuple[int, ...]] = {}
        self._units: dict[str, str | None] = {}
        self._kinds: dict[str, str] = {}
        self._in_file(self._list)
        self._arrays = Arrays(path, self._shapes)

    def fields(self) -> list[Field]:
        """Every dataset, tables number by number."""
        return [
            Field(name, unit=self._units[key], example=_example(self._kinds[key]))
            for key, shape in self._shapes.items()
            for name in elements(key, shape)
        ]

    def clock_of(self, address: str) -> Clock | None:
        """None: stamps are a dataset."""
        return None

    def read(self, addresses: Collection[str], stamps: Collection[str]) -> dict[str, Values]:
        """The columns of these addresses; each dataset is read whole."""
        plain = {address: address.lstrip("/") for address in addresses}
        keys = {self._arrays.split(name)[0] for name in plain.values()}
        require_values(self.path, sum(int(np.prod(self._shapes[key])) for key in keys))
        for address, name in plain.items():
            if self._kinds[self._arrays.split(name)[0]] not in "fiub":
                raise refused(self.path, address, "does not hold real numbers", "choose another")
        held: dict[str, Values] = {}
        self._in_file(lambda file: held.update({key: file[key][()] for key in keys}))
        arrays = {name: held[self._arrays.split(name)[0]] for name in plain.values()}
        return {a: self._arrays.column(name, arrays[name]) for a, name in plain.items()}

    def place(self, address: str, index: int) -> str:
        """The number of a sample, from 0 on."""
        return f"sample {index}"

    def _in_file(self, what: Any) -> None:
        try:
            with self._h5py.File(self.path, "r") as file:
                what(file)
        except Exception as error:  # h5py raises whatever is near to what its C library says
            raise unreadable(self.path, error) from error

    def _list(self, file: Any) -> None:
        def visit(name: str, item: Any) -> None:
            if not isinstance(item, self._h5py.Dataset) or item.dtype.hasobject:
                return
            if len(self._shapes) >= _MOST_DATASETS or item.nbytes > MOST_BYTES or item.external:
                raise ValueError(f"{name} is larger than a log is, or lies elsewhere")
            if item.shape is not None and item.dtype.names is None:
                self._shapes[name], self._kinds[name] = item.shape, item.dtype.kind
                self._units[name] = _unit(item)

        file.visititems(visit)


def _unit(item: Any) -> str | None:
    told = next((item.attrs[name] for name in ("unit", "units") if name in item.attrs), None)
    if isinstance(told, bytes):
        told = told.decode("utf-8", "replace")
    return told if isinstance(told, str) and told else None


def _example(kind: str) -> float | None:
    return 0.0 if kind in "fiub" else None
