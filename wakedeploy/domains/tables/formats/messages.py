"""Logs of messages: topics, each with its clock, whose messages hold numbers in nested fields.

An address is the topic, a dot, and the way to a number: `/imu.linear_acceleration.x`,
`/joint_states.position[2]`, or `/imu.log_time` for when the message was recorded. What a message
names is found by its name, in whatever order: `/joint_states.position[elbow]`.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.formats.named import Lacking, Names
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
_LOOKED_AT = 20  # messages of a topic for its fields: the first may be empty
_ENOUGH, _MOST = 5_000, 200_000  # of all topics: once each has one, and whatever they have
_LONGEST_VECTOR = 32  # numbers of one that are listed
_DEEPEST = 8
_ZSTD = b"\x28\xb5\x2f\xfd"  # as what rosbag2 compresses message by message begins
_STEP = re.compile(r"\.?([A-Za-z_][^.\[\]]*)|\[([0-9]{1,6})\]|\[([^\[\]]{1,100})\]")


class Named(NamedTuple):
    """A step to the element of a list that a message calls so."""

    name: str


Steps = tuple[str | int | Named, ...]
Decode = Callable[[bytes], Any]


class Message(NamedTuple):
    """A message as it was recorded, and what turns its bytes into fields."""

    topic: str
    log_time_ns: int
    content: bytes
    decode: Decode


@dataclass
class _Read:
    """A field on its way through the messages: what was read of it so far."""

    address: str
    topic: str
    steps: Steps
    values: list[Any] = field(default_factory=list)  # None where a message lacks it
    is_found: bool = False  # in any message
    called: tuple[str, ...] = ()  # the names of the elements on its way, "" for those without
    lacking: UnusableInput | None = None  # the sentence for the first message that lacks it


class MessageLog:
    """A log whose messages `stream` gives in their order, as often as it is asked."""

    def __init__(
        self, path: Path, topics: Collection[str], stream: Callable[[], Iterable[Message]]
    ) -> None:
        self.path, self.notes = path, list[str]()
        self.fixed_units: dict[str, str] = {}  # of what was read, by address
        self._topics = sorted(topics, key=len, reverse=True)
        self._stream = stream
        self._fields: list[Field] | None = None

    def fields(self) -> list[Field]:
        """The numbers in the first messages of each topic."""
        if self._fields is None:
            seen = self._seen()
            self._fields = [
                field for topic in sorted(seen) for field in _fields(topic, seen[topic])
            ]
        return self._fields

    def _seen(self) -> dict[str, list["_Number"]]:
        """The numbers in the first messages, by topic; a note where one cannot be decoded."""
        seen: dict[str, list[_Number]] = {topic: [] for topic in self._topics}
        unread = dict.fromkeys(self._topics, _LOOKED_AT)
        for count, message in enumerate(self._stream()):
            most_left = max(unread.values(), default=0)
            if not most_left or count >= (_ENOUGH if most_left < _LOOKED_AT else _MOST):
                silent = [topic for topic in self._topics if unread[topic] == _LOOKED_AT]
                if silent:
                    first = f"among the first {_MOST}; no field of it is listed"
                    named = " or ".join(sorted(silent))
                    self.notes.append(f"{self.path}: no message of {named} is {first}")
                break
            if not unread[message.topic]:
                continue
            unread[message.topic] -= 1
            try:
                seen[message.topic] += _numbers(self._decoded(message))
            except UnusableInput as error:
                self.notes.append(str(error).rstrip("."))
                unread[message.topic] = 0
        return seen

    def clock_of(self, address: str) -> Clock | None:
        """When the messages of a field's topic were recorded, in nanoseconds."""
        return Clock(f"{self._split(address)[0]}.{LOG_TIME}", "ns")

    def read(self, addresses: Collection[str], stamps: Collection[str]) -> dict[str, Values]:
        """The fields of these addresses in one pass."""
        reads: list[_Read] = []
        wanted: dict[str, list[_Read]] = {}
        for address in addresses:
            topic, steps = self._split(address)
            reads.append(_Read(address, topic, steps))
            wanted.setdefault(topic, []).append(reads[-1])
        for count, message in enumerate(self._stream()):
            if message.topic in wanted:
                self._take(message, wanted[message.topic], stamps)
            if count % 10_000 == 0:
                require_values(self.path, sum(len(read.values) for read in reads))
        return {read.address: self._column(read, read.address in stamps) for read in reads}

    def place(self, address: str, index: int) -> str:
        """The number of a message of a topic, from 0 on."""
        return f"message {index}"

    def _take(self, message: Message, wanted: list[_Read], stamps: Collection[str]) -> None:
        """Add the numbers of a message to the columns."""
        only_clock = all(read.steps == (LOG_TIME,) for read in wanted)
        fields = None if only_clock else self._decoded(message)
        names = Names()
        for read in wanted:
            if read.steps == (LOG_TIME,):
                read.values.append(message.log_time_ns)
                continue
            try:
                value, way, called = _at(fields, read.steps, names)
            except (Lacking, IndexError) as error:  # for this message; others may have it
                read.lacking = read.lacking or self._lacking(read, fields, error)
                read.values.append(None)
                continue
            except (KeyError, TypeError, AttributeError, ValueError) as error:
                raise self._lacking(read, fields, error) from error
            self._require_same(read, called)
            if not read.is_found and (unit := _unit_at(fields, way)) is not None:
                self.fixed_units[read.address] = unit
            read.is_found = True
            read.values.append(_stamp(value) if read.address in stamps else value)

    def _lacking(self, read: _Read, fields: Any, error: Exception) -> UnusableInput:
        """The sentence for a message that lacks a field."""
        place = self.place(read.address, len(read.values))
        if isinstance(error, Lacking) and error.there:
            named = ", ".join(map(repr, error.there[:_LONGEST_VECTOR]))
            return refused(self.path, read.address, f"is not in {place}", f"that has {named}")
        there = [f"{read.topic}.{number.name}" for number in _numbers(fields)]
        return UnusableInput(f"{missing(self.path, read.address, there)} ({place})")

    def _require_same(self, read: _Read, called: tuple[str, ...]) -> None:
        """Refuse an index that is another joint, model or frame in another message."""
        if called == read.called:  # as nearly always
            return
        pairs = list(zip(read.called or called, called, strict=True))
        other = next((now for before, now in pairs if before and now and before != now), None)
        if other is not None:
            place = self.place(read.address, len(read.values))
            raise self._other(read, f"in {place} that of {other!r}")
        read.called = tuple(before or now for before, now in pairs)

    def _other(self, read: _Read, what: str) -> UnusableInput:
        """The sentence for an index that is not the same element in all messages."""
        usual, by_name = next(filter(None, read.called)), _by_name(read)
        advice = f"ask for it by its name, as {by_name!r}"
        if by_name == read.address:
            advice = "record what several send on topics of their own"
        return refused(self.path, read.address, f"is that of {usual!r}, and {what}", advice)

    def _column(self, read: _Read, is_stamp: bool) -> Values:
        address, values = read.address, read.values
        if not values:
            raise refused(self.path, address, "has no message", "choose another topic")
        if read.lacking is not None and not read.is_found:
            raise read.lacking
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
            if message.content.startswith(_ZSTD):
                raise UnusableInput(
                    f"{self.path}: its messages are compressed; `ros2 bag convert` writes them"
                    " without compression."
                ) from error
            raise UnusableInput(
                f"{self.path}: a message of {message.topic} cannot be decoded"
                f" ({str(error) or type(error).__name__}); copy or record it again."
            ) from error


