"""Logs that are whole arrays by name: what NumPy's and MATLAB's files have in common."""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import numpy as np

from wakedeploy.domains.tables.log import (
    Arrays,
    Clock,
    Field,
    Values,
    elements,
    refused,
    require_values,
    time_first,
)

Load = Callable[[Collection[str] | None], Mapping[str, Values]]


class ArrayLog:
    """A file's arrays; `load` gives all of them, or those of some names."""

    def __init__(self, path: Path, load: Load, units: Mapping[str, str] | None = None) -> None:
        self.path, self.notes = path, list[str]()
        self._held = dict(load(None))
        self._units = units or {}
        self._arrays = Arrays(path, {name: array.shape for name, array in self._held.items()})

    def fields(self) -> list[Field]:
        """Every array, tables number by number."""
        return [
            Field(name, unit=self._units.get(key), example=_example(array))
            for key, array in self._held.items()
            for name in elements(key, array.shape)
        ]

    def clock_of(self, address: str) -> Clock | None:
        """None: stamps are an array."""
        return None

    def read(self, addresses: Collection[str], stamps: Collection[str]) -> dict[str, Values]:
        """The columns of these addresses."""
        columns = {address: self._column(address) for address in addresses}
        require_values(self.path, sum(map(len, columns.values())))
        return columns

    def _column(self, address: str) -> Values:
        name, _ = self._arrays.split(address)
        column = self._arrays.column(address, self._held[name])
        if column.dtype.kind not in "fiubM":
            raise refused(self.path, address, "does not hold real numbers", "choose another")
        return column

    def place(self, address: str, index: int) -> str:
        """The number of a sample, from 0 on."""
        return f"sample {index}"


def _example(array: Values) -> float | None:
    is_number = array.dtype.kind in "fiub" and array.size > 0
    return float(time_first(array).reshape(-1)[0]) if is_number else None


def none_is_text(value: Values | None) -> Values:
    """An array that stands for a variable of another kind than numbers."""
    return np.array([], dtype=object) if value is None else value
