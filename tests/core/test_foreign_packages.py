"""What strangers may put into a file: each is refused in a sentence, at once, before it is run."""

import json
import time
import tracemalloc

import numpy as np
import pytest
from hostile_models import MODELS, hostile
from made_packages import package_of, parsed, tiny_manifest, with_manifest

from wakedeploy.core import onnx_wire
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import FORCE_MARGIN, ForceChannel
from wakedeploy.core.package import (
    EXAMPLE_KEY,
    MANIFEST_KEY,
    MOST_BYTES,
    Example,
    make_package,
    package_from_bytes,
    read_package,
)

HUGE = 10**12
TAG_OF_GRAPH = b"\x3a"  # field 7, length-delimited


def refusal(data: bytes) -> str:
    """The sentence with which bytes are refused, within seconds of computing on a busy machine."""
    began_s = time.process_time()
    with pytest.raises(UnusableInput) as refused:
        package_from_bytes(data, "p.onnx")
    assert time.process_time() - began_s < 4.0
    text = str(refused.value)
    assert text.isprintable()
    assert len(text) < 700
    return text


@pytest.mark.parametrize("name", MODELS)
def test_a_hostile_graph_is_refused_and_named(name):
    package, reason = hostile(name)
    assert reason in refusal(package.model_bytes)


@pytest.mark.parametrize(
    ("kind", "changes", "reason"),
    [
        ("state", {"memory": {"kind": "state", "states": {"leaky": {"shape": [HUGE]}}}}, "shape"),
        # 2³² · 2³² is 0 in 64 bits
        ("state", {"memory": {"kind": "state", "states": {"leaky": {"shape": [2**32] * 2}}}}, "2"),
        (
            "state",
            {"memory": {"kind": "state", "states": {"leaky": {"shape": [10**4, 10**4]}}}},
            "states of 100000000 values",
        ),
        ("state", {"memory": {"kind": "state", "states": {"a": {"shape": [1] * 5}}}}, "shape"),
        ("state", {"warm_up_steps": HUGE}, "warm_up_steps"),
        ("window", {"memory": {"kind": "window", "k": 3, "stride": 10**9}}, "stride"),
        ("window", {"memory": {"kind": "window", "k": 10**9, "stride": 1}}, "memory.k"),
        ("window", {"memory": {"kind": "window", "k": 1000, "stride": 1000}}, "window of 999001"),
        ("window", {"warm_up_steps": 3}, "warm_up_steps 3 where 5 follows"),
        ("none", {"warm_up_steps": 8}, "warm_up_steps 8 where 1 follows"),
        ("none", {"rate_hz": 1e300}, "rate_hz"),
        ("none", {"rate_hz": 1e-9}, "rate_hz"),
        ("none", {"lead_s": 1e9}, "lead_s"),
        ("none", {"trainable": 100_000}, "trainable"),
        ("none", {"frozen": HUGE}, "frozen"),
        ("none", {"seed": 10**30}, "seed"),
        ("none", {"schema": 2}, "made by an older release (manifest schema '2'"),
        ("none", {"arch": "x" * 10_000}, "arch"),
        ("none", {"domain": "\x1b[2J"}, "domain"),
        ("none", {"hyper": {"a": {"b": 1}}}, "hyper.a"),
        ("none", {"\x1b[31m" * 99: 1}, "is not known"),
        ("none", {"hyper": {f"h{i}": 1 for i in range(100)}}, "hyper"),
        ("none", {"force": [{"name": "f", "unit": "N"}]}, "force.0.min is missing"),
        ("none", {"force": [{"name": "f", "unit": "N", "min": 1, "max": 0}]}, "min 1.0 lies above"),
        ("none", {"force": [{"name": "f", "unit": "N", "min": 0, "max": 1e30}]}, "force.0.max"),
        # as if its rounding excused any difference of the rollout
        (
            "none",
            {"parity": {"max_abs": 0, "max_rel": 0, "steps": 3200, "limit": 20, "float64_rel": 10}},
            "parity",
        ),
    ],
)
def test_what_a_manifest_may_ask_for_has_bounds(kind, changes, reason, tiny_package):
    assert reason in refusal(with_manifest(tiny_package(kind).model_bytes, **changes))


def test_an_example_stays_within_what_its_manifest_says_is_possible(tiny_package):
    made = tiny_package("none")  # its force lies between -3 and 3 N, and half of that beyond
    seen, force = made.example.observation, made.example.force
    for observation, forces, reason in (
        (seen, force + 50.0, "fx_n is 50 where -6 to 6 is possible"),
        (seen, force - 50.0, "fx_n is -50 where"),
        (seen, force + 1e30, "fx_n is 1e+30 where"),
        (seen, np.where(force == force[3], np.nan, force), "fx_n is nan where"),
        (1.5 * seen, force, "dx_m is -1.5 where -1 to 1 is possible"),
        (seen[:12], force[:12], "512 steps"),
    ):
        example = Example(0, observation.astype(np.float32), forces.astype(np.float32))
        made_so = make_package(made.model_bytes, made.manifest, example)
        assert reason in refusal(made_so.model_bytes)