def _fields(topic: str, seen: Sequence["_Number"]) -> Iterator[Field]:
    """The numbers of a topic; by names where an index is now one element, now another."""
    called: dict[str, set[tuple[str, ...]]] = {}
    for n in seen:
        called.setdefault(n.name, set()).update({n.called} if any(n.called) else ())
    varies = any(len(names) > 1 for names in called.values())
    listed = [n for n in seen if any(n.called) or not called[n.name]]  # a first one lacks names
    for name, n in {n.by_name if varies else n.name: n for n in listed}.items():
        of = " ".join(filter(None, n.called))
        yield Field(f"{topic}.{name}", topic, n.unit, 0.0, n.remark, n.is_typed, n.is_aside, of=of)


def _steps(path: Path, address: str, way: str) -> Steps:
    found: list[str | int | Named] = []
    at = 0
    while at < len(way):
        step = _STEP.match(way, at)
        if step is None:
            raise refused(path, address, "is no way to a field", "write it as in /arm.position[2]")
        found.append(step[1] or (int(step[2]) if step[2] else Named(step[3])))
        at = step.end()
    return tuple(found)


def _at(
    fields: Any, steps: Steps, names: Names
) -> tuple[Any, tuple[str | int, ...], tuple[str, ...]]:
    """The number at the end of a way, the way by indices, and what elements on it are called.

    Raises Lacking where a list has no element of a name that is asked for.
    """
    above: list[Any] = []
    way: list[str | int] = []
    called: list[str] = []
    for step in steps:
        at = names.index_of(above, fields, step.name) if isinstance(step, Named) else step
        if isinstance(at, int):
            called.append(names.at(above, fields, at))
        above.append(fields)
        way.append(at)
        fields = _part(fields, at)
    if isinstance(fields, np.ndarray) and fields.ndim:
        raise TypeError("a whole vector")
    return fields, tuple(way), tuple(called)


