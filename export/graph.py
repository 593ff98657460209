"""A predictor's single step as a lean ONNX graph: SI in, SI out, batch axis free."""

import contextlib
import io
import logging
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import onnx
import torch
from torch import Tensor, nn

from export.limits import Limits
from trainers.model import Predictor
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.manifest import ForceChannel
from wakedeploy.core.onnx_graph import OPSET, ForbiddenGraph, read_graph
from wakedeploy.core.onnx_shapes import cost_of

_TRACED_BATCH = 2  # any number above 1: torch takes an axis of length 1 for a constant


class _Stateless(nn.Module):
    """none and window: one tensor in, the force out."""

    def __init__(self, predictor: Predictor, limits: Limits) -> None:
        super().__init__()
        self.predictor, self.limits = predictor, limits

    def forward(self, source: Tensor) -> Any:
        return self.limits(self.predictor.step(source))


class _Stateful(nn.Module):
    """state: the observation and every state in, the force and every next state out."""

    def __init__(self, predictor: Predictor, limits: Limits) -> None:
        super().__init__()
        self.predictor, self.limits = predictor, limits
        self.names = list(predictor.memory.states)

    def forward(self, source: Tensor, *states: Tensor) -> tuple[Tensor, ...]:
        held = dict(zip(self.names, states, strict=True))
        force, following = self.predictor.step(source, held)
        return self.limits(force), *(following[name] for name in self.names)


def graph_bytes(predictor: Predictor, force: Sequence[ForceChannel]) -> bytes:
    """The ONNX model of one step, opset 20, weights inside, nothing of this machine in it.

    Its force stays within what is possible by the channels. Inputs and outputs are those that
    `wakedeploy.core.manifest.Manifest` derives from the memory.
    """
    kept = predictor.training
    try:
        model = _exported(predictor.eval(), Limits(force).eval())
    finally:
        predictor.train(kept)
    _strip(model)
    onnx.checker.check_model(model, full_check=True)
    graph = bytes(model.SerializeToString())
    _require_plain(graph)
    return graph


def _exported(predictor: Predictor, limits: Limits) -> onnx.ModelProto:
    memory, d = predictor.memory, len(predictor.observation_mean)
    batch = torch.export.Dim("batch", min=1)
    states = [torch.zeros(_TRACED_BATCH, *shape) for shape in memory.states.values()]
    shape = (_TRACED_BATCH, memory.k, d) if memory.kind == "window" else (_TRACED_BATCH, d)
    dynamic: dict[str, Any] = {"source": {0: batch}}
    if memory.kind == "state":
        dynamic["states"] = tuple({0: batch} for _ in states)
    source = "window" if memory.kind == "window" else "observation"
    with _quiet():
        program = torch.onnx.export(
            (_Stateful if memory.kind == "state" else _Stateless)(predictor, limits),
            (torch.zeros(shape), *states),
            dynamo=True,
            opset_version=OPSET,
            external_data=False,
            verbose=False,
            input_names=[source, *(f"state_{name}" for name in memory.states)],
            output_names=["force", *(f"next_state_{name}" for name in memory.states)],
            dynamic_shapes=dynamic,
        )
    if program is None:
        raise RuntimeError("torch.onnx.export gave no program")
    return program.model_proto


def _strip(model: onnx.ModelProto) -> None:
    """Remove what the exporter says about source files, and what names its own version."""
    model.doc_string = model.graph.doc_string = ""
    del model.metadata_props[:]
    del model.graph.metadata_props[:]
    del model.graph.value_info[:]  # whoever runs it knows them from the operators
    for part in (*model.graph.node, *model.graph.initializer):
        part.doc_string = ""
        del part.metadata_props[:]
    for tensor in (*model.graph.input, *model.graph.output):
        tensor.doc_string = ""
        del tensor.metadata_props[:]


def _require_plain(model: bytes) -> None:
    """Nothing is written here that would be refused where it is to fly."""
    try:
        cost_of(read_graph(model), _TRACED_BATCH)
    except ForbiddenGraph as error:
        raise CheckFailed(
            f"The exported graph {error}; no file was written. Report this with the versions that"
            " `wakedeploy doctor` prints."
        ) from error


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """The exporter's progress and its remarks on absent libraries help nobody here."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
