"""Products with constant weights: Gemm, and a convolution over one step's frames."""

import math

import numpy as np

from export.c.weights import Matrix, is_sparse
from export.c.writer import NotInC, StepWriter
from wakedeploy.core.onnx_graph import Node, size_of


class Matrices:
    """The weights that a step multiplies by, each once."""

    def __init__(self, writer: StepWriter) -> None:
        self._writer = writer
        self._made: dict[tuple[str, bool], Matrix] = {}
        dense = [node.inputs[1] for node in writer.graph.nodes if node.op == "Gemm"]
        self._has_reservoir = any(is_sparse(writer.weights(name)) for name in dense)

    @property
    def all(self) -> tuple[Matrix, ...]:
        """In the order in which the step takes them."""
        return tuple(self._made.values())

    def dense(self, node: Node) -> None:
        """Gemm: a vector times constant weights."""
        if node.attributes.get("alpha", 1.0) != 1.0 or node.attributes.get("transA", 0):
            raise NotInC("has a Gemm that no architecture has")
        if len(node.inputs) > 2 and node.attributes.get("beta", 1.0) != 1.0:
            raise NotInC("has a Gemm that scales its bias, which no architecture does")
        bias = node.inputs[2] if len(node.inputs) > 2 else None
        matrix = self._matrix(node.inputs[1], bias, bool(node.attributes.get("transB", 0)))
        self._multiply(matrix, node.inputs[0], bias, node.outputs[0])

    def convolution(self, node: Node) -> None:
        """A convolution over as many frames as its kernel is long: one product."""
        writer = self._writer
        taken, given = writer.shapes[node.inputs[0]], writer.shapes[node.inputs[1]]
        one_place = math.prod(writer.shapes[node.outputs[0]][2:]) == 1
        plain = node.attributes.get("group", 1) == 1 and not any(node.whole_numbers("pads"))
        if not plain or not one_place or taken[1:] != given[1:]:
            raise NotInC("has a convolution over more than a step's frames")
        bias = node.inputs[2] if len(node.inputs) > 2 else None
        matrix = self._matrix(node.inputs[1], bias, is_by_outputs=True)
        self._multiply(matrix, node.inputs[0], bias, node.outputs[0])

    def _multiply(self, matrix: Matrix, x: str, bias: str | None, y: str) -> None:
        writer = self._writer
        given = writer.contiguous(x)
        if size_of(given.shape) != matrix.weights.shape[1]:
            raise NotInC("multiplies several rows at once, which no architecture does in a step")
        added = writer.table(bias) if bias is not None else None
        if added is not None and size_of(added.shape) != len(matrix.weights):
            raise NotInC("adds one number to all outputs of a matrix, which no architecture does")
        made = writer.variable(y, writer.shapes[y], f"{matrix.name}_out")
        start = added.start if added is not None else "0"
        line = matrix.call(writer.kind, given.start, start, made.start)
        writer.add([line], reads=(given.store,), writes=(made.store,))

    def _matrix(self, name: str, bias: str | None, is_by_outputs: bool) -> Matrix:
        key = (name, is_by_outputs)
        if key not in self._made:
            weights = self._writer.weights(name)
            weights = weights.reshape(len(weights), -1)
            turned = weights if is_by_outputs else weights.T
            is_numbered = bias is not None and "." not in name  # by the exporter
            wish = f"{str(bias).removesuffix('bias')}weight" if is_numbered else name
            self._made[key] = Matrix(
                self._writer.names.new(wish),
                np.ascontiguousarray(turned),
                name,
                is_by_outputs,
                drives=self._has_reservoir and not is_sparse(turned),
            )
        return self._made[key]
