"""Thousands of damaged and forged packages: a sentence or a package, at once, and nothing else."""

import copy
import json
import random
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_packages import sound

from wakedeploy import onnx_wire
from wakedeploy.errors import UnusableInput
from wakedeploy.package import (
    EXAMPLE_KEY,
    MANIFEST_KEY,
    Package,
    make_package,
    package_from_bytes,
)

ROOT = Path(__file__).parents[2]
SLOWEST_S = 2.0
MOST_MIB = 64
KINDS = ("none", "window", "state")
SEEDS = st.integers(0, 2**32)
NUMBERS = [0, 1, -1, 2, 7, 127, 128, 2**31, 2**32, 2**32 + 1, 2**63 - 1, 2**63, 2**64 - 1, 10**12]
VALUES = [
    *NUMBERS, 10**300, -(10**300), 1e308, -1e308, 5e-324, float("nan"), float("inf"), 0.5, None,
    True, False, "", "x", "x" * 10_000, "\x1b[2J\n\u202e", "a" * 64, "0" * 64, [], {}, [[]],
    [1] * 1000, {"": {}}, ["x"] * 1000, "window", "state", "none",
]  # fmt: skip


@pytest.fixture(scope="module")
def whole(tiny_package) -> dict[str, Package]:
    return {kind: sound(tiny_package(kind)) for kind in KINDS}


def read(data: bytes) -> Package | None:
    """The package, or None where it is refused as it should be."""
    began_s, before_kib = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    package = None
    try:
        package = package_from_bytes(data, "p.onnx")
    except UnusableInput as error:
        text = str(error)
        assert text.isprintable()
        assert text.startswith("p.onnx: ")
        assert len(text) < 700
    assert time.monotonic() - began_s < SLOWEST_S
    after_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert after_kib - before_kib < MOST_MIB * 1024
    return package


def with_damage(draw: random.Random, data: bytes) -> bytes:
    """Some bytes flipped, cut, doubled, moved or put in."""
    for _ in range(draw.randint(1, 4)):
        a, b = sorted(draw.randrange(len(data) + 1) for _ in range(2))
        b = min(b, a + draw.choice([1, 4, 64, len(data)]))
        flipped = bytes(byte ^ draw.randrange(256) for byte in data[a : a + 2])
        data = (
            draw.choice(
                [
                    data[:a] + flipped + data[a + 2 :],
                    data[:a],
                    data[:a] + data[b:],
                    data[:b] + data[a:b] * draw.choice([1, 3]) + data[b:],
                    data[b:] + data[:a],
                    data[:a] + draw.randbytes(draw.choice([1, 9, 100])) + data[a:],
                ]
            )
            or b"\x00"
        )
    return data


def varint(value: int) -> bytes:
    value, told = value % (1 << 64), bytearray()
    while value >= 0x80:
        told.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*told, value])


def forged(draw: random.Random, message: bytes, depth: int = 0) -> bytes:
    """A message in which one field, at whatever depth, is replaced, doubled or left out."""
    try:
        fields = list(onnx_wire.fields(message))
    except onnx_wire.MalformedModel:
        return with_damage(draw, message)
    if not fields:
        return draw.randbytes(3)
    parts = [bytes(field.raw) for field in fields]
    at = draw.randrange(len(fields))
    field = fields[at]
    if isinstance(field.value, memoryview) and depth < 6 and draw.random() < 0.8:
        inner = forged(draw, bytes(field.value), depth + 1)
        parts[at] = varint(field.number << 3 | 2) + varint(len(inner)) + inner
        return b"".join(parts)
    number = draw.choice([field.number, draw.randint(1, 30), 2**29 - 1])
    other = parts[draw.randrange(len(parts))]
    parts[at] = draw.choice(
        [
            b"",
            parts[at] * 2,
            parts[at] * 300,
            other,
            varint(number << 3) + varint(draw.choice(NUMBERS)),
            varint(number << 3 | 2) + varint(3) + draw.randbytes(3),
            varint(number << 3 | 2) + varint(draw.choice(NUMBERS)),
            varint(number << 3 | 5) + draw.randbytes(4),
        ]
    )
    return b"".join(parts)


