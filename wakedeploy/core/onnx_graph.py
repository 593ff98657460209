"""The part of ONNX that a package may hold, and the only reader of its graph.

A package may come from anyone, and has to be judged on a machine without the onnx package. What the
eight architectures are exported to is straight arithmetic of some thirty operators, all weights in
the file; that is all there is to the tables below. Any other field of onnx.proto3, operator or
attribute is refused, so a graph holds nothing that this reader has not seen. There is no branch,
loop or graph within a graph, no function, no domain of somebody's, no file beside it. The tables
are not recursive, so neither is the reader.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wakedeploy.core import onnx_wire
from wakedeploy.core.onnx_wire import FIXED32, LENGTH_DELIMITED, VARINT, MalformedModel

OPSET = 20
FLOAT32, INT64 = 1, 7  # TensorProto.DataType
MOST_NODES = 4096
MOST_TENSORS = 128  # inputs or outputs of a graph
MOST_AXES = 6
_MOST_LETTERS = 1000
_INT, _FLOAT, _TEXT, _INTS = 2, 1, 3, 7  # AttributeProto.AttributeType

Shape = tuple[int, ...]
Attribute = int | float | str | tuple[int, ...]

# Operators and their attributes, as the eight are exported; tests hold every export against this.
OPERATORS: dict[str, dict[str, int]] = {
    "Add": {},
    "Concat": {"axis": _INT},
    "Conv": {
        "auto_pad": _TEXT,
        "dilations": _INTS,
        "group": _INT,
        "kernel_shape": _INTS,
        "pads": _INTS,
        "strides": _INTS,
    },
    "Div": {},
    "Exp": {},
    "Gather": {"axis": _INT},
    "Gemm": {"alpha": _FLOAT, "beta": _FLOAT, "transA": _INT, "transB": _INT},
    "Greater": {},
    "LayerNormalization": {"axis": _INT, "epsilon": _FLOAT, "stash_type": _INT},
    "MatMul": {},
    "Mul": {},
    "Pow": {},
    "Reciprocal": {},
    "ReduceMean": {"keepdims": _INT, "noop_with_empty_axes": _INT},
    "ReduceSum": {"keepdims": _INT, "noop_with_empty_axes": _INT},
    "Relu": {},
    "Reshape": {"allowzero": _INT},
    "Sigmoid": {},
    "Slice": {},
    "Softmax": {"axis": _INT},
    "Softplus": {},
    "Split": {"axis": _INT, "num_outputs": _INT},
    "Sqrt": {},
    "Squeeze": {},
    "Sub": {},
    "Tanh": {},
    "Transpose": {"perm": _INTS},
    "Unsqueeze": {},
    "Where": {},
}


class ForbiddenGraph(ValueError):
    """A graph that no package may hold; the text goes on from "its graph …"."""


@dataclass(frozen=True)
class Tensor:
    """Name, element type and shape of a graph input or output; a dynamic axis is a string."""

    name: str
    element: int
    shape: tuple[int | str, ...]


@dataclass(frozen=True)
class Node:
    """One operator and what it is applied to."""

    op: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    attributes: Mapping[str, Attribute]

    def whole_numbers(self, name: str) -> tuple[int, ...]:
        """A list among the attributes; () where it is not given."""
        value = self.attributes.get(name, ())
        return value if isinstance(value, tuple) else ()

    def whole_number(self, name: str) -> int:
        """A whole number among the attributes; 0 where it is not given."""
        value = self.attributes.get(name)
        return value if isinstance(value, int) else 0


@dataclass(frozen=True)
class Constant:
    """An initializer: float32 weights, or the int64 numbers of a shape or an index."""

    element: int
    shape: Shape
    data: memoryview

    @property
    def size(self) -> int:
        """How many elements it has."""
        return size_of(self.shape)


@dataclass(frozen=True)
class Graph:
    """What is computed: nodes in the file's order, and what is known beforehand by name."""

    nodes: tuple[Node, ...]
    constants: Mapping[str, Constant]
    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]


@dataclass(frozen=True)
class _Entry:
    """A field that a message may have, its wire type, and how often at most."""

    name: str
    wire: int
    most: int = 1


