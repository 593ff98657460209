"""What a step keeps: states, the window, and rings.

A state to which each step adds a frame and from which it drops the oldest is a ring, and so is the
window: a frame is written once and never moved.
"""

from dataclasses import dataclass, field

import numpy as np

from export.c.program import StateMember
from export.c.values import FORMS, Buffer, Computed, Index, Store, Value, token, whole
from export.c.views import cut_of
from export.c.writer import NotInC, StepWriter
from wakedeploy.core.manifest import FloatArray
from wakedeploy.core.onnx_graph import Node, Shape, size_of

_CHANNELWISE = ("Sub", "Div", "Add", "Mul")  # what may be done to a frame before it is kept


@dataclass(eq=False)
class Ring:
    """A queue of frames (length, channels) in the state, and the newest frame beside it."""

    store: Store
    at: str  # the member that says where its oldest frame lies
    channels: int
    length: int
    shape: Shape  # of the context, the newest frame last
    pending_nodes: int  # nodes that still look at it
    taps: dict[tuple[int, int, int], Buffer] = field(default_factory=dict)
    frame: Buffer | None = None

    @property
    def newest(self) -> Buffer:
        """The frame that this step adds."""
        if self.frame is None:
            raise NotInC("looks at a queue before the step has a frame for it")
        return self.frame


def take_state(writer: StepWriter, name: str, initial: FloatArray) -> None:
    """A state that is one tensor, with its initial values."""
    member = writer.names.new(name)
    writer.members.append(StateMember(member, initial.size, initial.ravel(), name))
    store = Store(f"state->{member}", initial.size, is_variable=False)
    writer.values[f"state_{name}"] = whole(store, (1, *initial.shape))
    following = Store(writer.names.new(f"next_{member}"), initial.size)
    writer.states[following] = store
    writer.targets[f"next_state_{name}"] = following


def take_ring(writer: StepWriter, name: str) -> tuple[str, Ring] | None:
    """The context and the ring of a state that is a queue of frames along its last axis."""
    taken = [n for n in writer.graph.nodes if f"state_{name}" in n.inputs]
    maker = writer.makers.get(f"next_state_{name}")
    state = writer.manifest.memory.states[name]
    if len(taken) != 1 or taken[0].op != "Concat" or maker is None or maker.op != "Slice":
        return None
    context, length = taken[0], state.shape[-1]
    shape = writer.shapes[context.outputs[0]]
    is_queue = (
        context.inputs[0] == f"state_{name}"
        and len(context.inputs) == 2
        and shape == (1, *state.shape[:-1], length + 1)
        and maker.inputs[0] == context.outputs[0]
        and cut_of(writer, maker) == (len(shape) - 1, 1, 1, length)
        and isinstance(state.initial, float)
    )
    if not is_queue:
        return None
    channels = size_of(state.shape[:-1])
    member = writer.names.new(name)
    initial = state.initial_array(1)[0].reshape(channels, length).T.ravel()
    writer.members.append(
        StateMember(member, initial.size, initial, f"{name}: the last {length} frames, a ring")
    )
    at = writer.names.new(f"{member}_at")
    writer.members.append(StateMember(at, what="where its oldest frame lies"))
    store = Store(f"state->{member}", initial.size, is_variable=False)
    users = writer.uses[context.outputs[0]] - 1
    ring = Ring(store, f"state->{at}", channels, length, shape, users)
    writer.gathered[context.outputs[0]] = lambda: taps(writer, ring, 0, 1, length + 1)
    writer.done.add(id(maker))
    return context.outputs[0], ring


def taps(writer: StepWriter, ring: Ring, first: int, step: int, count: int) -> Buffer:
    """Frames of a ring with the newest behind them, channel by channel (…, count)."""
    key = (first, step, count)
    if key in ring.taps:
        return ring.taps[key]
    c, new = ring.channels, ring.newest
    store = Store(writer.names.new("taps"), c * count)
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
    writer.add(lines, reads=(ring.store, new.store), writes=(store,))
    made = whole(store, (*ring.shape[:-1], count))
    ring.taps[key] = made
    return made


def push(writer: StepWriter, ring: Ring) -> None:
    """Put the newest frame into its ring."""
    c, new = ring.channels, ring.newest
    lines = [
        f"for (int i = 0; i < {c}; ++i) {{",
        f"    {ring.store.name}[{ring.at} * {c} + i] = {new.start}[i];",
        "}",
        f"{ring.at} = {ring.at} + 1 < {ring.length} ? {ring.at} + 1 : 0;",
    ]
    writer.add(lines, reads=(new.store,), writes=(ring.store,))


def take_window(writer: StepWriter, frame: Buffer) -> None:
    """Keep each observation, normalised once, in a ring; lay the window out of it."""
    memory, d = writer.manifest.memory, frame.store.size
    name = "window"
    kept: Value = frame
    while (node := _only_use(writer, name)) is not None and node.op in _CHANNELWISE:
        constant = writer.graph.constants.get(node.inputs[1])
        if node.inputs[0] != name or constant is None or size_of(constant.shape) not in (1, d):
            break
        operands = (kept, writer.constant(node.inputs[1]))
        kept = Computed(writer.names.new(node.outputs[0]), FORMS[node.op], operands, (1, d))
        writer.done.add(id(node))
        name = node.outputs[0]
    present = writer.computed(kept) if isinstance(kept, Computed) else frame
    size = memory.span * d
    member, at = writer.names.new("window"), writer.names.new("window_at")
    writer.members.append(
        StateMember(member, size, np.zeros(size, np.float32), f"{memory.span} frames, a ring")
    )
    writer.members.append(StateMember(at, what="where the next frame goes"))
    begun = writer.names.new("seen")
    writer.members.append(StateMember(begun, what="0 before the first observation"))
    store = Store(f"state->{member}", size, is_variable=False)
    window = Store(writer.names.new("snapshots"), memory.k * d)
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
    writer.add(lines, reads=(present.store, store), writes=(store, window))
    writer.values[name] = whole(window, (1, memory.k, d))


def _only_use(writer: StepWriter, name: str) -> Node | None:
    taken = [node for node in writer.graph.nodes if name in node.inputs]
    return taken[0] if len(taken) == 1 and writer.uses[name] == 1 else None
