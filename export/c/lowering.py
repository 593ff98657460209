"""A package's graph as statements of C: one function for every kind of operator.

Views take nothing, and element-wise arithmetic is not computed until something needs its numbers
in memory; then one loop does all of it. A state to which each step adds a frame and from which it
drops the oldest is a ring, and so is the window.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable

import numpy as np

from export.c.identifiers import Names
from export.c.loops import Loop
from export.c.program import Program, StateMember, Statement, settled, with_rooms
from export.c.values import (
    Buffer,
    Computed,
    Index,
    Number,
    Store,
    Value,
    literal,
    same_but_units,
    token,
    whole,
)
from export.c.weights import Kind, Matrix, is_sparse
from wakedeploy.core.manifest import FloatArray, Manifest
from wakedeploy.core.onnx_graph import FLOAT32, Graph, Node, Shape, size_of
from wakedeploy.core.onnx_shapes import cost_of


class NotInC(ValueError):
    """A graph for which no C is written; the text goes on from "its graph …"."""


def lowered(graph: Graph, manifest: Manifest, kind: Kind) -> Program:
    """The step of a package as C; NotInC for what none of the eight architectures has."""
    return _Lowering(graph, manifest, kind).program()


# What each element becomes; tanh and the like are those of <math.h>.
_FORMS = {
    "Add": "{} + {}",
    "Sub": "{} - {}",
    "Mul": "{} * {}",
    "Div": "{} / {}",
    "Greater": "{} > {}",
    "Where": "{} ? {} : {}",
    "Exp": "expf({})",
    "Reciprocal": "1.0f / {}",
    "Relu": "{0} < 0.0f ? 0.0f : {0}",  # what is no number stays none
    "Sigmoid": "sigmoid({})",
    "Softplus": "softplus({})",
    "Sqrt": "sqrtf({})",
    "Tanh": "tanhf({})",
}
_CHANNELWISE = ("Sub", "Div", "Add", "Mul")  # what may be done to a frame before it is kept


class _Lowering:
    def __init__(self, graph: Graph, manifest: Manifest, kind: Kind) -> None:
        self.graph, self.manifest, self.kind = graph, manifest, kind
        self.shapes, _ = cost_of(graph, 1)
        self.names = Names()
        self.values: dict[str, Value] = {}
        self.in_memory: dict[Computed, Buffer] = {}
        self.statements: list[Statement] = []
        self.matrices: dict[tuple[str, bool], Matrix] = {}
        self.tables: dict[str, FloatArray] = {}
        self.table_stores: dict[str, Buffer] = {}
        self.uses = Counter(name for node in graph.nodes for name in node.inputs)
        self.uses.update(tensor.name for tensor in graph.outputs)
        self.makers = {name: node for node in graph.nodes for name in node.outputs}
        self.rings: dict[str, _Ring] = {}  # by the name of their context
        dense = [node.inputs[1] for node in graph.nodes if node.op == "Gemm"]
        self.has_reservoir = any(is_sparse(self._weights(name)) for name in dense)
        self.done: set[int] = set()  # nodes that something else has taken care of
        self.members: list[StateMember] = []
        self.states: dict[Store, Store] = {}
        self.targets: dict[str, Store] = {}

    def program(self) -> Program:
        self._take_inputs()
        for node in self.graph.nodes:
            if id(node) not in self.done:
                _RULES[node.op](self, node)
                self._retire(node)
        self._give_outputs()
        statements, named = settled(self.statements, self.states)
        rooms, places = with_rooms(statements, named)
        return Program(
            tuple(statements),
            tuple(self.members),
            tuple(self.matrices.values()),
            self.tables,
            rooms,
            named | places,
        )

    # ---- what goes in and what comes out

    def _take_inputs(self) -> None:
        self.targets["force"] = Store("force", len(self.manifest.force), is_variable=False)
        observation = Store("observation", len(self.manifest.observation), is_variable=False)
        frame = whole(observation, (1, observation.size))
        if self.manifest.memory.kind == "window":
            self._take_window(frame)
        else:
            self.values["observation"] = frame
        for name, state in self.manifest.memory.states.items():
            if not self._take_ring(name):
                initial = state.initial_array(1)[0]
                self._take_state(name, initial)

    def _take_state(self, name: str, initial: FloatArray) -> None:
        member = self.names.new(name)
        self.members.append(StateMember(member, initial.size, initial.ravel(), name))
        store = Store(f"state->{member}", initial.size, is_variable=False)
        self.values[f"state_{name}"] = whole(store, (1, *initial.shape))
        following = Store(self.names.new(f"next_{member}"), initial.size)
        self.states[following] = store
        self.targets[f"next_state_{name}"] = following

    def _take_ring(self, name: str) -> bool:
        """Whether a state is a queue of frames, oldest first, along its last axis."""
        taken = [n for n in self.graph.nodes if f"state_{name}" in n.inputs]
        maker = self.makers.get(f"next_state_{name}")
        state = self.manifest.memory.states[name]
        if len(taken) != 1 or taken[0].op != "Concat" or maker is None or maker.op != "Slice":
            return False
        context, length = taken[0], state.shape[-1]
        shape = self.shapes[context.outputs[0]]
        is_queue = (
            context.inputs[0] == f"state_{name}"
            and len(context.inputs) == 2
            and shape == (1, *state.shape[:-1], length + 1)
            and maker.inputs[0] == context.outputs[0]
            and self._cut(maker) == (len(shape) - 1, 1, 1, length)
            and isinstance(state.initial, float)
        )
        if not is_queue:
            return False
        channels = size_of(state.shape[:-1])
        member = self.names.new(name)
        initial = state.initial_array(1)[0].reshape(channels, length).T.ravel()
        self.members.append(
            StateMember(member, initial.size, initial, f"{name}: the last {length} frames, a ring")
        )
        at = self.names.new(f"{member}_at")
        self.members.append(StateMember(at, what="where its oldest frame lies"))
        store = Store(f"state->{member}", initial.size, is_variable=False)
        ring = _Ring(store, f"state->{at}", channels, length, shape)
        self.rings[context.outputs[0]] = ring
        ring.left = self.uses[context.outputs[0]] - 1
        self.done.add(id(maker))
        self.states.pop(store, None)
        return True

    def _take_window(self, frame: Buffer) -> None:
        """Keep each observation, normalised once, in a ring; lay the window out of it."""
        memory, d = self.manifest.memory, frame.store.size
        name = "window"
        kept: Value = frame
        while (node := self._only_use(name)) is not None and node.op in _CHANNELWISE:
            constant = self.graph.constants.get(node.inputs[1])
            if node.inputs[0] != name or constant is None or size_of(constant.shape) not in (1, d):
                break
            operands = (kept, self._constant(node.inputs[1]))
            kept = Computed(self.names.new(node.outputs[0]), _FORMS[node.op], operands, (1, d))
            self.done.add(id(node))
            name = node.outputs[0]
        present = self._in_memory(kept) if isinstance(kept, Computed) else frame
        size = memory.span * d
        member, at = self.names.new("window"), self.names.new("window_at")
        self.members.append(
            StateMember(member, size, np.zeros(size, np.float32), f"{memory.span} frames, a ring")
        )
        self.members.append(StateMember(at, what="where the next frame goes"))
        begun = self.names.new("seen")
        self.members.append(StateMember(begun, what="0 before the first observation"))
        store = Store(f"state->{member}", size, is_variable=False)
        window = Store(self.names.new("snapshots"), memory.k * d)
        head = f"state->{at}"
        lines = [
            "/* The first observation stands in for those before it. */",
            f"for (int i = 0; i < (state->{begun} != 0 ? 1 : {memory.span}); ++i) {{",
            f"    float *frame = {store.name} + {head} * {d};",
            f"    for (int j = 0; j < {d}; ++j) {{",
            f"        frame[j] = {token(present.store)}[j];",
            "    }",
            f"    {head} = {head} + 1 < {memory.span} ? {head} + 1 : 0;",
            "}",
            f"state->{begun} = 1;",
            f"for (int i = 0; i < {memory.k}; ++i) {{",
            f"    const float *frame ="
            f" {store.name} + ({Index((('i', memory.stride), (head, 1)))}) % {memory.span} * {d};",
            f"    for (int j = 0; j < {d}; ++j) {{",
            f"        {token(window)}[i * {d} + j] = frame[j];",
            "    }",
            "}",
        ]
        self._add(lines, reads=(present.store, store), writes=(store, window))
        self.values[name] = whole(window, (1, memory.k, d))

    def _only_use(self, name: str) -> Node | None:
        taken = [node for node in self.graph.nodes if name in node.inputs]
        return taken[0] if len(taken) == 1 and self.uses[name] == 1 else None

    def _give_outputs(self) -> None:
        for tensor in self.graph.outputs:
            target = self.targets.get(tensor.name)
            if target is None:
                continue
            value = self._value(tensor.name)
            if isinstance(value, Computed):
                self._in_memory(value)
            elif value.store is not target:
                self._copy(value, target)

    # ---- values

    def _value(self, name: str) -> Buffer | Computed:
        if name in self.rings:
            ring = self.rings[name]
            return self._gathered(ring, name, 0, 1, ring.length + 1)
        value = self.values[name] if name in self.values else self._constant(name)
        if isinstance(value, Number):
            return self._table(name)
        if isinstance(value, Computed) and value in self.in_memory:
            return self.in_memory[value]
        return value

    def _buffer(self, name: str) -> Buffer:
        value = self._value(name)
        return self._in_memory(value) if isinstance(value, Computed) else value

    def _contiguous(self, name: str) -> Buffer:
        buffer = self._buffer(name)
        if buffer.is_contiguous:
            return buffer
        store = Store(self.names.new(name), size_of(buffer.shape))
        return self._copy(buffer, store)

    def _constant(self, name: str) -> Value:
        constant = self.graph.constants.get(name)
        if constant is None or constant.element != FLOAT32:
            raise NotInC(f"uses {name!r} as a number, which no architecture does")
        if size_of(constant.shape) == 1:
            return Number(float(self._weights(name).ravel()[0]), constant.shape)
        return self._table(name)

    def _weights(self, name: str) -> FloatArray:
        constant = self.graph.constants.get(name)
        if constant is None or constant.element != FLOAT32:
            raise NotInC(f"multiplies by {name!r}, which is no constant")
        return np.frombuffer(constant.data, "<f4").reshape(constant.shape).astype(np.float32)

    def _table(self, name: str) -> Buffer:
        if name not in self.table_stores:
            values = self._weights(name)
            store = Store(self.names.new(name), values.size, is_variable=False)
            self.tables[store.name] = values
            self.table_stores[name] = whole(store, values.shape)
        return self.table_stores[name]

    def _numbers(self, node: Node, index: int, default: Shape) -> Shape:
        if index >= len(node.inputs):
            return default
        constant = self.graph.constants[node.inputs[index]]
        return tuple(map(int, np.frombuffer(constant.data, "<i8")))

    # ---- statements

    def _add(
        self,
        lines: Iterable[str],
        reads: Iterable[Store],
        writes: Iterable[Store],
        in_step: Iterable[tuple[Store, Store]] = (),
    ) -> None:
        made = Statement(tuple(lines), frozenset(reads), frozenset(writes), frozenset(in_step))
        self.statements.append(made)

    def _in_memory(self, value: Computed) -> Buffer:
        """Compute an expression now, and what in it is needed elsewhere too."""
        if value in self.in_memory:
            return self.in_memory[value]
        return self._looped(value, value.shape)

    def _looped(self, value: Computed, shape: Shape) -> Buffer:
        loop = Loop(shape, self.in_memory)
        loop.store(value, self._target(value))
        for inner in loop.needed_elsewhere(value):
            loop.store(inner, self._target(inner))
        self._add(loop.lines(), loop.reads, loop.writes, loop.in_step())
        self.in_memory.update(loop.stored)
        return self.in_memory[value]

    def _target(self, value: Computed) -> Store:
        for name, target in self.targets.items():
            if self.values.get(name) is value:
                return target
        return Store(self.names.new(value.name), size_of(value.shape))

    def _variable(self, name: str, shape: Shape, wish: str | None = None) -> Buffer:
        """Memory for an output of the graph's nodes."""
        store = self.targets.get(name) or Store(self.names.new(wish or name), size_of(shape))
        buffer = whole(store, shape)
        self.values[name] = buffer
        return buffer

    def _copy(self, buffer: Buffer, store: Store) -> Buffer:
        made = whole(store, buffer.shape)
        loop = Loop(buffer.shape, self.in_memory)
        loop.copy(buffer, store)
        self._add(loop.lines(), loop.reads, loop.writes)
        return made

    # ---- rings

    def _gathered(self, ring: "_Ring", name: str, first: int, step: int, count: int) -> Buffer:
        """Frames of a ring with the newest behind them, channel by channel (…, count)."""
        key = (first, step, count)
        if key in ring.gathered:
            return ring.gathered[key]
        c, new = ring.channels, ring.newest
        store = Store(self.names.new("taps"), c * count)
        has_newest = first + step * (count - 1) == ring.length
        old = count - 1 if has_newest else count
        place = str(Index((("i", step), (ring.at, 1)), first))
        lines = [
            f"for (int i = 0; i < {old}; ++i) {{",
            f"    const float *frame = {ring.store.name} + ({place}) % {ring.length} * {c};",
            f"    for (int j = 0; j < {c}; ++j) {{",
            f"        {token(store)}[j * {count} + i] = frame[j];",
            "    }",
            "}",
        ]
        if has_newest:
            lines += [
                f"for (int j = 0; j < {c}; ++j) {{",
                f"    {token(store)}[j * {count} + {old}] = {new.start}[j];",
                "}",
            ]
        self._add(lines, reads=(ring.store, new.store), writes=(store,))
        made = whole(store, (*ring.shape[:-1], count))
        ring.gathered[key] = made
        return made

    def _retire(self, node: Node) -> None:
        """Put the newest frame into its ring once nothing looks at the oldest any more."""
        for name in node.inputs:
            ring = self.rings.get(name)
            if ring is None:
                continue
            ring.left -= 1
            if ring.left == 0:
                self._push(ring)

    def _push(self, ring: "_Ring") -> None:
        c, new = ring.channels, ring.newest
        lines = [
            f"for (int i = 0; i < {c}; ++i) {{",
            f"    {ring.store.name}[{ring.at} * {c} + i] = {new.start}[i];",
            "}",
            f"{ring.at} = {ring.at} + 1 < {ring.length} ? {ring.at} + 1 : 0;",
        ]
        self._add(lines, reads=(new.store,), writes=(ring.store,))

    # ---- operators

    def elementwise(self, node: Node) -> None:
        shape = self.shapes[node.outputs[0]]
        form = _FORMS.get(node.op, "")
        if node.op == "Pow":
            form = self._power(node)
        operands = tuple(self._operand(name, shape) for name in node.inputs[: _count(form)])
        name = node.outputs[0]
        self.values[name] = Computed(
            self.names.new(_telling(name, node.op)), form, operands, shape, self.uses[name]
        )

    def _power(self, node: Node) -> str:
        exponent = self._constant(node.inputs[1])
        if isinstance(exponent, Number) and exponent.value == 2.0:
            return "{0} * {0}"
        raise NotInC("raises to another power than 2, which no architecture does")

    def _operand(self, name: str, shape: Shape) -> Value:
        """An operand of an expression of this shape; one of another shape is computed before."""
        if name in self.graph.constants:
            return self._constant(name)
        value = self._value(name)
        is_alike = isinstance(value, Computed) and same_but_units(value.shape, shape)
        return value if is_alike or isinstance(value, Buffer) else self._buffer(name)

    def dense(self, node: Node) -> None:
        """Gemm: a vector times constant weights."""
        if node.attributes.get("alpha", 1.0) != 1.0 or node.attributes.get("transA", 0):
            raise NotInC("has a Gemm that no architecture has")
        bias = node.inputs[2] if len(node.inputs) > 2 else None
        matrix = self._matrix(node.inputs[1], bias, bool(node.attributes.get("transB", 0)))
        self._multiply(matrix, node.inputs[0], bias, node.outputs[0])

    def _multiply(self, matrix: Matrix, x: str, bias: str | None, y: str) -> None:
        given = self._contiguous(x)
        if size_of(given.shape) != matrix.weights.shape[1]:
            raise NotInC("multiplies several rows at once, which no architecture does in a step")
        added = self._table(bias) if bias is not None else None
        if added is not None and size_of(added.shape) != len(matrix.weights):
            raise NotInC("adds one number to all outputs of a matrix, which no architecture does")
        made = self._variable(y, self.shapes[y], f"{matrix.name}_out")
        start = added.start if added is not None else "0"
        line = matrix.call(self.kind, given.start, start, made.start)
        self._add([line], reads=(given.store,), writes=(made.store,))

    def _matrix(self, name: str, bias: str | None, is_by_outputs: bool) -> Matrix:
        key = (name, is_by_outputs)
        if key not in self.matrices:
            weights = self._weights(name)
            weights = weights.reshape(len(weights), -1)
            turned = weights if is_by_outputs else weights.T
            is_numbered = bias is not None and "." not in name  # by the exporter
            wish = f"{str(bias).removesuffix('bias')}weight" if is_numbered else name
            self.matrices[key] = Matrix(
                self.names.new(wish),
                np.ascontiguousarray(turned),
                name,
                is_by_outputs,
                drives=self.has_reservoir and not is_sparse(turned),
            )
        return self.matrices[key]

    def convolution(self, node: Node) -> None:
        """A convolution over as many frames as its kernel is long: one product."""
        taken, given = self.shapes[node.inputs[0]], self.shapes[node.inputs[1]]
        one_place = math.prod(self.shapes[node.outputs[0]][2:]) == 1
        plain = node.attributes.get("group", 1) == 1 and not any(_tuple(node, "pads"))
        if not plain or not one_place or taken[1:] != given[1:]:
            raise NotInC("has a convolution over more than a step's frames")
        bias = node.inputs[2] if len(node.inputs) > 2 else None
        matrix = self._matrix(node.inputs[1], bias, is_by_outputs=True)
        self._multiply(matrix, node.inputs[0], bias, node.outputs[0])

    def product(self, node: Node) -> None:
        """MatMul, of small matrices: three loops around a sum."""
        one, other = self._buffer(node.inputs[0]), self._buffer(node.inputs[1])
        made = self._variable(node.outputs[0], self.shapes[node.outputs[0]])
        loop = Loop(made.shape, self.in_memory)
        loop.sum_of_products(one, other, made)
        self._add(loop.lines(), loop.reads, loop.writes)

    def reduction(self, node: Node) -> None:
        """ReduceSum and ReduceMean, with the arithmetic before them in the same loops."""
        value = self._value(node.inputs[0])
        rank = len(value.shape)
        axes = {axis % rank for axis in self._numbers(node, 1, tuple(range(rank)))}
        made = self._variable(node.outputs[0], self.shapes[node.outputs[0]])
        loop = Loop(value.shape, self.in_memory, reduced=axes)
        divisor = math.prod(value.shape[axis] for axis in axes) if node.op == "ReduceMean" else 1
        loop.sum(value, made, divisor)
        if isinstance(value, Computed):
            for inner in loop.needed_elsewhere(value, with_it=True):
                loop.store(inner, self._target(inner))
        self._add(loop.lines(), loop.reads, loop.writes, loop.in_step())
        self.in_memory.update(loop.stored)

    def softmax(self, node: Node) -> None:
        given = self._contiguous(node.inputs[0])
        self._require_last(node, given.shape)
        made = self._variable(node.outputs[0], given.shape)
        self._by_rows(given, made, "softmax({x}, {y}, {n});", in_step=True)

    def layer_norm(self, node: Node) -> None:
        given = self._contiguous(node.inputs[0])
        self._require_last(node, given.shape)
        gain, bias = (self._table(name) for name in node.inputs[1:3])
        epsilon = literal(float(str(node.attributes.get("epsilon", 1e-5))))
        made = self._variable(node.outputs[0], given.shape)
        call = f"layer_norm({{x}}, {gain.start}, {bias.start}, {epsilon}, {{y}}, {{n}});"
        self._by_rows(given, made, call, in_step=False)

    def _by_rows(self, given: Buffer, made: Buffer, call: str, in_step: bool) -> None:
        n = given.shape[-1]
        rows = size_of(given.shape) // n
        x, y = given.start, made.start
        if rows > 1:
            x, y = f"{x} + i * {n}", f"{y} + i * {n}"
        line = call.format(x=x, y=y, n=n)
        head = f"for (int i = 0; i < {rows}; ++i) {{"
        lines = [line] if rows == 1 else [head, f"    {line}", "}"]
        pairs = [(given.store, made.store)] if in_step and given.offset == made.offset else []
        self._add(lines, reads=(given.store,), writes=(made.store,), in_step=pairs)

    def _require_last(self, node: Node, shape: Shape) -> None:
        axis = node.attributes.get("axis", -1)
        if not isinstance(axis, int) or axis % len(shape) != len(shape) - 1:
            raise NotInC(f"has a {node.op} over another axis than the last")

    def concatenation(self, node: Node) -> None:
        """Side by side; a ring's context is only remembered."""
        name = node.outputs[0]
        if name in self.rings:
            self.rings[name].set_newest(self._contiguous(node.inputs[1]))
            return
        shape = self.shapes[name]
        axis = int(node.attributes["axis"]) % len(shape)  # type: ignore[arg-type]
        made = self._variable(name, shape)
        offset = 0
        for part in node.inputs:
            buffer = self._buffer(part)
            place = Buffer(made.store, buffer.shape, made.strides, offset)
            loop = Loop(buffer.shape, self.in_memory)
            loop.copy_to(buffer, place)
            self._add(loop.lines(), loop.reads, loop.writes)
            offset += made.strides[axis] * buffer.shape[axis]

    # ---- views

    def reshape(self, node: Node) -> None:
        """Also Squeeze and Unsqueeze: the same elements in the same order."""
        given = self._contiguous(node.inputs[0])
        shape = self.shapes[node.outputs[0]]
        made = whole(given.store, shape)
        self.values[node.outputs[0]] = Buffer(given.store, shape, made.strides, given.offset)

    def transpose(self, node: Node) -> None:
        given = self._buffer(node.inputs[0])
        order = _tuple(node, "perm") or tuple(range(len(given.shape)))[::-1]
        shape = tuple(given.shape[axis] for axis in order)
        strides = tuple(given.strides[axis] for axis in order)
        self.values[node.outputs[0]] = Buffer(given.store, shape, strides, given.offset)

    def split(self, node: Node) -> None:
        given = self._buffer(node.inputs[0])
        axis = int(node.attributes.get("axis", 0)) % len(given.shape)  # type: ignore[arg-type]
        offset = given.offset
        for name in node.outputs:
            shape = self.shapes[name]
            self.values[name] = Buffer(given.store, shape, given.strides, offset)
            offset += given.strides[axis] * shape[axis]

    def slice(self, node: Node) -> None:
        axis, first, step, count = self._cut(node)
        ring = self.rings.get(node.inputs[0])
        if ring is not None and axis == len(ring.shape) - 1:
            name = node.outputs[0]
            self.values[name] = self._gathered(ring, name, first, step, count)
            return
        given = self._buffer(node.inputs[0])
        strides = tuple(s * step if i == axis else s for i, s in enumerate(given.strides))
        offset = given.offset + first * given.strides[axis]
        shape = self.shapes[node.outputs[0]]
        self.values[node.outputs[0]] = Buffer(given.store, shape, strides, offset)

    def _cut(self, node: Node) -> tuple[int, int, int, int]:
        """Axis, first place, step and how many, of a Slice along one axis."""
        shape = self.shapes[node.inputs[0]]
        starts = self._numbers(node, 1, ())
        axes = self._numbers(node, 3, tuple(range(len(starts))))
        steps = self._numbers(node, 4, (1,) * len(starts))
        if len(starts) != 1:
            raise NotInC("cuts along several axes at once, which no architecture does")
        axis, start = axes[0] % len(shape), starts[0]
        first = min(max(start + shape[axis] if start < 0 else start, 0), shape[axis])
        return axis, first, steps[0], self.shapes[node.outputs[0]][axis]

    def gather(self, node: Node) -> None:
        """One place along an axis."""
        given = self._buffer(node.inputs[0])
        index = self.graph.constants.get(node.inputs[1])
        if index is None or index.shape != () or index.element == FLOAT32:
            raise NotInC("picks several places at once, which no architecture does")
        axis = int(node.attributes.get("axis", 0)) % len(given.shape)  # type: ignore[arg-type]
        place = int(np.frombuffer(index.data, "<i8")[0]) % given.shape[axis]
        shape, strides = (
            tuple(n for i, n in enumerate(of) if i != axis) for of in (given.shape, given.strides)
        )
        offset = given.offset + place * given.strides[axis]
        self.values[node.outputs[0]] = Buffer(given.store, shape, strides, offset)


