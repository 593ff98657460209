"""Models that nobody should have to run: what an ONNX file can be made to do, one by one.

All take the tiny packages' observation and give a force of its size, so that nothing but what is
hostile about them stands between them and a flight.
"""

from collections.abc import Callable

import numpy as np
import pytest
from made_packages import HEADER, package_of, parsed, tiny_manifest

from wakedeploy.core.package import Package

HEAD = "t (float[B, 2] observation) => (float[B, 2] force)"


def onnx():
    """The onnx package, where there is one."""
    return pytest.importorskip("onnx")


def plain(body: str, **constants: object) -> bytes:
    """A model of ONNX's text with raw constants."""
    return parsed(f"{HEAD} {body}", constants).SerializeToString()


def looping(trips: int) -> bytes:
    """A loop of so many turns over the observation, which is also the force."""
    inner = "b (int64 i, bool go, float[B, 2] x) => (bool more, float[B, 2] y)"
    body = f"{{ force = Loop <body = {inner} {{ more = Identity (go) y = Relu (x) }}>"
    return plain(f"{body} (trips, go, observation) }}", trips=np.array(trips), go=np.array(True))


def branching_to_a_file() -> bytes:
    """An If whose branch takes its weights from a file that no hash covers."""
    model = parsed(
        f"{HEAD} {{ away = If <then_branch = a () => (float[2] w) {{ w = Relu (v) }},"
        " else_branch = b () => (float[2] w) { w = Relu (v) }> (go)"
        " force = Add (observation, away) }",
        {"go": np.array(True)},
    )
    for attribute in model.graph.node[0].attribute:
        attribute.g.initializer.append(external("v"))
    return model.SerializeToString()


def external(name: str):
    """Two weights that lie in weights.bin, beside the model."""
    tensor = onnx().TensorProto(name=name, data_type=1, dims=[2])
    tensor.data_location = onnx().TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="weights.bin")
    return tensor


def external_weights() -> bytes:
    """Weights in a file, told at the top of the graph."""
    model = parsed(f"{HEAD} {{ force = Add (observation, w) }}", {})
    model.graph.initializer.append(external("w"))
    return model.SerializeToString()


def external_weights_told_short() -> bytes:
    """The same, where only the location says so."""
    model = parsed(f"{HEAD} {{ force = Add (observation, w) }}", {})
    tensor = external("w")
    del tensor.external_data[:]
    model.graph.initializer.append(tensor)
    return model.SerializeToString()


def external_attribute() -> bytes:
    """A Constant whose tensor lies in a file."""
    model = parsed(f"{HEAD} {{ w = Constant () force = Add (observation, w) }}", {})
    model.graph.node[0].attribute.append(onnx().helper.make_attribute("value", external("")))
    return model.SerializeToString()


def external_attribute_of_a_plain_operator() -> bytes:
    """A tensor as an attribute of an operator that has none."""
    model = parsed(f"{HEAD} {{ force = Relu (observation) }}", {})
    model.graph.node[0].attribute.append(onnx().helper.make_attribute("value", external("")))
    return model.SerializeToString()


def external_sparse_weights() -> bytes:
    """Sparse weights, whose values lie in a file."""
    model = parsed(f"{HEAD} {{ force = Add (observation, w) }}", {})
    sparse = model.graph.sparse_initializer.add(dims=[2])
    sparse.values.CopyFrom(external("w"))
    sparse.indices.CopyFrom(onnx().numpy_helper.from_array(np.array([0, 1])))
    return model.SerializeToString()


def function_of_its_own() -> bytes:
    """A function in the model, and a call of it."""
    text = (
        f'<ir_version: 10, opset_import: ["" : 20, "own" : 1]> {HEAD}'
        "{ force = own.f (observation) }"
        ' <domain: "own", opset_import: ["" : 20]> f (x) => (y) { y = Relu (x) }'
    )
    return onnx().parser.parse_model(text).SerializeToString()


def operator_of_a_domain() -> bytes:
    """An operator that onnxruntime knows beside ONNX's."""
    header = '<ir_version: 10, opset_import: ["" : 20, "com.microsoft" : 1]>'
    body = f"{HEAD} {{ force = com.microsoft.Gelu (observation) }}"
    return parsed(body, {}, header).SerializeToString()


def operator_under_another_domain() -> bytes:
    """An operator's plain name in a domain that is not imported."""
    model = parsed(f"{HEAD} {{ force = Relu (observation) }}", {})
    model.graph.node[0].domain = "com.microsoft"
    return model.SerializeToString()


def older_operators() -> bytes:
    """The operators' meanings of another version."""
    header = HEADER.replace("20", "13")
    return parsed(f"{HEAD} {{ force = Relu (observation) }}", {}, header).SerializeToString()


def made_at_run_time(body: str, **constants: object) -> Callable[[], bytes]:
    """A model that asks for memory once it runs."""
    return lambda: plain(body, **constants)


def doubled() -> bytes:
    """Two numbers, joined with themselves forty times, and summed up again."""
    turns = "".join(f"w{i + 1} = Concat <axis: int = 0> (w{i}, w{i}) " for i in range(40))
    body = (
        f"{{ {turns} s = ReduceSum <keepdims: int = 0> (w40, axes) force = Add (observation, s)}}"
    )
    return plain(body, w0=np.ones(2, np.float32), axes=np.array([0]))


def two_graphs() -> bytes:
    """A second graph, which protobuf merges into the first."""
    model = parsed(f"{HEAD} {{ force = Relu (observation) }}", {})
    more = onnx().ModelProto()
    more.graph.node.add(op_type="RandomNormalLike", input=["force"], output=["f"])
    return model.SerializeToString() + more.SerializeToString()


