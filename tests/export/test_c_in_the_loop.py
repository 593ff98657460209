"""A folder of C flies as its package does, and needs no onnxruntime for it."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from made_packages import gantry_package
from needs import c_compiler

from export.c.kept import kept_c
from export.c.packaging import Wish, export_c
from runtime.predictor import inference_session
from wakedeploy.cli import main
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.package import Example, make_package, read_package, write_package
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

pytestmark = [c_compiler]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A package for the default rig and the same as C."""
    folder = tmp_path_factory.mktemp("site")
    package = gantry_package(default_lead_s(default_rig()), gain=-0.01)
    write_package(package, folder / "p.onnx")
    export_c(package, folder / "c", Wish())
    return folder


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory, monkeypatch):
    """Whatever is kept for the next flight is kept here."""
    cache = tmp_path_factory.getbasetemp() / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    return cache


def flown(site, package, *options) -> dict:
    told = site / "told.json"
    said = CliRunner().invoke(
        main,
        ["run-gantry", "--package", str(site / package), "--virtual", "--seconds", "6",
         "--json", str(told), *options],
    )  # fmt: skip
    assert said.exit_code == 0, said.output
    return json.loads(told.read_text())


@pytest.mark.whole
def test_two_flights_are_a_tenth_of_a_millimetre_apart_at_most(site):
    package, c = flown(site, "p.onnx"), flown(site, "c")
    assert abs(package["true_rmse_mm"] - c["true_rmse_mm"]) < 0.1
    assert package["ended"] == c["ended"] == "whole"
    assert package["ticks"] == c["ticks"]
    assert flown(site, "p.onnx", "--backend", "c") == c


@pytest.mark.whole
def test_a_flight_of_c_loads_no_onnxruntime(site):
    script = (
        "import sys; sys.modules['onnxruntime'] = None\n"
        "from wakedeploy.cli import main\n"
        f"main(['run-gantry', '--package', {str(site / 'c')!r}, '--virtual', '--seconds', '6'])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "whole" in done.stdout


# Each takes megabytes of a process that flies C at a rig, unasked for.
HEAVY = (
    "onnxruntime", "onnx", "torch", "numba", "pandas", "scipy", "matplotlib", "filterpy", "optuna",
    "mcap", "zstandard", "lz4", "rich", "numpy.random", "runtime.simulated",
    "runtime.virtual.process", "wakedeploy.physics.gantry", "wakedeploy.gap",
)  # fmt: skip


def test_a_process_that_flies_c_holds_nothing_that_a_flight_does_not_need(site):
    script = (
        "import sys, runtime.run\n"
        "from runtime.flyable import predictor_of, read_flyable\n"
        "from runtime.loop.loop import Loop, PERIOD_S\n"
        "from runtime.loop.prediction_worker import PredictionWorker\n"
        "from runtime.reference import hold_plan\n"
        "from wakedeploy.rig.file import default_rig\n"
        f"predictor = predictor_of(read_flyable(__import__('pathlib').Path({str(site / 'c')!r})))\n"
        "worker = PredictionWorker(predictor, PERIOD_S / 30, bounded=True)\n"
        "worker.wait_until_warm()\n"
        "Loop(default_rig(), None, None, hold_plan(default_rig(), 5.0, 0.3, 1500.0), worker)\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


def test_a_package_without_onnxruntime_is_told_what_to_do(site, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(UnusableInput, match=r"'\.\[onnx\]'.*--backend c"):
        inference_session(b"")


def test_the_c_of_a_package_is_written_once_unless_it_is_damaged(site):
    package = read_package(site / "p.onnx")
    source = kept_c(package).source
    written_ns = source.stat().st_mtime_ns
    assert kept_c(package).source.stat().st_mtime_ns == written_ns
    source.write_text(source.read_text().replace("float", "double", 1))
    assert kept_c(package).source == source
    assert source.stat().st_mtime_ns > written_ns
    assert not source.read_text().startswith("double")


def test_a_package_becomes_c_where_onnxruntime_is_not(site, tmp_path):
    """Its C is held against its graph in float64 and the rollout that travels with it."""
    (tmp_path / "sitecustomize.py").write_text(
        "import importlib.machinery as m\n"
        "found = m.PathFinder.find_spec\n"
        "m.PathFinder.find_spec = lambda name, *more: ("
        "None if name == 'onnxruntime' else found(name, *more))"
    )
    script = (
        "import sitecustomize\n"
        "from pathlib import Path\n"
        "from export.c.kept import kept_c\n"
        "from wakedeploy.core.package import read_package\n"
        f"print(kept_c(read_package(Path({str(site / 'p.onnx')!r}))).document.reference)"
    )
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "the package's graph in float64"


def test_c_that_does_not_do_what_training_recorded_is_not_written(site, tmp_path):
    good = read_package(site / "p.onnx")
    other = Example(0, good.example.observation, good.example.force + np.float32(1.0))
    write_package(make_package(good.model_bytes, good.manifest, other), tmp_path / "p.onnx")
    asked = ["run-gantry", "--package", str(tmp_path / "p.onnx"), "--backend", "c", "--virtual"]
    said = CliRunner().invoke(main, asked)
    assert said.exit_code == 1
    assert "but not the forces recorded in the package" in said.output
    assert "nothing was written" in said.output


def test_one_word_for_each_backend_that_cannot_be(site, monkeypatch, tmp_path):
    for options, words in (
        (["--baseline", "--backend", "c"], "belongs to --package"),
        (["--package", str(site / "c"), "--backend", "onnx"], "a folder of C flies as C"),
    ):
        said = CliRunner().invoke(main, ["run-gantry", *options, "--virtual"])
        assert said.exit_code == 2
        assert words in said.output
    monkeypatch.setenv("PATH", str(tmp_path))
    asked = ["run-gantry", "--package", str(site / "p.onnx"), "--backend", "c", "--virtual"]
    said = CliRunner().invoke(main, asked)
    assert said.exit_code == 2
    assert "no C compiler" in said.output


def test_an_altered_folder_does_not_fly(site, tmp_path):
    import shutil

    altered = tmp_path / "c"
    shutil.copytree(site / "c", altered)
    source = altered / "gru.c"
    source.write_text(source.read_text().replace("float", "double", 1))
    said = CliRunner().invoke(main, ["run-gantry", "--package", str(altered), "--virtual"])
    assert said.exit_code == 2
    assert "altered or damaged" in said.output
