"""PX4's ULog, read by pyulog: `vehicle_attitude.q[0]`, `actuator_outputs[1].output[0]`.

Each topic has its own clock, `timestamp`, in microseconds since the board's start.
"""

import contextlib
import functools
import io
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.log import (
    Clock,
    Field,
    Values,
    library,
    missing,
    require_size,
    require_values,
    unreadable,
)

_ADDRESS = re.compile(r"(?P<topic>[^.\[\]]+)(?:\[(?P<instance>[0-9]{1,3})\])?\.(?P<field>.+)")
_MOST_FIELDS = 20_000  # that the formats of a file come to; those of PX4 come to some hundreds
_DEEPEST = 16


def open_log(path: Path, csv: Delimited) -> "ULogLog":
    """Open a ULog."""
    require_size(path)
    return ULogLog(path, library(path, "pyulog.core", "pyulog", "ulog"))


class ULogLog:
    """A ULog, whose topics are parsed in one pass when the first of them is asked for."""

    def __init__(self, path: Path, pyulog: Any) -> None:
        self.path, self.notes = path, list[str]()
        self._pyulog = pyulog
        _refuse_bombs(path, self._parsed(header_only=True).message_formats)

    @functools.cached_property
    def _data(self) -> dict[tuple[str, int], Mapping[str, Values]]:
        log = self._parsed(header_only=False)
        if log.file_corruption:
            self.notes.append(f"{self.path}: is damaged in places; what can be read is used")
        lost_ms = sum(dropout.duration for dropout in log.dropouts)
        if lost_ms:
            count = len(log.dropouts)
            self.notes.append(f"{self.path}: the logger lost {lost_ms} ms in {count} drop-outs")
        return {(data.name, data.multi_id): data.data for data in log.data_list}

    def fields(self) -> list[Field]:
        """Every field of every topic and instance."""
        return [
            Field(f"{self._topic(*key)}.{name}", self._topic(*key), example=float(values[0]))
            for key, data in self._data.items()
            for name, values in data.items()
            if not name.startswith("_padding")
        ]

    def clock_of(self, address: str) -> Clock | None:
        """The topic's own clock."""
        topic, instance, _ = self._split(address)
        return Clock(f"{topic}[{instance}].timestamp", "us")

    def read(self, addresses: Collection[str], stamps: Collection[str]) -> dict[str, Values]:
        """The fields of these addresses."""
        columns = {address: self._column(address) for address in addresses}
        require_values(self.path, sum(map(len, columns.values())))
        return columns

    def place(self, address: str, index: int) -> str:
        """The number of a message of a topic, from 0 on."""
        return f"message {index}"

    def _column(self, address: str) -> Values:
        topic, instance, field = self._split(address)
        data = self._data.get((topic, instance))
        if data is None:
            raise missing(self.path, address, [f"{self._topic(*key)}." for key in self._data])
        if field not in data:
            there = [f"{self._topic(topic, instance)}.{name}" for name in data]
            raise missing(self.path, address, there)
        return data[field]

    def _topic(self, name: str, instance: int) -> str:
        return f"{name}[{instance}]" if instance or (name, 1) in self._data else name

    def _split(self, address: str) -> tuple[str, int, str]:
        found = _ADDRESS.fullmatch(address)
        if found is None:
            raise missing(self.path, address, [field.name for field in self.fields()])
        return found["topic"], int(found["instance"] or 0), found["field"]

    def _parsed(self, header_only: bool) -> Any:
        """The file as pyulog reads it, whose remarks go nowhere."""
        try:
            with contextlib.redirect_stdout(io.StringIO()), self.path.open("rb") as file:
                return self._pyulog.ULog(file, parse_header_only=header_only)
        except Exception as error:  # NumPy's, struct's and its own share no base class
            raise unreadable(self.path, error) from error


def _refuse_bombs(path: Path, formats: Mapping[str, Any]) -> None:
    """Refuse formats that contain each other, or come to more fields than a log has."""
    counts: dict[str, int] = {}

    def count(name: str, depth: int) -> int:
        if depth > _DEEPEST or name not in formats:
            return _MOST_FIELDS + 1 if name in formats else 1
        if name not in counts:
            inner = (
                max(size, 1) * count(kind, depth + 1) for kind, size, _ in formats[name].fields
            )
            counts[name] = sum(inner)
        return counts[name]

    if sum(count(name, 0) for name in formats) > 50 * _MOST_FIELDS or any(
        counted > _MOST_FIELDS for counted in counts.values()
    ):
        raise UnusableInput(f"{path}: its formats hold too many fields for a log; record it again.")
