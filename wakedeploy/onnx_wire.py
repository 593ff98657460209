"""The few fields of an ONNX file that a machine without the onnx package has to read and write.

An ONNX file is one protobuf message (`ModelProto` of onnx.proto3): a run of fields, each a tag,
that is (number << 3 | wire type), and a value. Metadata is added, read and removed here without
touching any other byte, so that a hash over the rest is the same on every machine.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

VARINT, FIXED64, LENGTH_DELIMITED, FIXED32 = 0, 1, 2, 5
FLOAT32 = 1  # TensorProto.DataType

# Field numbers of onnx.proto3.
_MODEL_GRAPH, _MODEL_METADATA = 7, 14
_ENTRY_KEY, _ENTRY_VALUE = 1, 2
_GRAPH_INITIALIZER, _GRAPH_INPUT, _GRAPH_OUTPUT = 5, 11, 12
_INITIALIZER_DATA_LOCATION, _EXTERNAL = 14, 1
_VALUE_NAME, _VALUE_TYPE, _TYPE_TENSOR, _TENSOR_ELEMENT, _TENSOR_SHAPE = 1, 2, 1, 1, 2
_SHAPE_DIM, _DIM_VALUE, _DIM_NAME = 1, 1, 2


class MalformedModel(ValueError):
    """The bytes are not a protobuf message, or end in the middle of one."""


@dataclass(frozen=True)
class Field:
    """One protobuf field: `value` is an int for a varint, else bytes; `raw` has the tag too."""

    number: int
    value: int | memoryview
    raw: memoryview


@dataclass(frozen=True)
class Tensor:
    """Name, element type and shape of a graph input or output; a dynamic axis is a string."""

    name: str
    element: int
    shape: tuple[int | str, ...]


@dataclass(frozen=True)
class Signature:
    """What a graph takes and gives, in its own order."""

    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    external_data: bool


def fields(data: bytes | memoryview) -> Iterator[Field]:
    """Walk over the fields of a message; raises MalformedModel where it is cut or foreign."""
    view = memoryview(data)
    position = 0
    while position < len(view):
        start = position
        tag, position = _varint(view, position)
        if tag >> 3 == 0:
            raise MalformedModel("a field numbered 0")
        value, position = _value(view, position, tag & 7)
        yield Field(tag >> 3, value, view[start:position])


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
    """The model's metadata entries; the last of two with the same key counts."""
    entries = [list(fields(_bytes(f))) for f in fields(model) if f.number == _MODEL_METADATA]
    return {_text(entry, _ENTRY_KEY): _text(entry, _ENTRY_VALUE) for entry in entries}


def signature(model: bytes) -> Signature:
    """Inputs and outputs of the model's graph; raises MalformedModel where there is no graph."""
    graphs = [field for field in fields(model) if field.number == _MODEL_GRAPH]
    if len(graphs) != 1:
        raise MalformedModel("no graph")
    graph = list(fields(_bytes(graphs[0])))
    return Signature(
        inputs=tuple(_tensor(_bytes(f)) for f in graph if f.number == _GRAPH_INPUT),
        outputs=tuple(_tensor(_bytes(f)) for f in graph if f.number == _GRAPH_OUTPUT),
        external_data=any(_is_external(f) for f in graph if f.number == _GRAPH_INITIALIZER),
    )


def _tensor(value_info: memoryview) -> Tensor:
    info = list(fields(value_info))
    tensor = list(fields(_child(list(fields(_child(info, _VALUE_TYPE))), _TYPE_TENSOR)))
    element = next((f.value for f in tensor if f.number == _TENSOR_ELEMENT), 0)
    if not isinstance(element, int):
        raise MalformedModel("an element type that is no number")
    dims = fields(_child(tensor, _TENSOR_SHAPE))
    shape = tuple(_dim(_bytes(f)) for f in dims if f.number == _SHAPE_DIM)
    return Tensor(_text(info, _VALUE_NAME), element, shape)


def _dim(data: memoryview) -> int | str:
    for field in fields(data):
        if field.number == _DIM_VALUE and isinstance(field.value, int):
            return field.value
        if field.number == _DIM_NAME:
            return str(_bytes(field), "utf-8", "replace")
    return "?"


def _is_external(initializer: Field) -> bool:
    return any(
        field.number == _INITIALIZER_DATA_LOCATION and field.value == _EXTERNAL
        for field in fields(_bytes(initializer))
    )


def _child(message: list[Field], number: int) -> memoryview:
    return next((_bytes(f) for f in reversed(message) if f.number == number), memoryview(b""))


def _text(message: list[Field], number: int) -> str:
    try:
        return str(_child(message, number), "utf-8")
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
            return value, position
    raise MalformedModel("a number of more than 70 bits")


def _message(number: int, content: str | bytes) -> bytes:
    data = content.encode() if isinstance(content, str) else content
    return _encoded(number << 3 | LENGTH_DELIMITED) + _encoded(len(data)) + data


def _encoded(value: int) -> bytes:
    encoded = bytearray()
    while value >= 0x80:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes(encoded) + bytes([value])
