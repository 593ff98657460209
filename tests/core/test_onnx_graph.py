"""A graph is read as the onnx package reads it, or not at all; shapes follow as it infers them."""

import contextlib
import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from made_packages import parsed, tiny_model

from runtime.predictor import inference_session
from wakedeploy.core import onnx_wire
from wakedeploy.core.onnx_graph import FLOAT32, ForbiddenGraph, Tensor, read_graph
from wakedeploy.core.onnx_shapes import cost_of

onnx = pytest.importorskip("onnx")

REFUSED = (onnx_wire.MalformedModel, ForbiddenGraph)


@functools.cache
def whole() -> bytes:
    return onnx_wire.with_metadata(tiny_model("window"), {"key": "value"})


def test_inputs_and_outputs_are_told_with_names_element_types_and_axes():
    graph = read_graph(whole())
    assert graph.inputs == (Tensor("window", FLOAT32, ("B", 3, 2)),)
    assert graph.outputs == (Tensor("force", FLOAT32, ("B", 2)),)


def test_nodes_and_constants_are_read_as_the_onnx_package_reads_them():
    text = (
        "t (float[B, 4] x) => (float[B, 2] y) { a, b = Split <axis: int = -1, num_outputs: int = 2>"
        " (x) y = Gemm <alpha: float = 0.5, transB: int = 1> (a, w) }"
    )
    weights = np.arange(4, dtype=np.float32).reshape(2, 2)
    model = parsed(text, {"w": weights, "n": np.array([-1, 2**62])})
    graph = read_graph(model.SerializeToString())
    for node, told in zip(graph.nodes, model.graph.node, strict=True):
        assert (node.op, node.inputs) == (told.op_type, tuple(told.input))
        assert node.outputs == tuple(told.output)
        attributes = {a.name: onnx.helper.get_attribute_value(a) for a in told.attribute}
        assert node.attributes == attributes
    assert np.array_equal(np.frombuffer(graph.constants["w"].data, "<f4").reshape(2, 2), weights)
    assert graph.constants["n"].shape == (2,)
    assert np.frombuffer(graph.constants["n"].data, "<i8").tolist() == [-1, 2**62]


def test_numbers_that_stand_packed_are_read_the_same():
    """Proto3 packs repeated numbers, proto2 does not, and writers of ONNX are of both kinds."""
    weights = onnx.numpy_helper.from_array(np.ones((2, 3), np.float32), "w").SerializeToString()
    apart, packed = b"\x08\x02\x08\x03", b"\x0a\x02\x02\x03"
    assert weights.startswith(apart)
    data = packed + weights[len(apart) :]
    model = b"\x42\x02\x10\x14" + _message(7, _message(5, data))
    assert read_graph(model).constants["w"].shape == (2, 3)
    assert onnx.load_from_string(model).graph.initializer[0].dims == [2, 3]


def _message(number: int, data: bytes) -> bytes:
    assert len(data) < 128
    return bytes([number << 3 | 2, len(data)]) + data


@given(cut=st.integers(0, len(whole()) - 1))
def test_a_model_cut_anywhere_has_no_metadata_and_graph_both(cut):
    part = whole()[:cut]
    with contextlib.suppress(*REFUSED):
        assert not (read_graph(part) and onnx_wire.metadata(part))


@given(data=st.binary(max_size=80), at=st.integers(0, len(whole()) - 1))
def test_damaged_models_raise_nothing_else(data, at):
    damaged = whole()[:at] + data + whole()[at + len(data) :]
    with contextlib.suppress(*REFUSED):
        onnx_wire.metadata(damaged)
        cost_of(read_graph(damaged), 2)


def ints(*numbers: int) -> np.ndarray:
    return np.array(numbers, np.int64)


def ones(*shape: int) -> np.ndarray:
    return np.ones(shape, np.float32)


LENGTH = st.integers(1, 4)
SHAPE = st.lists(LENGTH, min_size=1, max_size=4).map(tuple)
PAIR = hnp.mutually_broadcastable_shapes(num_shapes=2, max_dims=4, max_side=4)
Drawn = tuple[str, dict[str, np.ndarray], tuple[int, ...]]  # a node, its constants, x's shape


def broadcast(draw) -> Drawn:
    shape, other = draw(PAIR).input_shapes
    return f"y = {draw(st.sampled_from(['Add', 'Pow']))} (x, w)", {"w": ones(*other)}, shape


def where(draw) -> Drawn:
    shape, other = draw(PAIR).input_shapes
    return "more = Greater (w, x) y = Where (more, w, x)", {"w": ones(*other)}, shape


def alike(draw) -> Drawn:
    op = draw(st.sampled_from(["Exp", "Tanh", "Softplus", "Softmax", "Reciprocal"]))
    return f"y = {op} (x)", {}, draw(SHAPE)


def norm(draw) -> Drawn:
    shape = draw(SHAPE)
    return "y = LayerNormalization (x, w, w)", {"w": ones(shape[-1])}, shape


def matmul(draw) -> Drawn:
    (one, other), (m, k, n) = draw(PAIR).input_shapes, draw(st.tuples(LENGTH, LENGTH, LENGTH))
    return "y = MatMul (x, w)", {"w": ones(*other[-2:], k, n)}, (*one[-2:], m, k)