def places(document, path=()):
    """Every place in a JSON document, as its keys and indices."""
    if path:
        yield path
    children = document if isinstance(document, dict) else {}
    if isinstance(document, list):
        children = dict(enumerate(document))
    for key, child in children.items():
        yield from places(child, (*path, key))


def with_other_values(draw: random.Random, text: str) -> str:
    """A JSON document with some values replaced, left out, or put where none belongs."""
    document = json.loads(text)
    for _ in range(draw.randint(1, 2)):
        *path, last = draw.choice(list(places(document)))
        parent = document
        for key in path:
            parent = parent[key]
        change = draw.random()
        if change < 0.75:
            parent[last] = copy.deepcopy(draw.choice(VALUES))
        elif change < 0.9:
            del parent[last]
        elif isinstance(parent, dict):
            parent[draw.choice(["extra", "\x00", "k" * 5000, "min"])] = None
    return json.dumps(document)


def in_entry(key: str) -> Callable[[random.Random, Package], bytes]:
    def damaged(draw: random.Random, package: Package) -> bytes:
        entries = onnx_wire.metadata(package.model_bytes)
        text = with_other_values(draw, entries[key])
        return onnx_wire.with_metadata(package.model_bytes, entries | {key: text})

    return damaged


def in_bytes(draw: random.Random, package: Package) -> bytes:
    return with_damage(draw, package.model_bytes)


def hashed(draw: random.Random, package: Package, change: Callable) -> bytes:
    """The graph changed, and its hash made to fit."""
    model = change(draw, onnx_wire.without_metadata(package.model_bytes))
    try:
        return make_package(model, package.manifest, package.example).model_bytes
    except onnx_wire.MalformedModel:
        return model


def in_hashed_bytes(draw: random.Random, package: Package) -> bytes:
    return hashed(draw, package, with_damage)


def in_hashed_fields(draw: random.Random, package: Package) -> bytes:
    return hashed(draw, package, forged)


WAYS = [in_bytes, in_hashed_bytes, in_hashed_fields, in_entry(MANIFEST_KEY), in_entry(EXAMPLE_KEY)]
NAMES = ["bytes", "bytes under the hash", "fields under the hash", "manifest", "example"]


@pytest.mark.parametrize("way", WAYS, ids=NAMES)
def test_whatever_is_changed_is_refused_in_a_sentence_or_read(way, whole):
    @settings(max_examples=800)
    @given(seed=SEEDS)
    def changed(seed):
        draw = random.Random(seed)
        read(way(draw, whole[draw.choice(KINDS)]))

    changed()


RUN_THEM = """
import sys
from runtime.replay import replay
from wakedeploy.errors import CheckFailed, UnusableInput
from wakedeploy.package import package_from_bytes
for path in sys.argv[1:]:
    try:
        replay(package_from_bytes(open(path, "rb").read(), path))
        print("passed")
    except (CheckFailed, UnusableInput) as error:
        print("refused:", error)
"""


def test_what_is_read_of_forged_graphs_runs_or_fails_in_a_sentence(whole, tmp_path):
    """In a process of its own, as a check runs it; none of them kills it."""
    read_all = []
    for seed in range(4000):
        draw = random.Random(seed)
        data = in_hashed_fields(draw, whole[draw.choice(KINDS)])
        if read(data) is not None and data not in read_all:
            read_all.append(data)
        if len(read_all) == 40:
            break
    for number, data in enumerate(read_all):
        (tmp_path / f"{number}.onnx").write_bytes(data)
    files = [str(path) for path in sorted(tmp_path.iterdir())]
    ended = subprocess.run(
        [sys.executable, "-c", RUN_THEM, *files],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    said = ended.stdout.splitlines()
    assert len(said) == len(files) >= 20
    assert sum(line.startswith("refused:") for line in said) >= 3
