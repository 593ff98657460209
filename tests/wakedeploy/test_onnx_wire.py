"""Reading and writing metadata on protobuf bytes, beside the onnx package."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wakedeploy import onnx_wire

onnx = pytest.importorskip("onnx")

GRAPH = (
    '<ir_version: 10, opset_import: ["" : 20]>'
    "t (float[batch, 3, 5] window, float[2] bias) => (float[batch, 2] force) "
    "{ force = Identity (bias) }"
)
ENTRIES = st.dictionaries(st.text(max_size=20), st.text(max_size=300), max_size=4)


def a_model(entries: dict[str, str]):
    model = onnx.parser.parse_model(GRAPH)
    onnx.helper.set_model_props(model, entries)
    return model


@given(before=ENTRIES, after=ENTRIES)
def test_metadata_is_read_and_replaced_as_the_onnx_package_does(before, after):
    model = a_model(before)
    assert onnx_wire.metadata(model.SerializeToString()) == before
    rewritten = onnx.load_from_string(onnx_wire.with_metadata(model.SerializeToString(), after))
    assert {p.key: p.value for p in rewritten.metadata_props} == after
    onnx.helper.set_model_props(model, after)
    assert rewritten == model


@given(entries=ENTRIES)
def test_what_remains_without_metadata_does_not_depend_on_it(entries):
    bare = a_model({}).SerializeToString()
    assert onnx_wire.without_metadata(a_model(entries).SerializeToString()) == bare


@given(data=st.binary(max_size=300))
def test_any_bytes_are_walked_completely_or_refused(data):
    try:
        walked = b"".join(field.raw for field in onnx_wire.fields(data))
    except onnx_wire.MalformedModel:
        return
    assert walked == data


@given(cut=st.integers(min_value=0))
def test_a_model_cut_anywhere_has_no_metadata_and_graph_both(cut):
    whole = onnx_wire.with_metadata(a_model({}).SerializeToString(), {"key": "value"})
    part = whole[: cut % len(whole)]
    with contextlib.suppress(onnx_wire.MalformedModel):
        assert not (onnx_wire.signature(part) and onnx_wire.metadata(part))


@given(data=st.binary(max_size=80), at=st.integers(min_value=0))
def test_damaged_models_raise_nothing_else(data, at):
    whole = a_model({"key": "value"}).SerializeToString()
    at %= len(whole)
    damaged = whole[:at] + data + whole[at + len(data) :]
    with contextlib.suppress(onnx_wire.MalformedModel):
        onnx_wire.signature(damaged)
        onnx_wire.metadata(damaged)


def test_the_signature_tells_names_element_types_and_axes():
    signature = onnx_wire.signature(a_model({}).SerializeToString())
    assert signature.inputs == (
        onnx_wire.Tensor("window", onnx.TensorProto.FLOAT, ("batch", 3, 5)),
        onnx_wire.Tensor("bias", onnx.TensorProto.FLOAT, (2,)),
    )
    assert signature.outputs == (onnx_wire.Tensor("force", 1, ("batch", 2)),)
    assert not signature.external_data


def test_weights_in_another_file_are_noticed():
    model = a_model({})
    weights = onnx.TensorProto(name="w", data_type=1, dims=[1])
    weights.data_location = onnx.TensorProto.EXTERNAL
    model.graph.initializer.append(weights)
    assert onnx_wire.signature(model.SerializeToString()).external_data
