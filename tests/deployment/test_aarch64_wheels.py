"""What the script that looks for a Pi's wheels takes for an answer, and for none."""

import importlib.util
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("wheels", ROOT / "deployment" / "aarch64_wheels.py")
wheels = importlib.util.module_from_spec(spec)
spec.loader.exec_module(wheels)


@pytest.mark.parametrize(
    ("marker", "applies"),
    [
        ("platform_machine == 'aarch64'", True),
        ("platform_machine == 'x86_64'", False),
        ("python_version < '3.12'", True),
        ("sys_platform == 'win32'", False),
        ("extra == 'i2c'", True),
        ("extra == 'tests'", False),
    ],
)
def test_markers_are_judged_as_on_the_pi_whatever_this_machine_is(marker, applies):
    found = wheels.applying([f"library; {marker}"], {"i2c"}, "3.11")
    assert bool(found) is applies


def test_what_has_no_wheel_is_missing_unless_only_the_rig_needs_it():
    some = {"numpy": None, "pyusb": None, "click": "click-1-py3-none-any.whl"}
    assert wheels.Found("3.11", some, {"pyusb"}).missing() == ["numpy"]


@pytest.mark.slow
def test_pip_is_asked_for_the_pi_s_wheels_at_the_locked_versions(monkeypatch):
    constraints = ROOT / "constraints.txt"
    asked = [Requirement("numpy>=2.0"), Requirement("click>=8.1")]
    found = wheels.look(asked, "3.12", constraints)
    locked = [line for line in constraints.read_text().splitlines() if line.startswith("numpy==")]
    assert found["numpy"][0].startswith(locked[0].replace("==", "-") + "-cp312-")
    assert found["numpy"][0].endswith("aarch64.whl")
    monkeypatch.setattr(wheels, "PLATFORMS", ("manylinux_2_5_aarch64",))  # nobody builds for it
    assert set(wheels.look(asked, "3.12", constraints)) == {"click"}


@pytest.mark.slow
@pytest.mark.parametrize("python", wheels.PYTHONS)
def test_all_that_the_loop_needs_has_a_wheel_for_the_pi(python):
    found = wheels.search(python)
    assert {"numpy", "onnxruntime", "click"} <= set(found.wheels) - found.rig_only
    assert "adafruit-circuitpython-vl53l0x" in found.rig_only
    assert found.missing() == []
