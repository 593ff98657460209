"""A package is read whole and refused with a sentence where anything about it is wrong."""

import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_packages import with_manifest

from wakedeploy.core import onnx_wire
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.package import (
    EXAMPLE_KEY,
    MANIFEST_KEY,
    Example,
    graph_sha256,
    make_package,
    package_from_bytes,
    read_package,
    sealed,
    write_package,
)

KINDS = ("none", "window", "state")


@pytest.mark.parametrize("kind", KINDS)
def test_what_was_written_is_read_back(tmp_path, tiny_package, kind):
    written = tiny_package(kind)
    write_package(written, tmp_path / "p.onnx")
    read = read_package(tmp_path / "p.onnx")
    assert read.manifest == written.manifest
    assert read.sha256 == written.sha256
    assert np.array_equal(read.example.observation, written.example.observation)
    assert np.array_equal(read.example.force, written.example.force)


def test_the_manifest_uses_the_agreed_field_names(tiny_package):
    manifest = json.loads(onnx_wire.metadata(tiny_package("state").model_bytes)[MANIFEST_KEY])
    agreed = (
        "schema, arch, hyper, domain, rate_hz, lead_s, observation, force, memory, warm_up_steps,"
        " trainable, frozen, data_sha256, seed, test, parity, versions, graph_sha256"
    )
    assert ", ".join(manifest) == agreed
    assert set(manifest["memory"]) == {"kind", "k", "stride", "states"}
    assert manifest["memory"]["states"]["leaky"] == {"shape": [2], "initial": [1.0, -1.0]}


def test_the_onnx_package_and_onnxruntime_see_the_same_manifest(tiny_package):
    onnx, ort = pytest.importorskip("onnx"), pytest.importorskip("onnxruntime")
    model = tiny_package("none").model_bytes
    entries = onnx_wire.metadata(model)
    assert {p.key: p.value for p in onnx.load_from_string(model).metadata_props} == entries
    assert ort.InferenceSession(model).get_modelmeta().custom_metadata_map == entries


def test_the_hash_survives_another_tool_rewriting_the_file(tiny_package):
    onnx = pytest.importorskip("onnx")
    package = tiny_package("window")
    rewritten = onnx.load_from_string(package.model_bytes)
    rewritten.metadata_props.add(key="note", value="seen")
    assert graph_sha256(rewritten.SerializeToString()) == package.manifest.graph_sha256


def altered(tiny_package, kind: str = "state") -> dict[str, tuple[bytes, str]]:
    model = tiny_package(kind).model_bytes
    entries = onnx_wire.metadata(model)
    fewer = [{"name": "dx_m", "unit": "m", "min": 0, "max": 1}]
    window = {"memory": {"kind": "window", "k": 3, "stride": 2}, "warm_up_steps": 5}
    bad_range = [{"name": "dx_m", "unit": "m", "min": 2, "max": 1}] * 2
    no_example = {MANIFEST_KEY: entries[MANIFEST_KEY]}
    long_example = Example(0, np.zeros((4, 3), np.float32), np.zeros((4, 2), np.float32))
    weak = {"max_abs": 1, "max_rel": 1, "steps": 3200, "limit": 0.001}
    return {
        "empty": (b"", "not an ONNX model"),
        "text": (b"# a README, not a model\n", "not an ONNX model"),
        "foreign": (onnx_wire.without_metadata(model), "without a wakedeploy manifest"),
        "newer": (with_manifest(model, schema=4), "newer release"),
        "no schema": (with_manifest(model, schema="absent"), "no schema version"),
        "no rate": (with_manifest(model, rate_hz="absent"), "rate_hz"),
        "bad rate": (with_manifest(model, rate_hz=-1), "rate_hz"),
        "unknown key": (with_manifest(model, secret=1), "secret"),
        "bad range": (with_manifest(model, observation=bad_range), "min 2.0 lies above max 1.0"),
        "weak limit": (with_manifest(model, parity=weak), "limit 0.001 where 1e-05 follows"),
        "other channels": (with_manifest(model, observation=fewer), "its graph takes"),
        "other memory": (with_manifest(model, **window), "its graph takes"),
        "other forces": (
            with_manifest(model, force=[{"name": "f", "unit": "N", "min": 0, "max": 1}]),
            "graph gives",
        ),
        "other hash": (with_manifest(model, graph_sha256="1" * 64), "damaged or altered"),
        "no example": (sealed(model, no_example), "example rollout"),
        "bad example": (
            sealed(model, no_example | {EXAMPLE_KEY: "{}"}),
            "example",
        ),
        "long example": (
            sealed(model, no_example | {EXAMPLE_KEY: long_example.to_json()}),
            "do not fit its channels",
        ),
    }


