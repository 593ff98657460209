"""Thousands of damaged and forged packages: a sentence or a package, at once, and nothing else."""

import random
import resource
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_packages import sound

from benchmarks.fuzz.packages import WAYS, in_hashed_fields
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.package import Package, package_from_bytes

ROOT = Path(__file__).parents[2]
SLOWEST_S = 2.0
MOST_MIB = 64
KINDS = ("none", "window", "state")
SEEDS = st.integers(0, 2**32)


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


@pytest.mark.whole
@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_whatever_is_changed_is_refused_in_a_sentence_or_read(way, whole):
    @settings(max_examples=800)
    @given(seed=SEEDS)
    def changed(seed):
        draw = random.Random(seed)
        data = whole[draw.choice(KINDS)].model_bytes
        read(way(draw, data, data))

    changed()


RUN_THEM = """
import sys
from runtime.replay import replay
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.package import package_from_bytes
for path in sys.argv[1:]:
    try:
        replay(package_from_bytes(open(path, "rb").read(), path))
        print("passed")
    except (CheckFailed, UnusableInput) as error:
        print("refused:", error)
"""


@pytest.mark.whole
def test_what_is_read_of_forged_graphs_runs_or_fails_in_a_sentence(whole, tmp_path):
    """In a process of its own, as a check runs it; none of them kills it."""
    read_all = []
    for seed in range(4000):
        draw = random.Random(seed)
        model = whole[draw.choice(KINDS)].model_bytes
        data = in_hashed_fields(draw, model, model)
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