class _Ring:
    """A queue of frames (length, channels) in the state, and the newest frame beside it."""

    def __init__(self, store: Store, at: str, channels: int, length: int, shape: Shape) -> None:
        self.store, self.at, self.channels, self.length = store, at, channels, length
        self.shape = shape  # of the context, the newest frame last
        self.left = 0  # nodes that still look at it
        self.gathered: dict[tuple[int, int, int], Buffer] = {}
        self._newest: Buffer | None = None

    @property
    def newest(self) -> Buffer:
        """The frame that this step adds."""
        if self._newest is None:
            raise NotInC("looks at a queue before the step has a frame for it")
        return self._newest

    def set_newest(self, frame: Buffer) -> None:
        """Say which frame this step adds."""
        self._newest = frame


def _count(form: str) -> int:
    """How many operands a form takes."""
    return 1 if "{0}" in form else form.count("{}")


def _telling(name: str, op: str) -> str:
    """A tensor's name, or the operator's for one that the exporter has numbered."""
    return op.lower() if name.startswith("val_") else name


def _tuple(node: Node, name: str) -> tuple[int, ...]:
    value = node.attributes.get(name, ())
    return value if isinstance(value, tuple) else ()


_Rule = Callable[[_Lowering, Node], None]
_RULES: dict[str, _Rule] = {
    **dict.fromkeys((*_FORMS, "Pow"), _Lowering.elementwise),
    **dict.fromkeys(("ReduceMean", "ReduceSum"), _Lowering.reduction),
    **dict.fromkeys(("Reshape", "Squeeze", "Unsqueeze"), _Lowering.reshape),
    "Concat": _Lowering.concatenation,
    "Conv": _Lowering.convolution,
    "Gather": _Lowering.gather,
    "Gemm": _Lowering.dense,
    "LayerNormalization": _Lowering.layer_norm,
    "MatMul": _Lowering.product,
    "Slice": _Lowering.slice,
    "Softmax": _Lowering.softmax,
    "Split": _Lowering.split,
    "Transpose": _Lowering.transpose,
}
