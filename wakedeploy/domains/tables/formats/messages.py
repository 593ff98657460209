"""Logs of messages: topics, each with its clock, whose messages hold numbers in nested fields.

An address is the topic, a dot, and the way to a number: `/imu.linear_acceleration.x`,
`/joint_states.position[2]`, or `/imu.log_time` for when the message was recorded.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.formats.ros_units import is_aside, remark_on, unit_of
from wakedeploy.domains.tables.log import (
    Clock,
    Field,
    Values,
    missing,
    refused,
    require_values,
)

LOG_TIME = "log_time"
_LONGEST_VECTOR = 32  # numbers of one that are listed
_DEEPEST = 8
_STEP = re.compile(r"\.?([A-Za-z_][^.\[\]]*)|\[([0-9]{1,6})\]")

Steps = tuple[str | int, ...]
Decode = Callable[[bytes], Any]


class Message(NamedTuple):
    """A message as it was recorded, and what turns its bytes into fields."""

    topic: str
    log_time_ns: int
    content: bytes
    decode: Decode


class MessageLog:
    """A log whose messages `stream` gives in their order, as often as it is asked."""

    def __init__(
        self, path: Path, topics: Collection[str], stream: Callable[[], Iterable[Message]]
    ) -> None:
        self.path, self.notes = path, list[str]()
        self.fixed_units: dict[str, str] = {}  # of what was read, by address
        self._topics = sorted(topics, key=len, reverse=True)
        self._stream = stream

    def fields(self) -> list[Field]:
        """The numbers in the first message of each topic."""
        firsts: dict[str, Message] = {}
        for message in self._stream():
            firsts.setdefault(message.topic, message)
            if len(firsts) == len(self._topics):
                break
        found: list[Field] = []
        for topic, message in sorted(firsts.items()):
            try:
                numbers = list(_numbers(self._decoded(message)))
            except UnusableInput as error:
                self.notes.append(str(error).rstrip("."))
                continue
            found += [
                Field(f"{topic}.{n.name}", topic, n.unit, 0.0, n.remark, n.is_typed, n.is_aside)
                for n in numbers
            ]
        return found

    def clock_of(self, address: str) -> Clock | None:
        """When the messages of a field's topic were recorded, in nanoseconds."""
        return Clock(f"{self._split(address)[0]}.{LOG_TIME}", "ns")

    def read(self, addresses: Collection[str], stamps: Collection[str]) -> dict[str, Values]:
        """The fields of these addresses in one pass."""
        wanted: dict[str, list[tuple[str, Steps]]] = {}
        for address in addresses:
            topic, steps = self._split(address)
            wanted.setdefault(topic, []).append((address, steps))
        found: dict[str, list[Any]] = {address: [] for address in addresses}
        for count, message in enumerate(self._stream()):
            if message.topic in wanted:
                self._take(message, wanted[message.topic], found, stamps)
            if count % 10_000 == 0:
                require_values(self.path, sum(map(len, found.values())))
        return {a: self._column(a, values, a in stamps) for a, values in found.items()}

    def place(self, address: str, index: int) -> str:
        """The number of a message of a topic, from 0 on."""
        return f"message {index}"

    def _take(
        self,
        message: Message,
        wanted: list[tuple[str, Steps]],
        found: Mapping[str, list[Any]],
        stamps: Collection[str],
    ) -> None:
        """Add the numbers of a message to the columns."""
        only_clock = all(steps == (LOG_TIME,) for _, steps in wanted)
        fields = None if only_clock else self._decoded(message)
        for address, steps in wanted:
            if steps == (LOG_TIME,):
                found[address].append(message.log_time_ns)
                continue
            try:
                value = _at(fields, steps)
            except (KeyError, IndexError, TypeError, AttributeError, ValueError) as error:
                place = self.place(address, len(found[address]))
                there = [f"{message.topic}.{number.name}" for number in _numbers(fields)]
                refusal = missing(self.path, address, there)
                raise UnusableInput(f"{refusal} ({place})") from error
            if not found[address] and (unit := _unit_at(fields, steps)) is not None:
                self.fixed_units[address] = unit
            found[address].append(_stamp(value) if address in stamps else value)

    def _column(self, address: str, values: list[Any], is_stamp: bool) -> Values:
        if not values:
            raise refused(self.path, address, "has no message", "choose another topic")
        plain = [float("nan") if value is None else value for value in values]
        for index, value in enumerate(plain):
            if not isinstance(value, int | float | np.number | np.bool_):
                reason = f"is no number in {self.place(address, index)}"
                raise refused(self.path, address, reason, "choose another field")
        try:
            if is_stamp and all(isinstance(value, int) for value in plain):
                return np.array(plain, dtype=np.int64)
            return np.array(plain, dtype=np.float64)
        except OverflowError as error:
            raise refused(self.path, address, "holds too large a number", "mend it") from error

    def _split(self, address: str) -> tuple[str, Steps]:
        """The topic of an address, the longest that it begins with, and the way to a number."""
        for topic in self._topics:
            if address.startswith(f"{topic}."):
                return topic, _steps(self.path, address, address[len(topic) + 1 :])
        raise missing(self.path, address, sorted(self._topics))

    def _decoded(self, message: Message) -> Any:
        try:
            return message.decode(message.content)
        except UnusableInput:
            raise
        except Exception as error:  # decoders share no base class; all mean: damaged
            raise UnusableInput(
                f"{self.path}: a message of {message.topic} cannot be decoded"
                f" ({str(error) or type(error).__name__}); copy or record it again."
            ) from error


