"""Reading and writing metadata on protobuf bytes, beside the onnx package."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wakedeploy.core import onnx_wire

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
