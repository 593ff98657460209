"""A package's graph in NumPy's float64: what C is held against where weights are rounded.

One function per operator, straight from its definition in onnx.proto3's documentation; it shares
nothing with the C that is written. Slow and exact.
"""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from wakedeploy.core.manifest import FloatArray, Manifest
from wakedeploy.core.onnx_graph import FLOAT32, Graph, Node

Wide = npt.NDArray[np.float64]


class Interpreter:
    """Steps one series; `weights` replaces constants by name, of the shape that they have."""

    def __init__(
        self, graph: Graph, manifest: Manifest, weights: Mapping[str, Wide] | None = None
    ) -> None:
        self._graph, self._manifest = graph, manifest
        self._constants = {
            name: np.frombuffer(c.data, "<f4" if c.element == FLOAT32 else "<i8").reshape(c.shape)
            for name, c in graph.constants.items()
        }
        self._constants |= weights or {}
        self._constants = {
            name: value.astype(np.float64) if value.dtype.kind == "f" else value
            for name, value in self._constants.items()
        }
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        memory = self._manifest.memory
        self._states = {
            f"state_{name}": state.initial_array(1).astype(np.float64)
            for name, state in memory.states.items()
        }
        self._past: list[Wide] = []

    def multiplied_by(self, tensor: str, observations: FloatArray) -> Wide:
        """What a constant multiplies (T, n), over observations (T, d) from a cold start."""
        taken = next(n.inputs[0] for n in self._graph.nodes if tensor in n.inputs)
        self.reset()
        return np.stack([self._values(observation)[taken].ravel() for observation in observations])

    def step(self, observation: npt.ArrayLike) -> Wide:
        """The force (o,) for an observation (d,)."""
        force: Wide = self._values(observation)["force"][0]
        return force

    def _values(self, observation: npt.ArrayLike) -> dict[str, Wide]:
        """Every tensor of one step, by name."""
        values = dict(self._constants) | self._states | self._source(observation)
        for node in self._graph.nodes:
            given = [values[name] for name in node.inputs]
            made = _RULES[node.op](node, given)
            values |= zip(node.outputs, made if isinstance(made, list) else [made], strict=True)
        self._states = {name: values[f"next_{name}"] for name in self._states}
        return values

    def rollout(self, observations: FloatArray) -> Wide:
        """Forces (T, o) over observations (T, d) from a cold start."""
        self.reset()
        return np.stack([self.step(observation) for observation in observations])

    def _source(self, observation: npt.ArrayLike) -> dict[str, Wide]:
        newest = np.asarray(observation, np.float64)
        memory = self._manifest.memory
        if memory.kind != "window":
            return {"observation": newest[None]}
        self._past = (self._past or [newest] * memory.span)[-memory.span :]
        self._past = [*self._past[1:], newest]
        return {"window": np.stack(self._past[:: memory.stride])[None]}


def _gemm(node: Node, given: list[Wide]) -> Wide:
    first, other = given[:2]
    first = first.T if node.attributes.get("transA", 0) else first
    other = other.T if node.attributes.get("transB", 0) else other
    made: Wide = _number(node, "alpha", 1.0) * (first @ other)
    return made + _number(node, "beta", 1.0) * given[2] if len(given) > 2 else made


def _convolution(node: Node, given: list[Wide]) -> Wide:
    """A convolution over as many places as the kernel is long."""
    made: Wide = np.einsum("bcl,ocl->bo", given[0], given[1])[..., None]
    return made + given[2][:, None] if len(given) > 2 else made


def _slice(node: Node, given: list[Wide]) -> Wide:
    data, starts, ends = given[0], given[1], given[2]
    axes = given[3] if len(given) > 3 else np.arange(len(starts))
    steps = given[4] if len(given) > 4 else np.ones(len(starts), int)
    cuts = [slice(None)] * data.ndim
    for start, end, axis, step in zip(starts, ends, axes, steps, strict=True):
        cuts[int(axis)] = slice(int(start), int(end), int(step))
    return np.asarray(data[tuple(cuts)])


def _split(node: Node, given: list[Wide]) -> list[Wide]:
    axis = int(_number(node, "axis", 0))
    if len(given) > 1:
        return np.split(given[0], np.cumsum(given[1])[:-1].astype(int), axis)
    return np.array_split(given[0], len(node.outputs), axis)


def _reduced(node: Node, given: list[Wide], how: Callable[..., Wide]) -> Wide:
    axes = tuple(int(axis) for axis in given[1])
    return how(given[0], axis=axes, keepdims=bool(_number(node, "keepdims", 1)))


def _softmax(node: Node, given: list[Wide]) -> Wide:
    axis = int(_number(node, "axis", -1))
    raised: Wide = np.exp(given[0] - given[0].max(axis=axis, keepdims=True))
    return np.asarray(raised / raised.sum(axis=axis, keepdims=True))


def _layer_norm(node: Node, given: list[Wide]) -> Wide:
    x, gain, *bias = given
    mean, variance = x.mean(-1, keepdims=True), x.var(-1, keepdims=True)
    made: Wide = (x - mean) / np.sqrt(variance + _number(node, "epsilon", 1e-5)) * gain
    return made + bias[0] if bias else made


def _number(node: Node, name: str, default: float) -> float:
    value = node.attributes.get(name, default)
    return float(value) if isinstance(value, int | float) else default


def _whole(node: Node, name: str) -> int:
    return int(_number(node, name, 0))


_RULES: dict[str, Callable[[Node, list[Wide]], Wide | list[Wide]]] = {
    "Add": lambda node, x: x[0] + x[1],
    "Concat": lambda node, x: np.concatenate(x, _whole(node, "axis")),
    "Conv": _convolution,
    "Div": lambda node, x: x[0] / x[1],
    "Exp": lambda node, x: np.exp(x[0]),
    "Gather": lambda node, x: np.take(x[0], x[1].astype(int), _whole(node, "axis")),
    "Gemm": _gemm,
    "Greater": lambda node, x: np.asarray(x[0] > x[1], np.float64),
    "LayerNormalization": _layer_norm,
    "MatMul": lambda node, x: x[0] @ x[1],
    "Mul": lambda node, x: x[0] * x[1],
    "Pow": lambda node, x: x[0] ** x[1],
    "Reciprocal": lambda node, x: 1.0 / x[0],
    "ReduceMean": lambda node, x: _reduced(node, x, np.mean),
    "ReduceSum": lambda node, x: _reduced(node, x, np.sum),
    "Relu": lambda node, x: np.where(x[0] < 0.0, 0.0, x[0]),
    "Reshape": lambda node, x: x[0].reshape(x[1].astype(int)),
    "Sigmoid": lambda node, x: 1.0 / (1.0 + np.exp(-x[0])),
    "Slice": _slice,
    "Softmax": _softmax,
    "Softplus": lambda node, x: np.logaddexp(0.0, x[0]),
    "Split": _split,
    "Sqrt": lambda node, x: np.sqrt(x[0]),
    "Squeeze": lambda node, x: np.squeeze(x[0], tuple(x[1].astype(int))),
    "Sub": lambda node, x: x[0] - x[1],
    "Tanh": lambda node, x: np.tanh(x[0]),
    "Transpose": lambda node, x: np.transpose(x[0], node.attributes.get("perm")),  # type: ignore[arg-type]
    "Unsqueeze": lambda node, x: np.expand_dims(x[0], tuple(x[1].astype(int))),
    "Where": lambda node, x: np.where(x[0] != 0.0, x[1], x[2]),
}