def _steps(path: Path, address: str, way: str) -> Steps:
    found: list[str | int] = []
    at = 0
    while at < len(way):
        step = _STEP.match(way, at)
        if step is None:
            raise refused(path, address, "is no way to a field", "write it as in /arm.position[2]")
        found.append(step[1] if step[1] is not None else int(step[2]))
        at = step.end()
    return tuple(found)


def _at(fields: Any, steps: Steps) -> Any:
    for step in steps:
        fields = _part(fields, step)
    if isinstance(fields, np.ndarray) and fields.ndim:
        raise TypeError("a whole vector")
    return fields


def _part(fields: Any, step: str | int) -> Any:
    if isinstance(step, int) or isinstance(fields, Mapping):
        return fields[step]
    if step.startswith("_"):
        raise KeyError(step)
    return getattr(fields, step)


def _unit_at(fields: Any, steps: Steps) -> str | None:
    """The unit that the types of the messages on a way fix; None where they fix none."""
    unit = None
    for step in steps:
        if isinstance(step, str) and not isinstance(fields, Mapping):
            unit = unit_of(str(getattr(fields, "__msgtype__", "")), step) or unit
        fields = _part(fields, step)
    return unit


def _stamp(value: Any) -> Any:
    """A stamp in nanoseconds where it is one of seconds and nanoseconds, as ROS has them."""
    parts = value if isinstance(value, Mapping) else getattr(value, "__dict__", {})
    for low in ("nanosec", "nsec", "nsecs"):
        if low in parts:
            high = parts.get("sec", parts.get("secs", 0))
            return int(high) * 1_000_000_000 + int(parts[low])
    return int(value) if isinstance(value, np.integer) else value


class _Number(NamedTuple):
    """A number below some fields: the way to it, and what its message's type says of it."""

    name: str
    unit: str | None = None
    remark: str = ""
    is_typed: bool = False
    is_aside: bool = False


_WHOLE = _Number("")


def _numbers(fields: Any, at: _Number = _WHOLE, depth: int = 0) -> Iterator[_Number]:
    """The numbers below some fields."""
    if isinstance(fields, bool | int | float | np.number | np.bool_):
        yield at
    elif isinstance(fields, list | tuple | np.ndarray):
        for i, part in enumerate(fields[:_LONGEST_VECTOR] if depth < _DEEPEST else ()):
            yield from _numbers(part, at._replace(name=f"{at.name}[{i}]"), depth + 1)
    elif not isinstance(fields, str | bytes | type(None)) and depth < _DEEPEST:
        parts = fields if isinstance(fields, Mapping) else getattr(fields, "__dict__", {})
        kind = "" if isinstance(fields, Mapping) else str(getattr(fields, "__msgtype__", ""))
        for key, part in parts.items():
            if isinstance(key, str) and _STEP.fullmatch(key):
                yield from _numbers(part, _below(at, kind, key), depth + 1)


def _below(at: _Number, kind: str, key: str) -> _Number:
    """A field of a message, or of one within it: what is said of it holds for all below."""
    return _Number(
        f"{at.name}.{key}" if at.name else key,
        unit_of(kind, key) or at.unit,
        remark_on(kind, key) or at.remark,
        bool(kind) or at.is_typed,
        is_aside(kind, key) or at.is_aside,
    )
