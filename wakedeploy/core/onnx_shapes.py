"""What a step of a graph costs, computed from its shapes before anything is run.

Every length in a package's graph is a constant but for the batch, so that memory and work of a step
do not depend on what it is given. Shapes follow from onnx.proto3's operators (version 20), as far
as the eight architectures use them; whatever does not fit is refused.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from wakedeploy.core.onnx_graph import (
    INT64,
    MOST_AXES,
    Attribute,
    Constant,
    ForbiddenGraph,
    Graph,
    Node,
    Shape,
    quoted,
    size_of,
)

MOST_VALUES = 1 << 24  # that the tensors of a step hold together: 64 MiB as float32
MOST_WORK = 1 << 27  # values read, and products summed; a reservoir of 4,000 neurons has 2^25

_Value = TypeVar("_Value")


@dataclass(frozen=True)
class Cost:
    """What one step takes: elements that its tensors hold together, elements read and summed."""

    values: int
    work: int


@dataclass(frozen=True)
class _Call:
    """A node with the shapes of its inputs, and their numbers where they are constant."""

    node: Node
    shapes: tuple[Shape, ...]
    constants: tuple[Constant | None, ...]

    def whole(self, name: str, default: int) -> int:
        """An attribute that is one whole number."""
        value = self.node.attributes.get(name, default)
        return _known(value if isinstance(value, int) else None)

    def several(self, name: str, default: Shape) -> Shape:
        """An attribute that is some whole numbers."""
        value: Attribute | None = self.node.attributes.get(name, default)
        return _known(value if isinstance(value, tuple) else None)

    def numbers(self, index: int, default: Shape | None = None) -> Shape:
        """An input that has to be known beforehand: a shape, axes, where to cut."""
        if index >= len(self.shapes):
            return _known(default)
        constant = _known(self.constants[index])
        if constant.element != INT64 or constant.size > 2 * MOST_AXES:
            raise ValueError("numbers of another kind")
        return tuple(map(int, np.frombuffer(constant.data, "<i8")))


# Shapes of a node's outputs, and how many products are summed for each of their elements.
_Told = tuple[list[Shape], int]
_Rule = Callable[[_Call], _Told]


def cost_of(graph: Graph, batch: int) -> tuple[dict[str, Shape], Cost]:
    """Shapes of all tensors by name and what a step takes, for this many series in lockstep.

    Raises ForbiddenGraph where a node cannot be applied to what it is given, where a name is given
    twice or used before it is given, and beyond MOST_VALUES or MOST_WORK.
    """
    shapes: dict[str, Shape] = {}
    for tensor in graph.inputs:
        _name(shapes, tensor.name, _with_batch(tensor.shape, batch))
    for name, constant in graph.constants.items():
        _name(shapes, name, constant.shape)
    values = work = 0
    for node in graph.nodes:
        made, spent = _applied(node, shapes, graph.constants)
        values, work = values + sum(map(size_of, made)), work + spent
        if values > MOST_VALUES or work > MOST_WORK:
            raise ForbiddenGraph(
                f"takes more than a step may: {MOST_VALUES:,} values held and {MOST_WORK:,} used"
            )
        for name, shape in zip(node.outputs, made, strict=True):
            _name(shapes, name, shape)
    return shapes, Cost(values, work)


def _with_batch(shape: tuple[int | str, ...], batch: int) -> Shape:
    return tuple(batch if isinstance(length, str) else length for length in shape)


def _name(shapes: dict[str, Shape], name: str, shape: Shape) -> None:
    if name in shapes or not name:
        raise ForbiddenGraph(f"names two tensors {quoted(name)}, or one not at all")
    shapes[name] = shape


def _applied(
    node: Node, shapes: Mapping[str, Shape], constants: Mapping[str, Constant]
) -> tuple[list[Shape], int]:
    """The shapes of a node's outputs, and what it takes."""
    missing = [name for name in node.inputs if name not in shapes]
    if missing:
        raise ForbiddenGraph(f"uses {quoted(missing[0])} before anything gives it")
    if not node.outputs:
        raise ForbiddenGraph(f"has a {node.op} without an output")
    given = tuple(shapes[name] for name in node.inputs)
    call = _Call(node, given, tuple(constants.get(name) for name in node.inputs))
    try:
        made, inner = _RULES[node.op](call)
    except (IndexError, ValueError) as error:  # whatever of it does not fit the operator's rule
        listed = ", ".join(map(str, given))
        raise ForbiddenGraph(
            f"applies {node.op} to what it does not fit: {listed[:200]}"
        ) from error
    if len(made) != len(node.outputs) or any(not _usable(shape) for shape in made):
        raise ForbiddenGraph(f"has outputs of {node.op} that are empty, too many or too deep")
    return made, sum(map(size_of, given)) + inner * sum(map(size_of, made))


