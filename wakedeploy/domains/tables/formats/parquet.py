"""Parquet: a column for each name; structs by a dot, lists of one length by an index."""

import json
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats.cells import unit_in_brackets
from wakedeploy.domains.tables.log import (
    Clock,
    Field,
    Values,
    indexed,
    library,
    missing,
    refused,
    require_size,
    require_values,
    unreadable,
)

_ABOUT = "meta/info.json"  # of a set of LeRobot, whose files lie in data/chunk-000
_NO_NUMBERS = ("string", "binary", "timestamp", "date", "time")  # in the name of Arrow's type


def open_log(path: Path, csv: Delimited) -> "ParquetLog":
    """Open a Parquet file."""
    require_size(path)
    library(path, "pyarrow", "pyarrow", "tables")
    return ParquetLog(path, library(path, "pyarrow.parquet", "pyarrow", "tables"))


class ParquetLog:
    """A Parquet file, whose columns are read one by one."""

    def __init__(self, path: Path, parquet: Any) -> None:
        self.path, self.notes = path, list[str]()
        try:
            self._file = parquet.ParquetFile(path)
            self._leaves = dict(_leaves(self._file.schema_arrow))
        except Exception as error:  # Arrow's errors share no base class with those of the system
            raise unreadable(path, error) from error

    def fields(self) -> list[Field]:
        """Every column, lists number by number as the first row has them."""
        found = []
        for name, (kind, unit) in self._leaves.items():
            count = self._length(name) if "list" in str(kind) else 0
            names = [f"{name}[{i}]" for i in range(count)] or [name]
            example = None if any(word in str(kind) for word in _NO_NUMBERS) else 0.0
            stated = "s" if str(kind).startswith("duration") else unit or unit_in_brackets(name)
            called = _called(self.path, name, count) or [""] * len(names)
            found += [
                Field(address, unit=stated, example=example, of=of)
                for address, of in zip(names, called, strict=True)
            ]
        return found

    def clock_of(self, address: str) -> Clock | None:
        """None: stamps are a column."""
        return None

    def read(self, addresses: Collection[str], stamps: Collection[str]) -> dict[str, Values]:
        """The columns of these addresses; dates as what they are, durations in seconds."""
        require_values(self.path, len(addresses) * self._file.metadata.num_rows)
        return {address: self._column(address, address in stamps) for address in addresses}

    def place(self, address: str, index: int) -> str:
        """The number of a row, from 0 on."""
        return f"row {index}"

    def _length(self, name: str) -> int:
        """The numbers of a list in the first row that has one."""
        values = self._array(name, self._file.iter_batches(columns=[name]))
        return next((len(value) for value in values if value is not None), 0)

    def _column(self, address: str, is_stamp: bool) -> Values:
        name, index = (address, ()) if address in self._leaves else indexed(address)
        if name not in self._leaves:
            raise missing(self.path, address, self._leaves)
        values = self._array(name, self._file.iter_batches(columns=[name]))
        if index:
            return self._elements(address, values, index)
        if values.dtype.kind == "m":
            return np.asarray(values / np.timedelta64(1, "ns") * 1e-9)
        if values.dtype.kind in "fiubM":
            return values
        if is_stamp and all(v is None or isinstance(v, str) for v in values):
            return np.array(["" if v is None else v for v in values], dtype=object)
        plain = [float("nan") if v is None else v for v in values]
        if not all(isinstance(v, int | float) for v in plain):
            raise refused(self.path, address, "does not hold real numbers", "choose another")
        return np.array(plain, dtype=np.float64)

    def _array(self, name: str, batches: Any) -> Values:
        """A column of all row groups, a struct's fields followed down."""
        try:
            parts = [_inner(batch, name) for batch in batches]
        except Exception as error:  # as above
            raise unreadable(self.path, error) from error
        return np.concatenate(parts) if parts else np.array([])

    def _elements(self, address: str, values: Values, index: tuple[int, ...]) -> Values:
        chosen = []
        for row, value in enumerate(values):
            try:
                for i in index:
                    value = value[i] if value is not None else None
                chosen.append(float("nan") if value is None else float(value))
            except (TypeError, IndexError, ValueError) as error:
                reason = f"has no such number in row {row}"
                raise refused(self.path, address, reason, "give another index") from error
        return np.array(chosen)


def _called(path: Path, name: str, count: int) -> list[str]:
    """What a set of LeRobot calls the numbers of a list, in its info.json; none in another set.

    Its features have `names`, a list or one by a word, as {"motors": ["hip", "knee"]}.
    """
    about = next(filter(Path.is_file, (up / _ABOUT for up in path.absolute().parents[1:4])), None)
    if about is None or not count:
        return []
    try:
        names = json.loads(about.read_text("utf-8"))["features"][name]["names"]
        listed = next(iter(names.values())) if isinstance(names, dict) else names
    except (OSError, ValueError, LookupError, TypeError, StopIteration, RecursionError):
        return []
    is_named = isinstance(listed, list) and len(listed) == count
    return listed if is_named and all(isinstance(each, str) for each in listed) else []


def _leaves(fields: Any, prefix: str = "") -> list[tuple[str, tuple[Any, str | None]]]:
    found: list[tuple[str, tuple[Any, str | None]]] = []
    for field in fields:
        name = f"{prefix}{field.name}"
        if str(field.type).startswith("struct"):
            found += _leaves(field.type.fields, f"{name}.")
            continue
        unit = (field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace")
        found.append((name, (field.type, unit or None)))
    return found


def _inner(batch: Any, name: str) -> Values:
    column = batch.column(0)
    for part in name.split(".")[1:] if "." in name and batch.schema.names[0] != name else ():
        column = column.field(part)
    values: Values = column.to_numpy(zero_copy_only=False)
    return values
