"""What the C of a package computes, beside the training-time forward, torch and onnxruntime."""

import functools
import subprocess
from pathlib import Path

import numpy as np
import pytest
from c_steps import Stepped, model_of, written
from made_packages import package_of, parsed, tiny_manifest, tiny_model
from needs import c_compiler, clang

from export.c.interpreter import Interpreter
from export.example import rollout
from export.limits import limited
from runtime.compiled.compiler import STRICT
from runtime.compiled.driven import driven
from runtime.predictor import PackagePredictor
from runtime.replay import compare, rolled_out
from trainers.build import ARCHITECTURES
from wakedeploy.core.onnx_graph import read_graph

STEPS = 300
pytestmark = [c_compiler]


@pytest.fixture(params=ARCHITECTURES)
def exported(request, exported_arch):
    return exported_arch(request.param)


def tiny(kind: str):
    return package_of(tiny_model(kind), tiny_manifest(kind))


def test_each_architecture_tells_in_c_what_it_told_in_training(exported, episodes, tmp_path):
    stepped = Stepped(model_of(exported.package), tmp_path)
    series = episodes[0].observation[:STEPS]
    forward = limited(rollout(exported.predictor, series), exported.package.manifest.force)
    assert compare(stepped.rollout(series), forward).max_rel <= 3e-6
    went_on = stepped.rollout(episodes[1].observation[:STEPS])
    stepped.reset()
    assert np.array_equal(stepped.rollout(series), Stepped(
        model_of(exported.package), tmp_path).rollout(series))  # fmt: skip
    assert not np.array_equal(went_on, stepped.rollout(series)[:STEPS])


@pytest.mark.parametrize("kind", ["float16", "int8"])
def test_rounded_weights_are_the_only_thing_that_rounding_changes(
    exported_arch, episodes, tmp_path, kind
):
    package = exported_arch("gru").package
    model, graph = model_of(package, kind), read_graph(package.model_bytes)
    rounded = {m.tensor: m.rounded(kind) for m in model.program.matrices}
    series = episodes[0].observation[:STEPS]
    exact = Interpreter(graph, package.manifest, rounded).rollout(series)
    given = Stepped(model, tmp_path).rollout(series)
    assert compare(given, exact.astype(np.float32)).max_rel <= 3e-6
    plain = Interpreter(graph, package.manifest).rollout(series)
    assert compare(exact, plain).max_rel > 1e-5, "rounding does change something"


def test_float64_and_onnxruntime_read_the_graph_alike(exported, episodes):
    series = episodes[0].observation[:100]
    exact = Interpreter(read_graph(exported.package.model_bytes), exported.package.manifest)
    told = rolled_out(PackagePredictor(exported.package), series)
    assert compare(told, exact.rollout(series).astype(np.float32)).max_rel <= 1e-5


@pytest.mark.parametrize("kind", ["none", "window", "state"])
def test_graphs_that_can_be_computed_by_hand_come_out_the_same(kind, tmp_path):
    package = tiny(kind)
    series = driven(package.manifest, 50)
    told = rolled_out(PackagePredictor(package), series)
    assert np.allclose(Stepped(model_of(package), tmp_path).rollout(series), told, atol=1e-7)


def test_a_queue_that_starts_with_different_frames_is_kept_as_it_is(tmp_path):
    """No ring: its initial values are not one number."""
    body = """t (float[B, 2] observation, float[B, 2, 3] state_past) =>
        (float[B, 2] force, float[B, 2, 3] next_state_past)
        { frame = Unsqueeze (observation, two)
          context = Concat <axis: int = 2> (state_past, frame)
          next_state_past = Slice (context, one, four, two, one)
          force = ReduceSum <keepdims: int = 0> (context, two) }"""
    constants = {"one": np.array([1]), "two": np.array([2]), "four": np.array([4])}
    past = {"shape": [2, 3], "initial": [1.0, 2.0, 3.0, -1.0, 0.5, 0.25]}
    manifest = tiny_manifest("state", memory={"kind": "state", "states": {"past": past}})
    package = package_of(parsed(body, constants).SerializeToString(), manifest)
    series = driven(manifest, 20)
    told = rolled_out(PackagePredictor(package), series)
    assert np.allclose(Stepped(model_of(package), tmp_path).rollout(series), told, atol=1e-6)


@pytest.mark.parametrize("arch", ["gru", "agile-mlp", "tcn"])
def test_an_input_that_is_no_number_gives_a_force_that_is_none(exported_arch, tmp_path, arch):
    stepped = Stepped(model_of(exported_arch(arch).package), tmp_path)
    assert np.isnan(stepped.rollout(np.full((1, 8), np.nan))).all()


def test_rings_and_windows_are_not_copied_and_a_gru_needs_little_ram(exported_arch):
    tcn, gru = (model_of(exported_arch(arch).package).program for arch in ("tcn", "gru"))
    states = exported_arch("tcn").package.manifest.memory.states.values()
    assert tcn.state_bytes == 4 * (sum(s.size for s in states) + len(states))
    assert tcn.room_bytes < 2000
    assert gru.state_bytes + gru.room_bytes < 4096


def test_a_reservoir_is_kept_by_its_entries(exported_arch):
    package = exported_arch("esn").package
    (sparse,) = [m for m in model_of(package).program.matrices if m.is_sparse]
    entries = np.count_nonzero(sparse.weights)
    assert sparse.flash_bytes("float32") == 6 * entries + 2 * 1000 < 0.2 * 4 * 1000**2


@pytest.fixture(scope="module")
def sources(exported_arch, tmp_path_factory):
    """A function of how weights are kept: the C of all eight, written once for all compilers."""

    @functools.cache
    def of(kind: str) -> list[Path]:
        packages = [exported_arch(arch).package for arch in ARCHITECTURES]
        folders = [tmp_path_factory.mktemp(kind) for _ in packages]
        models = [model_of(package, kind) for package in packages]
        return [written(*each) for each in zip(models, folders, strict=True)]

    return of


@pytest.mark.whole
@pytest.mark.parametrize("compiler", [pytest.param("gcc"), pytest.param("clang", marks=clang)])
@pytest.mark.parametrize("kind", ["float32", "float16", "int8"])
def test_it_compiles_without_a_warning(sources, compiler, kind):
    for path in sources(kind):
        warned = (*STRICT, "-Wshadow", "-Wpedantic", "-Wno-overlength-strings")
        done = subprocess.run(
            [compiler, *warned, "-fsyntax-only", path], capture_output=True, text=True
        )
        assert done.stderr == ""
        as_cpp = ["g++" if compiler == "gcc" else "clang++", "-x", "c++", "-fsyntax-only"]
        header = subprocess.run([*as_cpp, path.with_suffix(".h")], capture_output=True, text=True)
        assert header.stderr.replace("#pragma once in main file", "") == "", "C++ takes the header"
