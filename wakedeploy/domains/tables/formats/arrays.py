"""Logs that are whole arrays by name: what NumPy's and MATLAB's files have in common."""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path

from wakedeploy.domains.tables.formats.cells import unit_in_brackets
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
Unread = Mapping[str, tuple[str, str]]  # what an array is instead, and what to do or ""


class ArrayLog:
    """A file's arrays; `load` gives all of them, or those of some names."""

    def __init__(self, path: Path, load: Load, unread: Unread | None = None) -> None:
        self.path, self.notes = path, list[str]()
        self._held = dict(load(None))
        self._unread = unread or {}
        self._arrays = Arrays(path, {name: array.shape for name, array in self._held.items()})

    def fields(self) -> list[Field]:
        """Every array, tables number by number."""
        return [
            Field(
                name,
                unit=unit_in_brackets(key),
                example=_example(array),
                unread=self._why(key),
            )
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

    def _why(self, name: str) -> str:
        """Why an array is not read and what to do, where something can be done."""
        reason, advice = self._unread.get(name, ("", ""))
        return f"{reason}; {advice}" if advice else ""

    def _column(self, address: str) -> Values:
        for whole, (reason, advice) in self._unread.items():
            if address == whole or address.startswith(tuple(f"{whole}{c}" for c in "/.[(")):
                raise refused(self.path, whole, reason, advice or "choose another")
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