def test_each_kind_of_bad_file_is_refused_in_one_sentence(tmp_path, tiny_package):
    for name, (data, reason) in altered(tiny_package).items():
        (tmp_path / "bad.onnx").write_bytes(data)
        with pytest.raises(UnusableInput) as refusal:
            read_package(tmp_path / "bad.onnx")
        text = str(refusal.value)
        assert "bad.onnx" in text, name
        assert reason in text, (name, text)
        assert "\n" not in text, name


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(UnusableInput, match="cannot be read"):
        read_package(tmp_path / "absent.onnx")


def test_a_changed_weight_is_noticed(tiny_package):
    onnx = pytest.importorskip("onnx")
    model = onnx.load_from_string(tiny_package("window").model_bytes)
    weights = model.graph.initializer[0]
    weights.raw_data = b"\x01" + weights.raw_data[1:]
    with pytest.raises(UnusableInput, match="damaged or altered"):
        package_from_bytes(model.SerializeToString(), "p.onnx")


@pytest.mark.parametrize(
    ("said", "instead"),
    [
        ('"unit":"N"', '"unit":"mN"'),
        ('"lead_s":0.09', '"lead_s":0.5'),
        ('"name":"dx_m","unit":"m","min":-1.0', '"name":"dx_m","unit":"m","min":-9.0'),
    ],
)
def test_a_changed_description_is_noticed(tiny_package, said, instead):
    model = tiny_package("window").model_bytes
    entries = onnx_wire.metadata(model)
    manifest = entries[MANIFEST_KEY].replace(said, instead, 1)
    assert manifest != entries[MANIFEST_KEY]
    changed = onnx_wire.with_metadata(model, entries | {MANIFEST_KEY: manifest})
    with pytest.raises(UnusableInput, match="manifest and example rollout differs"):
        package_from_bytes(changed, "p.onnx")
    assert package_from_bytes(sealed(model, entries | {MANIFEST_KEY: manifest}), "p.onnx")


def test_a_changed_example_is_noticed(tiny_package):
    model = tiny_package("state").model_bytes
    entries = onnx_wire.metadata(model)
    example = Example.from_json(entries[EXAMPLE_KEY])
    example.force[7] = np.nextafter(example.force[7], np.float32(1))
    changed = onnx_wire.with_metadata(model, entries | {EXAMPLE_KEY: example.to_json()})
    with pytest.raises(UnusableInput, match="manifest and example rollout differs"):
        package_from_bytes(changed, "p.onnx")


def test_a_fixed_batch_axis_is_refused(tiny_package):
    onnx = pytest.importorskip("onnx")
    made = tiny_package("none")
    model = onnx.load_from_string(made.model_bytes)
    model.graph.input[0].type.tensor_type.shape.dim[0].dim_value = 1
    fixed = make_package(model.SerializeToString(), made.manifest, made.example)
    with pytest.raises(UnusableInput, match="batch axis"):
        package_from_bytes(fixed.model_bytes, "p.onnx")


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_every_truncation_is_refused(whole_package, data):
    cut = data.draw(st.integers(0, len(whole_package) - 1))
    with pytest.raises(UnusableInput):
        package_from_bytes(whole_package[:cut], "p.onnx")


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_a_flipped_byte_is_refused_or_harmless_to_the_graph(whole_package, data):
    at = data.draw(st.integers(0, len(whole_package) - 1))
    damaged = bytearray(whole_package)
    damaged[at] ^= data.draw(st.integers(1, 255))
    try:
        package = package_from_bytes(bytes(damaged), "p.onnx")
    except UnusableInput:
        return
    assert package.manifest.graph_sha256 == graph_sha256(whole_package)


@pytest.fixture(scope="module")
def whole_package(tiny_package) -> bytes:
    return tiny_package("state").model_bytes


def test_reading_needs_neither_onnx_nor_torch_nor_onnxruntime(tmp_path, tiny_package):
    write_package(tiny_package("state"), tmp_path / "p.onnx")
    code = (
        "import sys; from wakedeploy.core.package import read_package; read_package(sys.argv[1]);"
        "print(sorted({'onnx', 'torch', 'onnxruntime'} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "p.onnx")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