def test_a_possible_force_lies_within_the_range_of_training_and_its_width_beyond():
    channel = ForceChannel(name="f", unit="N", min=-2.0, max=1.0)
    assert (channel.low, channel.high) == (-2.0 - 3.0 * FORCE_MARGIN, 1.0 + 3.0 * FORCE_MARGIN)
    still = ForceChannel(name="f", unit="N", min=0.5, max=0.5)
    assert (still.low, still.high) == (0.5 - FORCE_MARGIN, 0.5 + FORCE_MARGIN)


def varint(value: int) -> bytes:
    told = bytearray()
    while value >= 0x80:
        told.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*told, value])


def message(number: int, data: bytes) -> bytes:
    return varint(number << 3 | 2) + varint(len(data)) + data


def nested(levels: int) -> bytes:
    """A graph within a graph within …, as attributes of nodes could hold them."""
    data = b""
    for _ in range(levels):
        data = TAG_OF_GRAPH + varint(len(data)) + data
        if len(data) > 4_000_000:
            break
    return data


BYTES = {
    "a number that never ends": b"\x08" + b"\xff" * 1000,
    "a number cut short": b"\x08\xff",
    "a number of 70 bits": b"\x08" + b"\xff" * 9 + b"\x7f",
    "a length beyond the end": TAG_OF_GRAPH + varint(2**63) + b"abc",
    "a graph in a graph, a thousand deep": nested(1000),
    "a million empty entries": b"\x72\x00" * 1_000_000,
    "a million empty fields": b"\x40\x00" * 1_000_000,
    "a million empty nodes": TAG_OF_GRAPH + varint(2_000_000) + b"\x0a\x00" * 1_000_000,
    "field number 0": b"\x00\x00",
    "a group": b"\x0b\x0c",
    "zeros": bytes(100_000),
}


@pytest.mark.parametrize("name", BYTES)
def test_hostile_bytes_are_refused_at_once(name, tiny_package):
    refusal(BYTES[name])
    # Behind the metadata of a good package, hash and all:
    made = tiny_package("none")
    entries = onnx_wire.metadata(made.model_bytes)
    try:
        manifest = json.loads(entries[MANIFEST_KEY])
        whole = make_package(BYTES[name], made.manifest, made.example).model_bytes
    except onnx_wire.MalformedModel:
        return
    assert manifest
    refusal(whole)


def test_a_node_of_a_million_names_is_refused_at_once():
    node = b"\x22\x04Relu" + b"\x0a\x01a" * 1_000_000
    graph = b"\x0a" + varint(len(node)) + node
    opset = b"\x42\x02\x10\x14"
    model = opset + TAG_OF_GRAPH + varint(len(graph)) + graph
    text = refusal(package_of(model, tiny_manifest("none")).model_bytes)
    assert "more than" in text


def test_a_type_told_in_two_parts_is_refused(tiny_package):
    """Protobuf merges them: a reader that took one would see another shape than onnxruntime."""
    made = tiny_package("none")
    (graph,) = (f.value for f in onnx_wire.fields(made.model_bytes) if f.number == 7)
    others = [f for f in onnx_wire.fields(graph) if f.number != 11]
    (value,) = (f.value for f in onnx_wire.fields(graph) if f.number == 11)
    name = next(bytes(f.raw) for f in onnx_wire.fields(value))
    (told,) = (bytes(f.value) for f in onnx_wire.fields(value) if f.number == 2)
    twice = name + message(2, told + message(1, b"\x08\x01"))
    graph = b"".join(bytes(f.raw) for f in others) + message(11, twice)
    rest = [bytes(f.raw) for f in onnx_wire.fields(made.model_bytes) if f.number not in (7, 14)]
    model = b"".join(rest) + message(7, graph)
    import onnx

    assert onnx.load_from_string(model).graph.input[0].type.tensor_type.shape.dim[1].dim_value == 2
    assert "more than 1 tensor_type" in refusal(package_of(model, made.manifest).model_bytes)


def test_a_file_larger_than_any_package_is_not_read_to_its_end(tmp_path):
    endless = tmp_path / "large.onnx"
    with endless.open("wb") as file:
        file.truncate(1 << 40)
    tracemalloc.start()
    with pytest.raises(UnusableInput, match="larger than 64 MiB"):
        read_package(endless)
    assert tracemalloc.get_traced_memory()[1] < 1.2 * MOST_BYTES
    tracemalloc.stop()


def test_a_large_entry_is_refused(tiny_package):
    model = tiny_package("none").model_bytes
    entries = onnx_wire.metadata(model)
    for key in (MANIFEST_KEY, EXAMPLE_KEY):
        padded = entries | {key: entries[key] + " " * (1 << 20)}
        assert "metadata" in refusal(onnx_wire.with_metadata(model, padded))


def test_names_from_a_file_do_not_reach_a_terminal_as_they_are(tiny_package):
    model = parsed("t (float[B, 2] observation) => (float[B, 1] force) {}", {})
    model.graph.output[0].name = "\x1b[2J" + "x" * 900
    assert "its graph gives" in refusal(
        package_of(model.SerializeToString(), tiny_manifest("none")).model_bytes
    )
