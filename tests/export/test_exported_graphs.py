"""What the exported graphs of the eight look like, read with the onnx package."""

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from export.graph import graph_bytes
from export.reference import reference_config
from runtime.predictor import inference_session
from trainers.build import ARCHITECTURES
from trainers.memory import Memory
from trainers.model import Predictor, WakeModel
from trainers.runs import new_predictor
from wakedeploy.errors import CheckFailed
from wakedeploy.package import make_package

PLAIN = {
    "Add", "Concat", "Conv", "Div", "Exp", "Gather", "Gemm", "Greater", "LayerNormalization",
    "MatMul", "Mul", "Pow", "ReduceMean", "ReduceSum", "Reciprocal", "Relu", "Reshape", "Sigmoid",
    "Slice", "Softmax", "Softplus", "Split", "Sqrt", "Squeeze", "Sub", "Tanh", "Transpose",
    "Unsqueeze", "Where",
}  # fmt: skip


@pytest.fixture(params=ARCHITECTURES)
def graph(request, exported_arch) -> bytes:
    return exported_arch(request.param).package.model_bytes


def test_a_graph_is_plain_arithmetic_of_opset_20_in_one_file(graph):
    model = onnx.load_from_string(graph)
    assert {node.op_type for node in model.graph.node} <= PLAIN
    assert [(entry.domain, entry.version) for entry in model.opset_import] == [("", 20)]
    assert not model.functions
    assert not any(tensor.external_data for tensor in model.graph.initializer)


def test_only_the_batch_axis_is_dynamic(graph):
    model = onnx.load_from_string(graph)
    for tensor in (*model.graph.input, *model.graph.output):
        batch, *others = tensor.type.tensor_type.shape.dim
        assert batch.dim_param == "batch"
        assert all(dim.dim_value > 0 for dim in others)


def test_nothing_of_the_machine_that_exported_is_in_the_file(graph):
    places = (str(Path.cwd()), str(Path.home()), "site-packages", ".py", "stack_trace", "aten.")
    assert [place for place in places if place.encode() in graph] == []


def test_every_batch_size_gives_each_series_its_own_force(graph):
    session = inference_session(graph)
    draw = np.random.default_rng(0)
    shapes = {i.name: i.shape[1:] for i in session.get_inputs()}
    five = {name: draw.normal(size=(5, *s)).astype(np.float32) for name, s in shapes.items()}
    together = session.run(None, five)
    for b in range(5):
        alone = session.run(None, {name: value[b : b + 1] for name, value in five.items()})
        for one, all_of_them in zip(alone, together, strict=True):
            assert np.allclose(one[0], all_of_them[b], rtol=1e-5, atol=1e-5)


def test_exporting_twice_gives_the_same_bytes(exported_arch):
    made = exported_arch("agile-mlp")
    package = make_package(graph_bytes(made.predictor), made.package.manifest, made.package.example)
    assert package.model_bytes == made.path.read_bytes()


def test_exporting_leaves_dropout_out_and_the_predictor_in_training():
    config = reference_config("gru").model_copy(update={"hyper": {"dropout": 0.5}})
    predictor = new_predictor(config).train()
    kinds = {node.op_type for node in onnx.load_from_string(graph_bytes(predictor)).graph.node}
    assert kinds <= PLAIN
    assert predictor.training


def test_a_graph_that_draws_at_random_is_refused():
    class Noisy(WakeModel):
        memory = Memory("none")

        def forward(self, observation):
            return observation + torch.randn_like(observation)

    with pytest.raises(CheckFailed, match="RandomNormalLike"):
        graph_bytes(Predictor("noisy", Noisy(), 2, 2))
