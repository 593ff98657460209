"""Protobuf, as far as a machine without the onnx package has to read and write it.

An ONNX file is one protobuf message (`ModelProto` of onnx.proto3): a run of fields, each a tag,
that is (number << 3 | wire type), and a value. Metadata is added, read and removed here without
touching any other byte, so that a hash over the rest is the same on every machine. Whatever the
bytes are, walking over them ends, calls nothing but itself once, and copies nothing.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

VARINT, FIXED64, LENGTH_DELIMITED, FIXED32 = 0, 1, 2, 5
MOST_ENTRIES = 64  # of metadata
MOST_ENTRY_BYTES = 1 << 20  # the length of one; the largest example rollout has half of that

_MODEL_GRAPH, _MODEL_METADATA = 7, 14
_ENTRY_KEY, _ENTRY_VALUE = 1, 2
_MOST_FIELDS = 20_000  # of one message; a graph of 4,096 nodes and as many constants has fewer


class MalformedModel(ValueError):
    """The bytes are not a protobuf message, or end in the middle of one."""


@dataclass(frozen=True)
class Field:
    """One protobuf field: `value` is an int for a varint, else bytes; `raw` has the tag too."""

    number: int
    wire: int
    value: int | memoryview
    raw: memoryview


def fields(data: bytes | memoryview) -> Iterator[Field]:
    """Walk over the fields of a message; raises MalformedModel where it is cut or foreign."""
    view = memoryview(data)
    position = 0
    for _ in range(_MOST_FIELDS):
        if position == len(view):
            return
        start = position
        tag, position = _varint(view, position)
        if tag >> 3 == 0:
            raise MalformedModel("a field numbered 0")
        value, position = _value(view, position, tag & 7)
        yield Field(tag >> 3, tag & 7, value, view[start:position])
    if position < len(view):
        raise MalformedModel(f"a message of more than {_MOST_FIELDS} fields")


def packed(data: memoryview, most: int) -> list[int]:
    """Varints that stand one behind the other, `most` of them at most."""
    values: list[int] = []
    position = 0
    while position < len(data) and len(values) < most:
        value, position = _varint(data, position)
        values.append(value)
    return values


def without_metadata(model: bytes) -> bytes:
    """The model with every metadata entry removed and all other bytes as they were."""
    return b"".join(field.raw for field in fields(model) if field.number != _MODEL_METADATA)


def with_metadata(model: bytes, entries: Mapping[str, str]) -> bytes:
    """The model with its metadata replaced by `entries`."""
    return without_metadata(model) + b"".join(
        _message(_MODEL_METADATA, _message(_ENTRY_KEY, key) + _message(_ENTRY_VALUE, value))
        for key, value in entries.items()
    )


def metadata(model: bytes) -> dict[str, str]:
    """The model's metadata entries; the last of two with the same key counts.

    Raises MalformedModel where there is no graph beside them, for more than MOST_ENTRIES, and for
    one of more than MOST_ENTRY_BYTES.
    """
    parts = list(fields(model))
    if not any(field.number == _MODEL_GRAPH for field in parts):
        raise MalformedModel("no graph")
    found = [_bytes(field) for field in parts if field.number == _MODEL_METADATA]
    if len(found) > MOST_ENTRIES or max(map(len, found), default=0) > MOST_ENTRY_BYTES:
        raise MalformedModel(
            f"more than {MOST_ENTRIES} metadata entries, or one above {MOST_ENTRY_BYTES} bytes"
        )
    entries = [list(fields(entry)) for entry in found]
    return {_text(entry, _ENTRY_KEY): _text(entry, _ENTRY_VALUE) for entry in entries}


def _text(message: list[Field], number: int) -> str:
    found = [_bytes(field) for field in message if field.number == number]
    try:
        return str(found[-1], "utf-8") if found else ""
    except UnicodeDecodeError as error:
        raise MalformedModel("text that is not UTF-8") from error


def _bytes(field: Field) -> memoryview:
    if isinstance(field.value, int):
        raise MalformedModel(f"field {field.number} is a number where a message belongs")
    return field.value


def _value(view: memoryview, position: int, wire_type: int) -> tuple[int | memoryview, int]:
    if wire_type == VARINT:
        return _varint(view, position)
    if wire_type == LENGTH_DELIMITED:
        length, position = _varint(view, position)
    elif wire_type in (FIXED64, FIXED32):
        length = 8 if wire_type == FIXED64 else 4
    else:
        raise MalformedModel(f"wire type {wire_type}")
    if position + length > len(view):
        raise MalformedModel("it ends in the middle of a field")
    return view[position : position + length], position + length


def _varint(view: memoryview, position: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if position >= len(view):
            raise MalformedModel("it ends in the middle of a field")
        byte = view[position]
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            if value >> 64:
                break
            return value, position
    raise MalformedModel("a number of more than 64 bits")


def _message(number: int, content: str | bytes) -> bytes:
    data = content.encode() if isinstance(content, str) else content
    return _encoded(number << 3 | LENGTH_DELIMITED) + _encoded(len(data)) + data


def _encoded(value: int) -> bytes:
    encoded = bytearray()
    while value >= 0x80:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes(encoded) + bytes([value])
