"""A package's graph as statements of C: one function for every kind of operator.

`writer.py` holds what has been written so far, `memory.py` what lasts from step to step. The
operators are in `views.py`, `arithmetic.py` and `matrices.py`.
"""

import functools
from collections.abc import Callable

from export.c import arithmetic, memory, views
from export.c.matrices import Matrices
from export.c.memory import Ring
from export.c.program import Program, settled, with_rooms
from export.c.values import FORMS, Computed, Store, whole
from export.c.weights import Kind
from export.c.writer import StepWriter
from wakedeploy.core.manifest import Manifest
from wakedeploy.core.onnx_graph import Graph, Node

Rule = Callable[[StepWriter, Node], None]
_RULES: dict[str, Rule] = {
    **dict.fromkeys((*FORMS, "Pow"), arithmetic.elementwise),
    **dict.fromkeys(("ReduceMean", "ReduceSum"), arithmetic.reduction),
    **dict.fromkeys(("Reshape", "Squeeze", "Unsqueeze"), views.reshape),
    "Concat": views.concatenation,
    "Gather": views.gather,
    "LayerNormalization": arithmetic.layer_norm,
    "MatMul": arithmetic.product,
    "Slice": views.slice,
    "Softmax": arithmetic.softmax,
    "Split": views.split,
    "Transpose": views.transpose,
}


def lowered(graph: Graph, manifest: Manifest, kind: Kind) -> Program:
    """The step of a package as C; NotInC for what none of the eight architectures has."""
    writer = StepWriter(graph, manifest, kind)
    matrices = Matrices(writer)
    rules: dict[str, Callable[[Node], None]] = {
        op: functools.partial(rule, writer) for op, rule in _RULES.items()
    }
    rules |= {"Gemm": matrices.dense, "Conv": matrices.convolution}
    rings = _take_inputs(writer)
    for node in graph.nodes:
        if id(node) not in writer.done and not _of_a_ring(writer, node, rings):
            rules[node.op](node)
        _retire(writer, node, rings)
    _give_outputs(writer)
    statements, named = settled(writer.statements, writer.states)
    rooms, places = with_rooms(statements, named)
    return Program(
        tuple(statements),
        tuple(writer.members),
        matrices.all,
        writer.tables,
        rooms,
        named | places,
    )


def _take_inputs(writer: StepWriter) -> dict[str, Ring]:
    """Where a step finds what goes in; the rings among the states, by their context."""
    writer.targets["force"] = Store("force", len(writer.manifest.force), is_variable=False)
    observation = Store("observation", len(writer.manifest.observation), is_variable=False)
    frame = whole(observation, (1, observation.size))
    if writer.manifest.memory.kind == "window":
        memory.take_window(writer, frame)
    else:
        writer.values["observation"] = frame
    rings: dict[str, Ring] = {}
    for name, state in writer.manifest.memory.states.items():
        if (found := memory.take_ring(writer, name)) is not None:
            rings[found[0]] = found[1]
        else:
            memory.take_state(writer, name, state.initial_array(1)[0])
    return rings


def _of_a_ring(writer: StepWriter, node: Node, rings: dict[str, Ring]) -> bool:
    """Whether a node only adds a ring's newest frame, or takes frames out of it."""
    if node.outputs[0] in rings:
        rings[node.outputs[0]].frame = writer.contiguous(node.inputs[1])
        return True
    ring = rings.get(node.inputs[0]) if node.op == "Slice" else None
    if ring is None:
        return False
    axis, first, step, count = views.cut_of(writer, node)
    if axis != len(ring.shape) - 1:
        return False
    writer.values[node.outputs[0]] = memory.taps(writer, ring, first, step, count)
    return True


def _retire(writer: StepWriter, node: Node, rings: dict[str, Ring]) -> None:
    """Put the newest frame into its ring once nothing looks at the oldest any more."""
    if id(node) in writer.done:
        return
    for name in node.inputs:
        if name in rings:
            rings[name].pending_nodes -= 1
            if rings[name].pending_nodes == 0:
                memory.push(writer, rings[name])


def _give_outputs(writer: StepWriter) -> None:
    """Every output in its place."""
    for tensor in writer.graph.outputs:
        target = writer.targets.get(tensor.name)
        if target is None:
            continue
        value = writer.value(tensor.name)
        if isinstance(value, Computed):
            writer.computed(value)
        elif value.store is not target:
            writer.copy(value, target)
