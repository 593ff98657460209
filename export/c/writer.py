"""What has been written of a step so far: values by the graph's names, and statements.

Views take nothing, and element-wise arithmetic is not computed until something needs its numbers
in memory; then one loop does all of it.
"""

from collections import Counter
from collections.abc import Callable, Iterable

import numpy as np

from export.c.identifiers import Names
from export.c.loops import Loop
from export.c.program import StateMember, Statement
from export.c.values import Buffer, Computed, Number, Store, Value, whole
from export.c.weights import Kind
from wakedeploy.core.manifest import FloatArray, Manifest
from wakedeploy.core.onnx_graph import FLOAT32, Graph, Node, Shape, size_of
from wakedeploy.core.onnx_shapes import cost_of


class NotInC(ValueError):
    """A graph for which no C is written; the text goes on from "its graph …"."""


class StepWriter:
    """A step of one graph while it is written; operators take values from it and add to it."""

    def __init__(self, graph: Graph, manifest: Manifest, kind: Kind) -> None:
        self.graph, self.manifest, self.kind = graph, manifest, kind
        self.shapes, _ = cost_of(graph, 1)
        self.names = Names()
        self.values: dict[str, Value] = {}
        self.gathered: dict[str, Callable[[], Buffer]] = {}  # put together once they are needed
        self.in_memory: dict[Computed, Buffer] = {}
        self.statements: list[Statement] = []
        self.tables: dict[str, FloatArray] = {}
        self.members: list[StateMember] = []
        self.states: dict[Store, Store] = {}  # of each next state, the present one
        self.targets: dict[str, Store] = {}  # where outputs go
        self.done: set[int] = set()  # nodes that something else has taken care of
        self.uses = Counter(name for node in graph.nodes for name in node.inputs)
        self.uses.update(tensor.name for tensor in graph.outputs)
        self.makers = {name: node for node in graph.nodes for name in node.outputs}
        self._tables: dict[str, Buffer] = {}

    def value(self, name: str) -> Buffer | Computed:
        """The tensor of this name; an expression may still have to be computed."""
        if name in self.gathered:
            return self.gathered[name]()
        value = self.values[name] if name in self.values else self.constant(name)
        if isinstance(value, Number):
            return self.table(name)
        if isinstance(value, Computed) and value in self.in_memory:
            return self.in_memory[value]
        return value

    def buffer(self, name: str) -> Buffer:
        """The tensor in memory."""
        value = self.value(name)
        return self.computed(value) if isinstance(value, Computed) else value

    def contiguous(self, name: str) -> Buffer:
        """The tensor in memory, its elements one after the other."""
        buffer = self.buffer(name)
        if buffer.is_contiguous:
            return buffer
        store = Store(self.names.new(name), size_of(buffer.shape))
        return self.copy(buffer, store)

    def constant(self, name: str) -> Value:
        """A constant as an operand; NotInC for what is none."""
        constant = self.graph.constants.get(name)
        if constant is None or constant.element != FLOAT32:
            raise NotInC(f"uses {name!r} as a number, which no architecture does")
        if size_of(constant.shape) == 1:
            return Number(float(self.weights(name).ravel()[0]), constant.shape)
        return self.table(name)

    def weights(self, name: str) -> FloatArray:
        """The numbers of a constant of the graph; NotInC for what is none."""
        constant = self.graph.constants.get(name)
        if constant is None or constant.element != FLOAT32:
            raise NotInC(f"multiplies by {name!r}, which is no constant")
        return np.frombuffer(constant.data, "<f4").reshape(constant.shape).astype(np.float32)

    def table(self, name: str) -> Buffer:
        """A constant as an array of the source."""
        if name not in self._tables:
            values = self.weights(name)
            store = Store(self.names.new(name), values.size, is_variable=False)
            self.tables[store.name] = values
            self._tables[name] = whole(store, values.shape)
        return self._tables[name]

    def zeros(self, size: int) -> Buffer:
        """As many zeros in an array of the source, for what a graph leaves out."""
        store = Store(self.names.new("zeros"), size, is_variable=False)
        self.tables[store.name] = np.zeros(size, np.float32)
        return whole(store, (size,))

    def numbers(self, node: Node, index: int, default: Shape) -> Shape:
        """The whole numbers that an input of a node holds."""
        if index >= len(node.inputs):
            return default
        constant = self.graph.constants[node.inputs[index]]
        return tuple(map(int, np.frombuffer(constant.data, "<i8")))

    def add(
        self,
        lines: Iterable[str],
        reads: Iterable[Store],
        writes: Iterable[Store],
        in_step: Iterable[tuple[Store, Store]] = (),
    ) -> None:
        """Some lines that belong together, and the stores that they touch."""
        made = Statement(tuple(lines), frozenset(reads), frozenset(writes), frozenset(in_step))
        self.statements.append(made)

    def computed(self, value: Computed) -> Buffer:
        """Compute an expression now, and what in it is needed elsewhere too."""
        if value in self.in_memory:
            return self.in_memory[value]
        return self._looped(value, value.shape)

    def _looped(self, value: Computed, shape: Shape) -> Buffer:
        loop = Loop(shape, self.in_memory)
        loop.store(value, self.target(value))
        for inner in loop.needed_elsewhere(value):
            loop.store(inner, self.target(inner))
        self.add(loop.lines(), loop.reads, loop.writes, loop.in_step())
        self.in_memory.update(loop.stored)
        return self.in_memory[value]

    def target(self, value: Computed) -> Store:
        """Where an expression's values go: an output's place, or a variable."""
        for name, target in self.targets.items():
            if self.values.get(name) is value:
                return target
        return Store(self.names.new(value.name), size_of(value.shape))

    def variable(self, name: str, shape: Shape, wish: str | None = None) -> Buffer:
        """Memory for an output of the graph's nodes."""
        store = self.targets.get(name) or Store(self.names.new(wish or name), size_of(shape))
        buffer = whole(store, shape)
        self.values[name] = buffer
        return buffer

    def copy(self, buffer: Buffer, store: Store) -> Buffer:
        """The same elements one after the other in another store."""
        made = whole(store, buffer.shape)
        loop = Loop(buffer.shape, self.in_memory)
        loop.copy(buffer, store)
        self.add(loop.lines(), loop.reads, loop.writes)
        return made