# Fields of onnx.proto3 by number.
_MODEL = {
    1: _Entry("ir_version", VARINT),
    2: _Entry("producer_name", LENGTH_DELIMITED),
    3: _Entry("producer_version", LENGTH_DELIMITED),
    6: _Entry("doc_string", LENGTH_DELIMITED),
    7: _Entry("graph", LENGTH_DELIMITED),
    8: _Entry("opset_import", LENGTH_DELIMITED, 8),
    14: _Entry("metadata_props", LENGTH_DELIMITED, onnx_wire.MOST_ENTRIES),
}
_OPSET = {1: _Entry("domain", LENGTH_DELIMITED), 2: _Entry("version", VARINT)}
_GRAPH = {
    1: _Entry("node", LENGTH_DELIMITED, MOST_NODES),
    2: _Entry("name", LENGTH_DELIMITED),
    5: _Entry("initializer", LENGTH_DELIMITED, MOST_NODES),
    10: _Entry("doc_string", LENGTH_DELIMITED),
    11: _Entry("input", LENGTH_DELIMITED, MOST_TENSORS),
    12: _Entry("output", LENGTH_DELIMITED, MOST_TENSORS),
}
_NODE = {
    1: _Entry("input", LENGTH_DELIMITED, MOST_TENSORS),
    2: _Entry("output", LENGTH_DELIMITED, MOST_TENSORS),
    3: _Entry("name", LENGTH_DELIMITED),
    4: _Entry("op_type", LENGTH_DELIMITED),
    5: _Entry("attribute", LENGTH_DELIMITED, 8),
    6: _Entry("doc_string", LENGTH_DELIMITED),
    7: _Entry("domain", LENGTH_DELIMITED),
}
_ATTRIBUTE = {
    1: _Entry("name", LENGTH_DELIMITED),
    2: _Entry("f", FIXED32),
    3: _Entry("i", VARINT),
    4: _Entry("s", LENGTH_DELIMITED),
    8: _Entry("ints", VARINT, 2 * MOST_AXES),
    13: _Entry("doc_string", LENGTH_DELIMITED),
    20: _Entry("type", VARINT),
}
_CONSTANT = {
    1: _Entry("dims", VARINT, MOST_AXES),
    2: _Entry("data_type", VARINT),
    8: _Entry("name", LENGTH_DELIMITED),
    9: _Entry("raw_data", LENGTH_DELIMITED),
    12: _Entry("doc_string", LENGTH_DELIMITED),
}
_VALUE = {
    1: _Entry("name", LENGTH_DELIMITED),
    2: _Entry("type", LENGTH_DELIMITED),
    3: _Entry("doc_string", LENGTH_DELIMITED),
}
_TYPE = {1: _Entry("tensor_type", LENGTH_DELIMITED)}
_TENSOR_TYPE = {1: _Entry("elem_type", VARINT), 2: _Entry("shape", LENGTH_DELIMITED)}
_SHAPE = {1: _Entry("dim", LENGTH_DELIMITED, MOST_AXES)}
_DIM = {1: _Entry("dim_value", VARINT), 2: _Entry("dim_param", LENGTH_DELIMITED)}

# What the most telling of the other fields hold.
_FORBIDDEN = {
    ("model", 20): "instructions for training",
    ("model", 25): "functions of its own",
    ("graph", 13): "shapes of its inner tensors",
    ("graph", 15): "sparse weights",
    ("attribute", 5): "a tensor as an attribute",
    ("attribute", 6): "a graph within the graph",
    ("attribute", 10): "tensors as an attribute",
    ("attribute", 11): "graphs within the graph",
    ("attribute", 21): "an attribute of a function",
    ("attribute", 22): "sparse weights",
    ("attribute", 23): "sparse weights",
    ("initializer", 13): "weights in another file",
    ("initializer", 14): "weights in another file",
}


def size_of(shape: Shape) -> int:
    """Number of elements of a shape, exactly."""
    size = 1
    for length in shape:
        size *= length
    return size


def read_graph(model: bytes) -> Graph:
    """The model's graph; MalformedModel where the bytes are no model, ForbiddenGraph else."""
    parts = _read("model", model, _MODEL)
    if "graph" not in parts:
        raise MalformedModel("no graph")
    _require_plain_operators(parts)
    graph = _read("graph", parts["graph"][0], _GRAPH)
    nodes = tuple(_node(part) for part in graph.get("node", []))
    constants: dict[str, Constant] = {}
    for part in graph.get("initializer", []):
        name, constant = _constant(part)
        if name in constants:
            raise ForbiddenGraph(f"has two constants named {quoted(name)}")
        constants[name] = constant
    inputs, outputs = (tuple(map(_tensor, graph.get(key, []))) for key in ("input", "output"))
    return Graph(nodes, constants, inputs, outputs)


def quoted(text: str) -> str:
    """A name from a file as it may stand in a sentence: no control characters, and not for ever."""
    shown = repr(text)
    return shown if len(shown) <= 60 else f"{shown[:57]}…'"


def _require_plain_operators(model: Mapping[str, list[Any]]) -> None:
    sets = [_read("opset_import", part, _OPSET) for part in model.get("opset_import", [])]
    versions = [(_text(entry, "domain"), _number(entry, "version")) for entry in sets]
    if versions != [("", OPSET)]:
        shown = ", ".join(f"{quoted(domain)} {version}" for domain, version in versions) or "none"
        raise ForbiddenGraph(f"is of the operator sets {shown} where '' {OPSET} alone may be")


