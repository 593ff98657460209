"""A folder of C flies as its package does, and needs no onnxruntime for it."""

import json
import subprocess
import sys

import pytest
from click.testing import CliRunner
from made_packages import gantry_package
from needs import c_compiler

from export.c.packaging import Wish, export_c
from runtime.predictor import inference_session
from wakedeploy.cli import main
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.package import write_package
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


def flown(site, package) -> dict:
    told = site / "told.json"
    said = CliRunner().invoke(
        main,
        ["run-gantry", "--package", str(site / package), "--virtual", "--seconds", "6",
         "--json", str(told)],
    )  # fmt: skip
    assert said.exit_code == 0, said.output
    return json.loads(told.read_text())


def test_two_flights_are_a_tenth_of_a_millimetre_apart_at_most(site):
    package, c = flown(site, "p.onnx"), flown(site, "c")
    assert abs(package["true_rmse_mm"] - c["true_rmse_mm"]) < 0.1
    assert package["ended"] == c["ended"] == "whole"
    assert package["ticks"] == c["ticks"]


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
        "from runtime.loop.prediction import PredictionWorker\n"
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
    with pytest.raises(UnusableInput, match="as C"):
        inference_session(b"")


def test_an_altered_folder_does_not_fly(site, tmp_path):
    import shutil

    altered = tmp_path / "c"
    shutil.copytree(site / "c", altered)
    source = altered / "gru.c"
    source.write_text(source.read_text().replace("float", "double", 1))
    said = CliRunner().invoke(main, ["run-gantry", "--package", str(altered), "--virtual"])
    assert said.exit_code == 2
    assert "altered or damaged" in said.output
