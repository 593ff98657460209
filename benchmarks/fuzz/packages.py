"""Damage to packages: bytes, fields of the graph at any depth, manifest and example rollout."""

import json
import random
from collections.abc import Mapping

from benchmarks.fuzz.documents import altered
from benchmarks.fuzz.text import Mutator, damaged
from wakedeploy.core import onnx_wire
from wakedeploy.core.package import EXAMPLE_KEY, MANIFEST_KEY, graph_sha256, sealed

_NUMBERS = (
    0, 1, 2, 7, 127, 128, 2**31, 2**32, 2**32 + 1, 2**63 - 1, 2**63, 2**64 - 1, 10**12,
)  # fmt: skip
_DEEPEST = 6


def onnx_file(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """A package damaged in one of the ways."""
    return draw.choice(list(WAYS.values()))(draw, data, other)


def in_hashed_bytes(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """The graph's bytes damaged, and its hash made to fit."""
    graph = onnx_wire.without_metadata(data)
    return _rehashed(damaged(draw, graph, graph), onnx_wire.metadata(data))


def in_hashed_fields(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """One of the graph's fields forged, and its hash made to fit."""
    graph = onnx_wire.without_metadata(data)
    return _rehashed(forged(draw, graph), onnx_wire.metadata(data))


def in_manifest(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """Other values in the manifest, and its hash made to fit."""
    return _with_entry(draw, data, MANIFEST_KEY)


def in_example(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """Other values in the example rollout, and its hash made to fit."""
    return _with_entry(draw, data, EXAMPLE_KEY)


WAYS: Mapping[str, Mutator] = {
    "bytes": damaged,
    "bytes under the hash": in_hashed_bytes,
    "fields under the hash": in_hashed_fields,
    "manifest": in_manifest,
    "example": in_example,
}


def forged(draw: random.Random, message: bytes, depth: int = 0) -> bytes:
    """A message in which one field, at whatever depth, is replaced, doubled or left out."""
    try:
        fields = list(onnx_wire.fields(message))
    except onnx_wire.MalformedModel:
        return damaged(draw, message, message)
    if not fields:
        return draw.randbytes(3)
    parts = [bytes(field.raw) for field in fields]
    at = draw.randrange(len(fields))
    field = fields[at]
    if isinstance(field.value, memoryview) and depth < _DEEPEST and draw.random() < 0.8:
        inner = forged(draw, bytes(field.value), depth + 1)
        parts[at] = _varint(field.number << 3 | 2) + _varint(len(inner)) + inner
        return b"".join(parts)
    number = draw.choice((field.number, draw.randint(1, 30), 2**29 - 1))
    parts[at] = draw.choice(
        (
            b"",
            parts[at] * 2,
            parts[at] * 300,
            parts[draw.randrange(len(parts))],
            _varint(number << 3) + _varint(draw.choice(_NUMBERS)),
            _varint(number << 3 | 2) + _varint(3) + draw.randbytes(3),
            _varint(number << 3 | 2) + _varint(draw.choice(_NUMBERS)),
            _varint(number << 3 | 5) + draw.randbytes(4),
        )
    )
    return b"".join(parts)


def _with_entry(draw: random.Random, data: bytes, key: str) -> bytes:
    """One metadata entry with other values."""
    entries = onnx_wire.metadata(data)
    text = json.dumps(altered(draw, json.loads(entries[key])))
    return sealed(data, entries | {key: text})


def _rehashed(graph: bytes, entries: dict[str, str]) -> bytes:
    """A graph with the metadata of another, whose manifest now states this one's hash."""
    try:
        manifest = json.loads(entries[MANIFEST_KEY]) | {"graph_sha256": graph_sha256(graph)}
        return sealed(graph, entries | {MANIFEST_KEY: json.dumps(manifest)})
    except onnx_wire.MalformedModel:
        return graph


def _varint(value: int) -> bytes:
    value, encoded = value % (1 << 64), bytearray()
    while value >= 0x80:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*encoded, value])
