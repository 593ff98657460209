"""The examples around a folder of C build; the one for this machine tells the package's forces."""

import subprocess
from pathlib import Path

import needs
import numpy as np
import pytest
from c_steps import model_of, written
from made_packages import package_of, parsed, sound, tiny_manifest

from export.c.packaging import Wish, export_c
from runtime.compiled.driven import driven
from runtime.predictor import PackagePredictor
from runtime.replay import rolled_out
from runtime.virtual.firmware_build import CORE
from wakedeploy.core.package import Package
from wakedeploy.domains.crazyflie import FORCE, OBSERVATION, RATE_HZ

EXAMPLES = Path(__file__).parents[2] / "examples" / "c"
BODY = """t (float[B, {d}] observation, float[B, {d}] state_leaky)
    => (float[B, {o}] force, float[B, {d}] next_state_leaky)
    {{ next_state_leaky = Add (state_leaky, observation)
       force = Gemm <transB: int = 1> (next_state_leaky, weight) }}"""


def channel(name: str, unit: str) -> dict[str, object]:
    return {"name": name, "unit": unit, "min": -1.0, "max": 1.0}


def summing(inputs: int = 2, outputs: int = 2, **changes: object) -> Package:
    weight = np.linspace(-1.0, 1.0, inputs * outputs, dtype=np.float32).reshape(outputs, inputs)
    body = BODY.format(d=inputs, o=outputs)
    states = {"leaky": {"shape": [inputs], "initial": 0.0}}
    manifest = tiny_manifest("state", memory={"kind": "state", "states": states}, **changes)
    return sound(package_of(parsed(body, {"weight": weight}).SerializeToString(), manifest))


@needs.c_compiler
def test_the_program_for_linux_prints_the_packages_forces(tmp_path):
    package = summing()
    export_c(package, tmp_path / "wake_c", Wish(name="wake"))
    program = tmp_path / "linux"
    subprocess.run(["cp", "-r", EXAMPLES / "linux", program], check=True)
    subprocess.run(["make", "-s", f"MODEL={tmp_path / 'wake_c'}"], cwd=program, check=True)
    series = driven(package.manifest, 20)
    lines = [" ".join(map(str, now)) for now in series]
    text = "\n".join([*lines, "reset", *lines]) + "\n"
    said = subprocess.run(
        [program / "forces"], input=text, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    full = package.manifest.warm_up_steps
    assert [line.startswith("#") for line in said[:20]] == [i + 1 < full for i in range(20)]
    told = np.array([line.removeprefix("# ").split() for line in said], float)
    expected = rolled_out(PackagePredictor(package), series)
    assert np.allclose(told[:20], expected, atol=1e-5)
    assert np.array_equal(told[:20], told[20:])
    wrong = subprocess.run([program / "forces"], input="1 2 x\n", capture_output=True, text=True)
    assert (wrong.returncode, wrong.stderr) == (2, "line 1: not 2 numbers\n")


@needs.arm
def test_the_app_for_the_crazyflie_compiles_for_its_processor(tmp_path):
    package = summing(
        12, 3, rate_hz=RATE_HZ,
        observation=[channel(c.name, c.unit) for c in OBSERVATION],
        force=[channel(c.name, c.unit) for c in FORCE],
    )  # fmt: skip
    written(model_of(package, name="wake"), tmp_path)
    app = tmp_path / "crazyflie"
    subprocess.run(["cp", "-r", EXAMPLES / "crazyflie", app], check=True)
    done = subprocess.run(
        ["make", "check", f"MODEL={tmp_path}"], cwd=app, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    written(model_of(summing(), name="wake"), tmp_path)
    other = subprocess.run(
        ["make", "check", f"MODEL={tmp_path}"], cwd=app, capture_output=True, text=True
    )
    assert "package_is_for_the_crazyflie" in other.stderr, "another domain's package is refused"


def test_the_app_for_the_crazyflie_finds_its_settings_from_any_folder(tmp_path):
    """`make -C` leaves PWD at the folder where it was called."""
    rules = tmp_path / "tools" / "make" / "oot.mk"
    rules.parent.mkdir(parents=True)
    rules.write_text("all:\n\t@test -f $(OOT_CONFIG)\n")
    app = EXAMPLES / "crazyflie"
    done = subprocess.run(
        ["make", "-s", "-C", app, f"CRAZYFLIE_BASE={tmp_path}"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@needs.avr_compiler
def test_the_arduino_library_compiles_for_an_uno(tmp_path):
    written(model_of(summing(), name="wake"), tmp_path)
    (tmp_path / "README.md").write_text("")
    library = tmp_path / "Wake"
    command = ["sh", EXAMPLES / "arduino" / "library.sh", tmp_path, library]
    subprocess.run(command, check=True)
    assert subprocess.run(command, capture_output=True).returncode == 2, "nothing is written over"
    flags = [
        *("-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_ARCH_AVR"),
        *(
            "-Os",
            "-Wall",
            "-Wextra",
            "-I",
            CORE / "cores/arduino",
            "-I",
            CORE / "variants/standard",
        ),
        *("-DDECIMAL_DIG=__DECIMAL_DIG__", "-I", library / "src", "-c", "-o", "/dev/null"),
    ]
    sketch = library / "examples" / "Wake" / "Wake.ino"
    sources = {
        "avr-g++": ["-std=gnu++11", "-include", "Arduino.h", "-x", "c++", sketch],
        "avr-gcc": ["-std=gnu99", "-Werror", library / "src" / "wake.c"],
    }
    for compiler, source in sources.items():
        done = subprocess.run(
            list(map(str, [compiler, *flags, *source])), capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr


@needs.avr_compiler
def test_constants_stay_in_flash_on_avr(tmp_path):
    path = written(model_of(summing(12, 3, observation=[
        {"name": f"c{i}", "unit": "1", "min": -1.0, "max": 1.0} for i in range(12)
    ], force=[{"name": f"f{i}", "unit": "N", "min": -1.0, "max": 1.0} for i in range(3)]),
        name="wake"), tmp_path)  # fmt: skip
    out = tmp_path / "wake.o"
    subprocess.run(
        [
            "avr-gcc",
            "-mmcu=atmega328p",
            "-std=gnu99",
            "-Os",
            "-fdata-sections",
            "-c",
            path,
            "-o",
            out,
        ],
        check=True,
    )
    told = subprocess.run(
        ["avr-objdump", "-h", out], capture_output=True, text=True, check=True
    ).stdout
    assert ".progmem.data.wake_manifest" not in told
    assert ".progmem.data.weight" in told


@pytest.mark.parametrize("name", ["linux", "crazyflie", "arduino"])
def test_the_page_names_every_example(name):
    assert f"[{name}]({name})" in (EXAMPLES / "README.md").read_text()