def _node(data: memoryview) -> Node:
    parts = _read("node", data, _NODE)
    op, domain = _text(parts, "op_type"), _text(parts, "domain")
    if domain or op not in OPERATORS:
        named = f"{quoted(op)} of {quoted(domain)}" if domain else quoted(op)
        raise ForbiddenGraph(f"uses the operator {named}, which no architecture needs")
    inputs, outputs = (tuple(map(_decoded, parts.get(key, []))) for key in ("input", "output"))
    found = [_attribute(op, part) for part in parts.get("attribute", [])]
    attributes = dict(found)
    if len(attributes) < len(found):
        raise ForbiddenGraph(f"gives an attribute of {op} twice")
    return Node(op, inputs, outputs, attributes)


def _attribute(op: str, data: memoryview) -> tuple[str, Attribute]:
    parts = _read("attribute", data, _ATTRIBUTE)
    name, kind = _text(parts, "name"), _number(parts, "type")
    if OPERATORS[op].get(name) != kind:
        raise ForbiddenGraph(f"gives {op} an attribute {quoted(name)} that no architecture needs")
    if kind == _INT:
        return name, _number(parts, "i")
    if kind == _INTS:
        return name, tuple(map(_signed, parts.get("ints", [])))
    if kind == _TEXT:
        return name, _text(parts, "s")
    return name, float(struct.unpack("<f", parts.get("f", [bytes(4)])[0])[0])


def _constant(data: memoryview) -> tuple[str, Constant]:
    parts = _read("initializer", data, _CONSTANT)
    name, element = _text(parts, "name"), _number(parts, "data_type")
    shape = tuple(map(_signed, parts.get("dims", [])))
    raw = parts.get("raw_data", [memoryview(b"")])[0]
    width = {FLOAT32: 4, INT64: 8}.get(element)
    if width is None or min(shape, default=1) < 1 or len(raw) != width * size_of(shape):
        raise ForbiddenGraph(
            f"has a constant {quoted(name)} that is no whole raw array of float32 or int64"
        )
    if element == FLOAT32 and not np.isfinite(np.frombuffer(raw, "<f4")).all():
        raise ForbiddenGraph(f"has a constant {quoted(name)} that is not finite")
    return name, Constant(element, shape, raw)


def _tensor(data: memoryview) -> Tensor:
    value = _read("value", data, _VALUE)
    kind = _read("type", _part(value, "type"), _TYPE)
    tensor = _read("tensor_type", _part(kind, "tensor_type"), _TENSOR_TYPE)
    dims = _read("shape", _part(tensor, "shape"), _SHAPE).get("dim", [])
    shape = tuple(_axis(_read("dim", dim, _DIM)) for dim in dims)
    return Tensor(_text(value, "name"), _number(tensor, "elem_type"), shape)


def _axis(dim: Mapping[str, list[Any]]) -> int | str:
    if len(dim) > 1:
        raise MalformedModel("an axis with a length and a name")
    return _signed(dim["dim_value"][0]) if "dim_value" in dim else _text(dim, "dim_param") or "?"


def _read(
    message: str, data: bytes | memoryview, entries: Mapping[int, _Entry]
) -> dict[str, list[Any]]:
    """A message's values by the names of their fields; other fields, or too many, are refused."""
    found: dict[str, list[Any]] = {}
    for field in onnx_wire.fields(data):
        entry = entries.get(field.number)
        if entry is None:
            held = _FORBIDDEN.get((message, field.number), f"a {message} with field {field.number}")
            raise ForbiddenGraph(f"holds {held}, which no architecture needs")
        values = found.setdefault(entry.name, [])
        values.extend(_values(field, entry))
        if len(values) > entry.most:
            raise ForbiddenGraph(f"has a {message} with more than {entry.most} {entry.name}")
    return found


def _values(field: onnx_wire.Field, entry: _Entry) -> Sequence[int | memoryview]:
    if field.wire == entry.wire:
        return [field.value]
    is_packed = entry.most > 1 and (entry.wire, field.wire) == (VARINT, LENGTH_DELIMITED)
    if is_packed and isinstance(field.value, memoryview):
        return onnx_wire.packed(field.value, entry.most + 1)
    raise MalformedModel(f"{entry.name} of another type")


def _part(parts: Mapping[str, list[Any]], name: str) -> memoryview:
    return parts[name][0] if name in parts else memoryview(b"")


def _text(parts: Mapping[str, list[Any]], name: str) -> str:
    return _decoded(_part(parts, name))


def _decoded(data: memoryview) -> str:
    if len(data) > _MOST_LETTERS:
        raise ForbiddenGraph(f"has a name of more than {_MOST_LETTERS} letters")
    try:
        return str(data, "utf-8")
    except UnicodeDecodeError as error:
        raise MalformedModel("text that is not UTF-8") from error


def _number(parts: Mapping[str, list[Any]], name: str) -> int:
    return _signed(parts[name][0]) if name in parts else 0


def _signed(value: int) -> int:
    """A varint as the int64 that it stands for."""
    return value - (1 << 64) if value >= 1 << 63 else value