TALL = np.ones((30_000, 1), np.float32)
GATHERED = np.zeros(30_000, np.int64)
SUM = "s = ReduceMean <keepdims: int = 0> (m, axes) force = Add (observation, s)"
AXES = np.array([0, 1])
ONES = np.ones((400, 300), np.float32)
MILLIONS = np.array([10**6, 10**6])

MODELS: dict[str, tuple[Callable[[], bytes], str]] = {
    "a loop that ends in thirty years": (lambda: looping(10**15), "operator 'Loop'"),
    "a loop that takes a second": (lambda: looping(10**6), "operator 'Loop'"),
    "a branch with weights elsewhere": (branching_to_a_file, "operator 'If'"),
    "weights elsewhere": (external_weights, "weights in another file"),
    "weights elsewhere, told short": (external_weights_told_short, "weights in another file"),
    "an attribute elsewhere": (external_attribute, "operator 'Constant'"),
    "a foreign attribute": (external_attribute_of_a_plain_operator, "a tensor as an attribute"),
    "sparse weights elsewhere": (external_sparse_weights, "sparse weights"),
    "a function": (function_of_its_own, "functions of its own"),
    "an operator of a domain": (operator_of_a_domain, "'com.microsoft' 1"),
    "a plain name in a domain": (operator_under_another_domain, "'Relu' of 'com.microsoft'"),
    "older operators": (older_operators, "'' 13"),
    "two graphs": (two_graphs, "more than 1 graph"),
    "a scan": (
        made_at_run_time(
            "{ force = Scan <num_scan_inputs: int = 1, body = b (float[2] x) => (float[2] y)"
            " { y = Relu (x) }> (observation) }"
        ),
        "operator 'Scan'",
    ),
    "chance": (
        made_at_run_time("{ r = RandomNormalLike (observation) force = Add (r, observation) }"),
        "operator 'RandomNormalLike'",
    ),
    "a constant of a shape": (
        made_at_run_time(f"{{ m = ConstantOfShape (n) {SUM} }}", n=MILLIONS, axes=AXES),
        "operator 'ConstantOfShape'",
    ),
    "an expansion": (
        made_at_run_time(f"{{ m = Expand (w, n) {SUM} }}", w=np.float32(1), n=MILLIONS, axes=AXES),
        "operator 'Expand'",
    ),
    "tiles": (
        made_at_run_time(
            f"{{ m = Tile (w, n) {SUM} }}", w=np.ones((1, 1), np.float32), n=MILLIONS, axes=AXES
        ),
        "operator 'Tile'",
    ),
    "a range": (
        made_at_run_time(
            "{ m = Range (a, b, c) s = ReduceMean <keepdims: int = 0> (m, axes)"
            " force = Add (observation, s) }",
            a=np.float32(0),
            b=np.float32(1e12),
            c=np.float32(1),
            axes=np.array([0]),
        ),
        "operator 'Range'",
    ),
    "two numbers doubled forty times": (doubled, "takes more than a step may"),
    "a sum of all pairs": (
        made_at_run_time(
            f"{{ flat = Transpose <perm: ints = [1, 0]> (w) m = Add (w, flat) {SUM} }}",
            w=TALL,
            axes=AXES,
        ),
        "takes more than a step may",
    ),
    "a product of all pairs": (
        made_at_run_time(
            f"{{ flat = Transpose <perm: ints = [1, 0]> (w) m = MatMul (w, flat) {SUM} }}",
            w=TALL,
            axes=AXES,
        ),
        "takes more than a step may",
    ),
    "a row fetched thirty thousand times": (
        made_at_run_time(
            f"{{ flat = Transpose <perm: ints = [1, 0]> (w) m = Gather (flat, i) {SUM} }}",
            w=TALL,
            i=GATHERED,
            axes=AXES,
        ),
        "takes more than a step may",
    ),
    "a padded convolution": (
        made_at_run_time(
            "{ c = Conv <pads: ints = [1000000000, 1000000000]> (w, k)"
            " s = ReduceMean <keepdims: int = 0> (c, axes) force = Add (observation, s) }",
            w=np.ones((1, 1, 1), np.float32),
            k=np.ones((1, 1, 1), np.float32),
            axes=np.array([0, 1, 2]),
        ),
        "takes more than a step may",
    ),
    "a shape computed on the way": (
        made_at_run_time(
            "{ n = Mul (a, a) force = Reshape (observation, n) }", a=np.array([1, -1])
        ),
        "applies Reshape to what it does not fit",
    ),
    "a weight that is no number": (
        made_at_run_time("{ force = Add (observation, w) }", w=np.float32("nan")),
        "not finite",
    ),
    "a weight without an end": (
        made_at_run_time("{ force = Mul (observation, w) }", w=np.float32("inf")),
        "not finite",
    ),
    "weights in doubles": (
        made_at_run_time("{ force = Add (observation, w) }", w=np.ones(2)),
        "no whole raw array of float32 or int64",
    ),
    "more weights than it says": (
        made_at_run_time("{ force = Add (observation, s) }", s=np.float32(0), w=ONES),
        "holds 120,001 weights and its manifest declares 12",
    ),
}


def hostile(name: str) -> tuple[Package, str]:
    """A package of one of the models, and what has to be said of it."""
    model, reason = MODELS[name]
    memory = {"kind": "none"}
    manifest = tiny_manifest("window", memory=memory, warm_up_steps=1)
    return package_of(model(), manifest), reason