def _usable(shape: Shape) -> bool:
    return len(shape) <= MOST_AXES and min(shape, default=1) >= 1


def _known(value: _Value | None) -> _Value:
    if value is None:
        raise ValueError("not known before the step")
    return value


def _axis(axis: int, rank: int) -> int:
    if not -rank <= axis < rank:
        raise ValueError(f"axis {axis} of {rank}")
    return axis % rank


def _broadcast(call: _Call) -> _Told:
    turned = itertools.zip_longest(*(shape[::-1] for shape in call.shapes), fillvalue=1)
    made = []
    for lengths in turned:
        longest = max(lengths)
        if any(length not in (1, longest) for length in lengths):
            raise ValueError("lengths that differ")
        made.append(longest)
    return [tuple(made[::-1])], 1


def _alike(call: _Call) -> _Told:
    return [call.shapes[0]], 1


def _concat(call: _Call) -> _Told:
    first = call.shapes[0]
    axis = _axis(call.whole("axis", 0), len(first))
    if any(_without(shape, axis) != _without(first, axis) for shape in call.shapes):
        raise ValueError("lengths that differ")
    together = sum(shape[axis] for shape in call.shapes)
    return [_with(first, axis, together)], 1


def _conv(call: _Call) -> _Told:
    (batch, channels, *lengths), (filters, depth, *kernel) = call.shapes[:2]
    n, groups = len(kernel), call.whole("group", 1)
    strides, dilations = (call.several(key, (1,) * n) for key in ("strides", "dilations"))
    pads = call.several("pads", (0,) * 2 * n)
    usual = call.node.attributes.get("auto_pad", "NOTSET") == "NOTSET"
    fits = usual and groups >= 1 and channels == depth * groups and filters % groups == 0
    if not fits or min(strides) < 1 or min(dilations) < 1 or min(pads) < 0:
        raise ValueError("a convolution of another kind")
    made = []
    for i, (length, taps) in enumerate(zip(lengths, kernel, strict=True)):
        reach = dilations[i] * (taps - 1) + 1
        made.append((length + pads[i] + pads[n + i] - reach) // strides[i] + 1)
    return [(batch, filters, *made)], depth * size_of(tuple(kernel))


def _gather(call: _Call) -> _Told:
    data, indices = call.shapes
    axis = _axis(call.whole("axis", 0), len(data))
    return [data[:axis] + indices + data[axis + 1 :]], 1


def _gemm(call: _Call) -> _Told:
    first, second = call.shapes[:2]
    rows, inner = first[::-1] if call.whole("transA", 0) else first
    depth, columns = second[::-1] if call.whole("transB", 0) else second
    if inner != depth:
        raise ValueError("lengths that differ")
    return [(rows, columns)], inner


def _matmul(call: _Call) -> _Told:
    (*ones, rows, inner), (*others, depth, columns) = call.shapes
    if inner != depth:
        raise ValueError("lengths that differ")
    stacks = _Call(call.node, (tuple(ones), tuple(others)), ())
    return [(*_broadcast(stacks)[0][0], rows, columns)], inner


def _reduce(call: _Call) -> _Told:
    shape = call.shapes[0]
    axes = {_axis(axis, len(shape)) for axis in call.numbers(1)}
    if call.whole("keepdims", 1):
        return [tuple(1 if i in axes else length for i, length in enumerate(shape))], 1
    return [tuple(length for i, length in enumerate(shape) if i not in axes)], 1


def _reshape(call: _Call) -> _Told:
    size, asked = size_of(call.shapes[0]), call.numbers(1)
    rest = size_of(tuple(length for length in asked if length != -1))
    if min(asked, default=1) < -1 or 0 in asked or asked.count(-1) > 1 or size % rest:
        raise ValueError("another number of elements")
    made = tuple(size // rest if length == -1 else length for length in asked)
    if size_of(made) != size:
        raise ValueError("another number of elements")
    return [made], 1


def _slice(call: _Call) -> _Told:
    shape = list(call.shapes[0])
    starts, ends = call.numbers(1), call.numbers(2)
    axes = call.numbers(3, tuple(range(len(starts))))
    steps = call.numbers(4, (1,) * len(starts))
    if min(steps) < 1 or len(set(axes)) < len(axes):
        raise ValueError("a cut of another kind")
    for start, end, axis, step in zip(starts, ends, axes, steps, strict=True):
        length = shape[_axis(axis, len(shape))]
        first, last = (_clipped(place, length) for place in (start, end))
        shape[axis] = max(0, -((first - last) // step))
    return [tuple(shape)], 1


def _clipped(place: int, length: int) -> int:
    return min(max(place + length if place < 0 else place, 0), length)


def _split(call: _Call) -> _Told:
    shape, parts = call.shapes[0], len(call.node.outputs)
    axis = _axis(call.whole("axis", 0), len(shape))
    each = -(-shape[axis] // parts)
    even = (*[each] * (parts - 1), shape[axis] - each * (parts - 1))
    lengths = call.numbers(1, even)
    if sum(lengths) != shape[axis] or call.whole("num_outputs", parts) != parts:
        raise ValueError("another number of elements")
    return [_with(shape, axis, length) for length in lengths], 1


def _squeeze(call: _Call) -> _Told:
    shape = call.shapes[0]
    axes = {_axis(axis, len(shape)) for axis in call.numbers(1)}
    if any(shape[axis] != 1 for axis in axes):
        raise ValueError("an axis longer than 1")
    return [tuple(length for i, length in enumerate(shape) if i not in axes)], 1


def _transpose(call: _Call) -> _Told:
    shape = call.shapes[0]
    order = call.several("perm", tuple(range(len(shape)))[::-1])
    if sorted(order) != list(range(len(shape))):
        raise ValueError("no order of the axes")
    return [tuple(shape[i] for i in order)], 1


def _unsqueeze(call: _Call) -> _Told:
    given = call.numbers(1)
    rank = len(call.shapes[0]) + len(given)
    axes = {_axis(axis, rank) for axis in given}
    if len(axes) < len(given):
        raise ValueError("an axis twice")
    rest = iter(call.shapes[0])
    return [tuple(1 if i in axes else next(rest) for i in range(rank))], 1


def _without(shape: Shape, axis: int) -> Shape:
    return shape[:axis] + shape[axis + 1 :]


def _with(shape: Shape, axis: int, length: int) -> Shape:
    return (*shape[:axis], length, *shape[axis + 1 :])


_RULES: dict[str, _Rule] = {
    **dict.fromkeys(("Add", "Div", "Greater", "Mul", "Pow", "Sub", "Where"), _broadcast),
    **dict.fromkeys(("Exp", "LayerNormalization", "Reciprocal", "Relu", "Sigmoid"), _alike),
    **dict.fromkeys(("Softmax", "Softplus", "Sqrt", "Tanh"), _alike),
    **dict.fromkeys(("ReduceMean", "ReduceSum"), _reduce),
    "Concat": _concat,
    "Conv": _conv,
    "Gather": _gather,
    "Gemm": _gemm,
    "MatMul": _matmul,
    "Reshape": _reshape,
    "Slice": _slice,
    "Split": _split,
    "Squeeze": _squeeze,
    "Transpose": _transpose,
    "Unsqueeze": _unsqueeze,
}
