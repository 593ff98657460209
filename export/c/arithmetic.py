"""Arithmetic of a graph as statements of C: expressions, sums, products, norms."""

import math

from export.c.loops import Loop
from export.c.values import FORMS, Buffer, Computed, Number, Value, literal, same_but_units
from export.c.writer import NotInC, StepWriter
from wakedeploy.core.onnx_graph import Node, Shape, size_of


def elementwise(writer: StepWriter, node: Node) -> None:
    """An expression, not yet computed."""
    shape = writer.shapes[node.outputs[0]]
    form = FORMS.get(node.op, "")
    if node.op == "Pow":
        form = _power(writer, node)
    operands = tuple(_operand(writer, name, shape) for name in node.inputs[: _count(form)])
    name = node.outputs[0]
    writer.values[name] = Computed(
        writer.names.new(_telling(name, node.op)), form, operands, shape, writer.uses[name]
    )


def _power(writer: StepWriter, node: Node) -> str:
    exponent = writer.constant(node.inputs[1])
    if isinstance(exponent, Number) and exponent.value == 2.0:
        return "{0} * {0}"
    raise NotInC("raises to another power than 2, which no architecture does")


def _operand(writer: StepWriter, name: str, shape: Shape) -> Value:
    """An operand of an expression of this shape; one of another shape is computed before."""
    if name in writer.graph.constants:
        return writer.constant(name)
    value = writer.value(name)
    is_alike = isinstance(value, Computed) and same_but_units(value.shape, shape)
    return value if is_alike or isinstance(value, Buffer) else writer.buffer(name)


def product(writer: StepWriter, node: Node) -> None:
    """MatMul, of small matrices: three loops around a sum."""
    first, other = writer.buffer(node.inputs[0]), writer.buffer(node.inputs[1])
    made = writer.variable(node.outputs[0], writer.shapes[node.outputs[0]])
    loop = Loop(made.shape, writer.in_memory)
    loop.sum_of_products(first, other, made)
    writer.add(loop.lines(), loop.reads, loop.writes)


def reduction(writer: StepWriter, node: Node) -> None:
    """ReduceSum and ReduceMean, with the arithmetic before them in the same loops."""
    value = writer.value(node.inputs[0])
    rank = len(value.shape)
    axes = {axis % rank for axis in writer.numbers(node, 1, tuple(range(rank)))}
    made = writer.variable(node.outputs[0], writer.shapes[node.outputs[0]])
    loop = Loop(value.shape, writer.in_memory, reduced=axes)
    divisor = math.prod(value.shape[axis] for axis in axes) if node.op == "ReduceMean" else 1
    loop.sum(value, made, divisor)
    if isinstance(value, Computed):
        for inner in loop.needed_elsewhere(value, with_it=True):
            loop.store(inner, writer.target(inner))
    writer.add(loop.lines(), loop.reads, loop.writes, loop.in_step())
    writer.in_memory.update(loop.stored)


def softmax(writer: StepWriter, node: Node) -> None:
    """Along the last axis, row by row."""
    given = writer.contiguous(node.inputs[0])
    _require_last(node, given.shape)
    made = writer.variable(node.outputs[0], given.shape)
    _by_rows(writer, given, made, "softmax({x}, {y}, {n});", in_step=True)


def layer_norm(writer: StepWriter, node: Node) -> None:
    """Along the last axis, row by row."""
    given = writer.contiguous(node.inputs[0])
    _require_last(node, given.shape)
    n = given.shape[-1]
    gain = writer.table(node.inputs[1])
    bias = writer.table(node.inputs[2]) if len(node.inputs) > 2 else writer.zeros(n)
    if size_of(gain.shape) != n or size_of(bias.shape) != n:
        raise NotInC(f"has a {node.op} whose gain or bias has not the {n} numbers of its axis")
    epsilon = literal(float(str(node.attributes.get("epsilon", 1e-5))))
    made = writer.variable(node.outputs[0], given.shape)
    call = f"layer_norm({{x}}, {gain.start}, {bias.start}, {epsilon}, {{y}}, {{n}});"
    _by_rows(writer, given, made, call, in_step=False)


def _by_rows(writer: StepWriter, given: Buffer, made: Buffer, call: str, in_step: bool) -> None:
    n = given.shape[-1]
    rows = size_of(given.shape) // n
    x, y = given.start, made.start
    if rows > 1:
        x, y = f"{x} + i * {n}", f"{y} + i * {n}"
    line = call.format(x=x, y=y, n=n)
    head = f"for (int i = 0; i < {rows}; ++i) {{"
    lines = [line] if rows == 1 else [head, f"    {line}", "}"]
    pairs = [(given.store, made.store)] if in_step and given.offset == made.offset else []
    writer.add(lines, reads=(given.store,), writes=(made.store,), in_step=pairs)


def _require_last(node: Node, shape: Shape) -> None:
    axis = node.attributes.get("axis", -1)
    if not isinstance(axis, int) or axis % len(shape) != len(shape) - 1:
        raise NotInC(f"has a {node.op} over another axis than the last")


def _count(form: str) -> int:
    """How many operands a form takes."""
    return 1 if "{0}" in form else form.count("{}")


def _telling(name: str, op: str) -> str:
    """A tensor's name, or the operator's for one that the exporter has numbered."""
    return op.lower() if name.startswith("val_") else name
