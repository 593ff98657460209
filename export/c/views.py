"""Views: other shapes of numbers that lie in memory already; they take nothing."""

import numpy as np

from export.c.loops import Loop
from export.c.values import Buffer, whole
from export.c.writer import NotInC, StepWriter
from wakedeploy.core.onnx_graph import FLOAT32, Node


def reshape(writer: StepWriter, node: Node) -> None:
    """Also Squeeze and Unsqueeze: the same elements in the same order."""
    given = writer.contiguous(node.inputs[0])
    shape = writer.shapes[node.outputs[0]]
    made = whole(given.store, shape)
    writer.values[node.outputs[0]] = Buffer(given.store, shape, made.strides, given.offset)


def transpose(writer: StepWriter, node: Node) -> None:
    """Other strides."""
    given = writer.buffer(node.inputs[0])
    order = node.whole_numbers("perm") or tuple(range(len(given.shape)))[::-1]
    shape = tuple(given.shape[axis] for axis in order)
    strides = tuple(given.strides[axis] for axis in order)
    writer.values[node.outputs[0]] = Buffer(given.store, shape, strides, given.offset)


def split(writer: StepWriter, node: Node) -> None:
    """Several places of one buffer."""
    given = writer.buffer(node.inputs[0])
    axis = node.whole_number("axis") % len(given.shape)
    offset = given.offset
    for name in node.outputs:
        shape = writer.shapes[name]
        writer.values[name] = Buffer(given.store, shape, given.strides, offset)
        offset += given.strides[axis] * shape[axis]


def slice(writer: StepWriter, node: Node) -> None:
    """A part along one axis."""
    axis, first, step, _ = cut_of(writer, node)
    given = writer.buffer(node.inputs[0])
    strides = tuple(s * step if i == axis else s for i, s in enumerate(given.strides))
    offset = given.offset + first * given.strides[axis]
    shape = writer.shapes[node.outputs[0]]
    writer.values[node.outputs[0]] = Buffer(given.store, shape, strides, offset)


def cut_of(writer: StepWriter, node: Node) -> tuple[int, int, int, int]:
    """Axis, first place, step and how many, of a Slice along one axis."""
    shape = writer.shapes[node.inputs[0]]
    starts = writer.numbers(node, 1, ())
    axes = writer.numbers(node, 3, tuple(range(len(starts))))
    steps = writer.numbers(node, 4, (1,) * len(starts))
    if len(starts) != 1:
        raise NotInC("cuts along several axes at once, which no architecture does")
    axis, start = axes[0] % len(shape), starts[0]
    first = min(max(start + shape[axis] if start < 0 else start, 0), shape[axis])
    return axis, first, steps[0], writer.shapes[node.outputs[0]][axis]


def gather(writer: StepWriter, node: Node) -> None:
    """One place along an axis."""
    given = writer.buffer(node.inputs[0])
    index = writer.graph.constants.get(node.inputs[1])
    if index is None or index.shape != () or index.element == FLOAT32:
        raise NotInC("picks several places at once, which no architecture does")
    axis = node.whole_number("axis") % len(given.shape)
    place = int(np.frombuffer(index.data, "<i8")[0]) % given.shape[axis]
    shape, strides = (
        tuple(n for i, n in enumerate(of) if i != axis) for of in (given.shape, given.strides)
    )
    offset = given.offset + place * given.strides[axis]
    writer.values[node.outputs[0]] = Buffer(given.store, shape, strides, offset)


def concatenation(writer: StepWriter, node: Node) -> None:
    """Side by side, which does take copies."""
    name = node.outputs[0]
    shape = writer.shapes[name]
    axis = node.whole_number("axis") % len(shape)
    made = writer.variable(name, shape)
    offset = 0
    for part in node.inputs:
        buffer = writer.buffer(part)
        place = Buffer(made.store, buffer.shape, made.strides, offset)
        loop = Loop(buffer.shape, writer.in_memory)
        loop.copy_to(buffer, place)
        writer.add(loop.lines(), loop.reads, loop.writes)
        offset += made.strides[axis] * buffer.shape[axis]
