"""What the exported graphs of the eight look like, read with the onnx package."""

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from export.example import example_rollout
from export.graph import graph_bytes
from export.packaging import manifest_of
from export.reference import reference_config
from runtime.predictor import PackagePredictor, inference_session
from trainers.build import ARCHITECTURES
from trainers.memory import Memory
from trainers.model import Predictor, WakeModel
from trainers.preset import SHIPPED, read_preset
from trainers.training.runs import new_predictor
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.manifest import ForceChannel
from wakedeploy.core.onnx_graph import OPERATORS, read_graph
from wakedeploy.core.onnx_shapes import MOST_VALUES, MOST_WORK, cost_of
from wakedeploy.core.package import make_package

UNIT = ForceChannel(name="force", unit="N", min=0.0, max=1.5)


@pytest.fixture(params=ARCHITECTURES)
def graph(request, exported_arch) -> bytes:
    return exported_arch(request.param).package.model_bytes


def test_a_graph_is_plain_arithmetic_of_opset_20_in_one_file(graph):
    model = onnx.load_from_string(graph)
    assert {node.op_type for node in model.graph.node} <= set(OPERATORS)
    assert [(entry.domain, entry.version) for entry in model.opset_import] == [("", 20)]
    assert not model.functions
    assert not any(tensor.external_data for tensor in model.graph.initializer)


def test_no_operator_or_attribute_is_allowed_that_no_architecture_needs(exported_arch):
    used: dict[str, set[str]] = {}
    for arch in ARCHITECTURES:
        for node in onnx.load_from_string(exported_arch(arch).package.model_bytes).graph.node:
            used.setdefault(node.op_type, set()).update(a.name for a in node.attribute)
    assert used == {op: set(attributes) for op, attributes in OPERATORS.items()}


def inferred(model: onnx.ModelProto, batch: int) -> dict[str, tuple[int, ...]]:
    """Shapes of all tensors as the onnx package tells them."""
    for tensor in (*model.graph.input, *model.graph.output):
        tensor.type.tensor_type.shape.dim[0].dim_value = batch
    told = onnx.shape_inference.infer_shapes(model, strict_mode=True, data_prop=True).graph
    values = (*told.value_info, *told.input, *told.output)
    return {v.name: tuple(d.dim_value for d in v.type.tensor_type.shape.dim) for v in values}


def assert_shapes_agree(graph: bytes):
    for batch in (1, 3):
        shapes, cost = cost_of(read_graph(graph), batch)
        told = inferred(onnx.load_from_string(graph), batch)
        assert {name: shapes[name] for name in told} == told
        assert len(told) > len(onnx.load_from_string(graph).graph.node)
        assert cost.values < MOST_VALUES / 10
        assert cost.work < MOST_WORK / 10


def test_shapes_are_told_as_the_onnx_package_tells_them(graph):
    assert_shapes_agree(graph)


def exported(arch: str, inputs: int = 5, kept_from: tuple[str, ...] = (), **hyper) -> bytes:
    """The graph of an architecture's untrained predictor, of another shape than Table I's."""
    plain = reference_config(arch)
    channels = {"observation": plain.observation[:inputs], "force": plain.force[:1]}
    changes = {"hyper": hyper, "present_only": kept_from, "loss_weights": (1.0,)} | channels
    config = plain.model_copy(update=changes)
    return graph_bytes(new_predictor(config).eval(), (UNIT,))


OTHER_SHAPES = [
    ("agile-mlp", {"layers": 64, "hidden": 4}),
    ("history-mlp", {"snapshots": 2, "inputs": 1}),
    ("delay-embedding", {"kept_from": ("o0", "o2")}),
    ("gru", {"kept_from": ("o0", "o2")}),
    ("tcn", {"channels": 1, "kernel": 2, "blocks": 1}),
    ("mamba", {"d_conv": 2, "d_state": 1, "d_model": 1, "dt_rank": 1, "expand": 1}),
    ("esn", {"neurons": 3, "density": 1.0, "kept_from": ("o0",)}),
    ("cross-attention", {"heads": 1, "embed": 2, "history_s": 30.0}),
]
MOST_VARIED = ("gru", "mamba", "cross-attention")


@pytest.mark.whole
@pytest.mark.parametrize(
    ("arch", "shape"),
    [  # those whose graphs have most kinds of nodes, and a state beside what is not kept
        pytest.param(*each, marks=[] if each[0] in MOST_VARIED else pytest.mark.slow)
        for each in OTHER_SHAPES
    ],
)
def test_other_shapes_stay_inside_what_a_package_may_hold(arch, shape):
    assert_shapes_agree(exported(arch, **shape))


@pytest.mark.slow
@pytest.mark.parametrize("preset", sorted(SHIPPED.glob("*/*.toml")), ids=str)
def test_every_tuned_shape_stays_inside_what_a_package_may_hold(preset):
    tuned = read_preset(preset)
    assert_shapes_agree(exported(tuned.arch, **tuned.hyper))


@pytest.mark.parametrize("arch", ["agile-mlp", "history-mlp", "gru"])
def test_a_force_beyond_what_is_possible_is_limited(arch):
    config = reference_config(arch)
    predictor = new_predictor(config).eval()
    predictor.force_mean.fill_(1e6)  # whatever it is given
    narrow = (UNIT, ForceChannel(name="other", unit="N", min=-3.0, max=-1.0))
    manifest = manifest_of(predictor, config, narrow, None)
    example = example_rollout(predictor, config, narrow)
    runner = PackagePredictor(make_package(graph_bytes(predictor, narrow), manifest, example))
    assert runner.step(np.zeros(8)).tolist() == [UNIT.high, 0.0] == [2.25, 0.0]
    assert not UNIT.is_possible(2.25)
    assert np.array_equal(example.force, np.tile(np.float32([2.25, 0.0]), (512, 1)))


def test_a_force_that_is_none_stays_none(exported_arch):
    for arch in ARCHITECTURES:
        runner = PackagePredictor(exported_arch(arch).package)
        for _ in range(runner.warm_up_steps):
            nothing = runner.step(np.full(8, np.nan))
        assert np.isnan(nothing).all(), arch


def test_weights_that_are_no_numbers_become_no_package():
    predictor = new_predictor(reference_config("agile-mlp")).eval()
    predictor.force_mean.fill_(float("nan"))
    with pytest.raises(CheckFailed, match="not finite"):
        graph_bytes(predictor, (UNIT, UNIT))


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
    manifest = made.package.manifest
    again = graph_bytes(made.predictor, manifest.force)
    package = make_package(again, manifest, made.package.example)
    assert package.model_bytes == made.path.read_bytes()


@pytest.mark.whole
def test_exporting_leaves_dropout_out_and_the_predictor_in_training():
    config = reference_config("gru").model_copy(update={"hyper": {"dropout": 0.5}})
    predictor = new_predictor(config).train()
    model = onnx.load_from_string(graph_bytes(predictor, (UNIT, UNIT)))
    assert "Dropout" not in {node.op_type for node in model.graph.node}
    assert predictor.training


def test_a_graph_that_draws_at_random_is_refused():
    class Noisy(WakeModel):
        memory = Memory("none")

        def forward(self, observation):
            return observation + torch.randn_like(observation)

    with pytest.raises(CheckFailed, match="RandomNormalLike"):
        graph_bytes(Predictor("noisy", Noisy(), 2, 2), (UNIT, UNIT))