def gemm(draw) -> Drawn:
    (m, k, n), (a, b) = draw(st.tuples(*[LENGTH] * 3)), draw(st.tuples(*[st.integers(0, 1)] * 2))
    text = f"y = Gemm <transA: int = {a}, transB: int = {b}> (x, w, c)"
    weights = {"w": ones(*((n, k) if b else (k, n))), "c": ones(n)}
    return text, weights, (k, m) if a else (m, k)


def axis_of(draw, shape) -> int:
    return draw(st.integers(-len(shape), len(shape) - 1))


def concat(draw) -> Drawn:
    shape = draw(SHAPE)
    axis = axis_of(draw, shape)
    other = list(shape)
    other[axis] = draw(LENGTH)
    return f"y = Concat <axis: int = {axis}> (x, w, x)", {"w": ones(*other)}, shape


def gather(draw) -> Drawn:
    shape, places = draw(SHAPE), np.zeros(draw(st.just(()) | SHAPE.map(lambda s: s[:2])), np.int64)
    return f"y = Gather <axis: int = {axis_of(draw, shape)}> (x, i)", {"i": places}, shape


def some_axes(draw, shape) -> list[int]:
    axes = draw(st.lists(st.integers(0, len(shape) - 1), min_size=1, unique=True))
    return [axis - len(shape) if draw(st.booleans()) else axis for axis in axes]


def reduced(draw) -> Drawn:
    shape, keep = draw(SHAPE), draw(st.integers(0, 1))
    op = draw(st.sampled_from(["ReduceSum", "ReduceMean"]))
    return f"y = {op} <keepdims: int = {keep}> (x, n)", {"n": ints(*some_axes(draw, shape))}, shape


def reshaped(draw) -> Drawn:
    shape = draw(SHAPE)
    asked = list(draw(st.permutations(shape))) + [1] * draw(st.integers(0, 2))
    if draw(st.booleans()):
        asked[draw(st.integers(0, len(asked) - 1))] = -1
    return "y = Reshape (x, n)", {"n": ints(*asked)}, shape


def squeezed(draw) -> Drawn:
    shape = (*draw(SHAPE)[:3], 1)
    last = draw(st.sampled_from([-1, len(shape) - 1]))
    return "y = Squeeze (x, n)", {"n": ints(last)}, shape


def unsqueezed(draw) -> Drawn:
    shape = draw(SHAPE)
    more = draw(st.permutations(range(len(shape) + 2)))[:2]
    return "y = Unsqueeze (x, n)", {"n": ints(more[0], more[1] - len(shape) - 2)}, shape


def cut(draw) -> Drawn:
    shape = draw(SHAPE)
    axes = some_axes(draw, shape)
    place = st.sampled_from([-(2**63), -9, -2, -1, 0, 1, 2, 9, 2**63 - 1])
    a, b = ([draw(place) for _ in axes] for _ in range(2))
    s = [draw(LENGTH) for _ in axes]
    return "y = Slice (x, a, b, n, s)", {
        "a": ints(*a), "b": ints(*b), "n": ints(*axes), "s": ints(*s)
    }, shape  # fmt: skip


def split(draw) -> Drawn:
    shape = draw(SHAPE)
    axis = axis_of(draw, shape)
    if draw(st.booleans()):
        return f"y, z = Split <axis: int = {axis}, num_outputs: int = 2> (x)", {}, shape
    parts = ints(draw(LENGTH), draw(LENGTH))
    longer = list(shape)
    longer[axis] = int(parts.sum())
    return f"y, z = Split <axis: int = {axis}> (x, n)", {"n": parts}, tuple(longer)


def transposed(draw) -> Drawn:
    shape = draw(SHAPE)
    order = draw(st.permutations(range(len(shape))))
    return f"y = Transpose <perm: ints = {list(order)}> (x)", {}, shape


def convolved(draw) -> Drawn:
    b, g, c, m, taps, stride, far, left, right = draw(st.tuples(*[LENGTH] * 9))
    length = draw(st.integers(far * (taps - 1) + 1, 20))
    text = (
        f"y = Conv <group: int = {g}, strides: ints = [{stride}], dilations: ints = [{far}],"
        f" pads: ints = [{left - 1}, {right - 1}]> (x, k)"
    )
    return text, {"k": ones(g * m, c, taps)}, (b, g * c, length)


CASES = [broadcast, where, alike, norm, matmul, gemm, concat, gather, reduced, reshaped, squeezed,
         unsqueezed, cut, split, transposed, convolved]  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_shape_that_is_told_is_the_one_that_onnxruntime_gives(case):
    @settings(max_examples=25)
    @given(data=st.data())
    def agree(data):
        text, constants, shape = case(data.draw)
        names = ["y", "z"] if "y, z =" in text else ["y"]
        dims, outputs = ", ".join(map(str, shape)), ", ".join(f"float {name}" for name in names)
        model = parsed(f"t (float[{dims}] x) => ({outputs}) {{ {text} }}", constants)
        model_bytes = model.SerializeToString()
        arrays = inference_session(model_bytes).run(None, {"x": np.ones(shape, np.float32)})
        if min(array.size for array in arrays) == 0:
            with pytest.raises(ForbiddenGraph, match="empty"):
                cost_of(read_graph(model_bytes), 1)
            return
        shapes, _ = cost_of(read_graph(model_bytes), 1)
        assert [shapes[name] for name in names] == [array.shape for array in arrays]

    agree()