def _by_name(read: _Read) -> str:
    """An address with names in the place of indices, where the elements have any."""
    address, called = read.topic, iter(read.called)
    for step in read.steps:
        if isinstance(step, str):
            address += f".{step}"
        else:
            index = step.name if isinstance(step, Named) else step
            name = next(called)
            address += f"[{name if _is_way(name) else index}]"
    return address


def _is_way(name: str) -> bool:
    """Whether an element can be asked for by its name: a number would be an index."""
    step = _STEP.fullmatch(f"[{name}]")
    return step is not None and step[3] is not None


def _part(fields: Any, step: str | int) -> Any:
    if isinstance(step, int) or isinstance(fields, Mapping):
        return fields[step]
    if step.startswith("_"):
        raise KeyError(step)
    return getattr(fields, step)


def _unit_at(fields: Any, way: Sequence[str | int]) -> str | None:
    """The unit that the types of the messages on a way fix; None where they fix none."""
    unit = None
    for step in way:
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
    """A number below some fields: the way to it, and what its message's type says of it.

    `called` are the names of the list's elements on the way, and `by_name` is the way by them.
    """

    name: str
    by_name: str
    called: tuple[str, ...] = ()
    unit: str | None = None
    remark: str = ""
    is_typed: bool = False
    is_aside: bool = False


_WHOLE = _Number("", "")


def _numbers(
    fields: Any, at: _Number = _WHOLE, depth: int = 0, above: tuple[Any, ...] = ()
) -> Iterator[_Number]:
    """The numbers below some fields, which are within what is `above`, outermost first."""
    within, names = (*above, fields), Names()
    if isinstance(fields, bool | int | float | np.number | np.bool_):
        yield at
    elif isinstance(fields, list | tuple | np.ndarray):
        for i, part in enumerate(fields[:_LONGEST_VECTOR] if depth < _DEEPEST else ()):
            element = _element(at, i, names.at(above, fields, i))
            yield from _numbers(part, element, depth + 1, within)
    elif not isinstance(fields, str | bytes | type(None)) and depth < _DEEPEST:
        parts = fields if isinstance(fields, Mapping) else getattr(fields, "__dict__", {})
        kind = "" if isinstance(fields, Mapping) else str(getattr(fields, "__msgtype__", ""))
        for key, part in parts.items():
            if isinstance(key, str) and _STEP.fullmatch(key):
                yield from _numbers(part, _below(at, kind, key), depth + 1, within)


def _element(at: _Number, index: int, name: str) -> _Number:
    """An element of a list."""
    return at._replace(
        name=f"{at.name}[{index}]",
        by_name=f"{at.by_name}[{name if _is_way(name) else index}]",
        called=(*at.called, name),
    )


def _below(at: _Number, kind: str, key: str) -> _Number:
    """A field of a message, or of one within it: what is said of it holds for all below."""
    dot = "." if at.name else ""
    return at._replace(
        name=f"{at.name}{dot}{key}",
        by_name=f"{at.by_name}{dot}{key}",
        unit=unit_of(kind, key) or at.unit,
        remark=remark_on(kind, key) or at.remark,
        is_typed=bool(kind) or at.is_typed,
        is_aside=is_aside(kind, key) or at.is_aside,
    )
