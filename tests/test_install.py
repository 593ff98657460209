"""The wheel and a base install: what a Raspberry Pi gets, in an environment of its own."""

import json
import os
import subprocess
import sys
import venv
import zipfile
from collections.abc import Callable
from email import message_from_string as metadata_of
from pathlib import Path

import pytest
from made_packages import gantry_package, sound
from needs import c_compiler

from wakedeploy.core.package import Package, write_package
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

pytestmark = [pytest.mark.slow, pytest.mark.install]

ROOT = Path(__file__).parents[1]
PACKAGES = {"wakedeploy", "trainers", "export", "runtime"}
ABSENT = ["torch", "onnx", "onnxruntime", "onnxscript", "optuna", "numba", "pandas", "safetensors"]


def end(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a program away from the project's folder, however it ends."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    return subprocess.run(
        [str(part) for part in command],
        cwd=cwd, env=environment, text=True, check=False, timeout=600,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


def run(*command: str | Path, cwd: Path, status: int = 0) -> str:
    """A program's output, once it ended as expected."""
    ended = end(*command, cwd=cwd)
    assert ended.returncode == status, f"{command} ended with {ended.returncode}:\n{ended.stdout}"
    return ended.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of the files that git tracks: what stands in `build/` cannot leak into it."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    tracked = run("git", "ls-files", "-z", cwd=ROOT).split("\0")
    for name in filter(None, tracked):
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    run(*pip, "--wheel-dir", folder, source, cwd=folder)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def base(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment with the wheel and no extra, versions as locked."""
    return installed(str(wheel), tmp_path_factory.mktemp("base") / "venv")


@pytest.fixture(scope="module")
def with_onnx(wheel: Path, base: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with the extra that flies packages; what the base install needs is there already."""
    folder = tmp_path_factory.mktemp("onnx") / "venv"
    (there,) = base.parent.glob("lib/*/site-packages")
    for path in there.rglob("*"):
        within = path.relative_to(there)
        is_ours = within.parts[0] in PACKAGES or within.parts[0].startswith("wakedeploy-")
        if path.is_file() and not is_ours:
            copy = folder / there.relative_to(base.parent) / within
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.hardlink_to(path)
    return installed(f"{wheel}[onnx]", folder)


def installed(what: str, folder: Path) -> Path:
    """The programs of a new environment that pip installs this into."""
    venv.create(folder)
    # The pip that runs this installs there, and what is never imported is not compiled: both save
    # seconds and change nothing of what is installed.
    pip = [sys.executable, "-m", "pip", "--python", folder / "bin" / "python"]
    constraints = ("--constraint", ROOT / "constraints.txt")
    run(*pip, "install", "--quiet", "--no-compile", *constraints, what, cwd=folder)
    return folder / "bin"


def test_the_wheel_holds_the_four_packages_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    tops = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert tops == PACKAGES
    kinds = {Path(name).suffix for name in names if ".dist-info/" not in name}
    assert kinds == {".py", ".pyi", ".toml", ".json", ".typed", ".html", ".css", ".js", ".txt"}


def test_the_wheel_holds_the_licence_and_names_it(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = [name for name in archive.namelist() if name.endswith("/METADATA")]
        said = metadata_of(archive.read(metadata).decode())
        licence = archive.read(f"{Path(metadata).parent}/licenses/LICENSE")
    assert licence == (ROOT / "LICENSE").read_bytes()
    assert said["License-Expression"] == "Apache-2.0"
    assert said["Author"] == "The wakedeploy authors"


def test_every_module_is_in_the_wheel(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if name.endswith(".py")}
    tracked = run("git", "ls-files", *PACKAGES, cwd=ROOT).split()
    assert packed == {name for name in tracked if name.endswith(".py") and (ROOT / name).exists()}


def test_the_base_install_is_small(base: Path, tmp_path: Path) -> None:
    code = f"import importlib.util as u; print([n for n in {ABSENT} if u.find_spec(n)])"
    assert run(base / "python", "-c", code, cwd=tmp_path).strip() == "[]"


@pytest.mark.parametrize(
    "command",
    ["", "data make gantry", "check", "run-gantry", "bench latency", "log show", "log export",
     "log smooth", "rig show", "doctor"],
)  # fmt: skip
def test_each_command_of_the_pi_explains_itself(command: str, base: Path, tmp_path: Path) -> None:
    assert "Usage:" in run(base / "wakedeploy", *command.split(), "--help", cwd=tmp_path)


def test_the_doctor_finds_the_base_install_sound(base: Path, tmp_path: Path) -> None:
    run(base / "wakedeploy", "doctor", "--json", "doctor.json", cwd=tmp_path)
    assert json.loads((tmp_path / "doctor.json").read_text())["ok"]


def test_training_says_what_to_install(base: Path, tmp_path: Path) -> None:
    run(
        base / "wakedeploy",
        "data",
        "make",
        "gantry",
        "--out",
        "set",
        "--minutes",
        "1",
        cwd=tmp_path,
    )
    train = [base / "wakedeploy", "train", "--data", "set", "--arch", "gru", "--out", "runs"]
    told = run(*train, cwd=tmp_path, status=2)
    assert "-m pip install --constraint constraints.txt '.[train]'" in told
    assert "Traceback" not in told


def test_the_virtual_gantry_flies_and_its_log_is_read(base: Path, tmp_path: Path) -> None:
    default_rig().changed(disturbance={"rest_s": 0.2}).write(tmp_path / "rig.toml")
    fly = ["run-gantry", "--baseline", "--virtual", "--rig", "rig.toml", "--seconds", "6"]
    run(base / "wakedeploy", *fly, "--log", "flight.mcap", cwd=tmp_path)
    run(base / "wakedeploy", "log", "export", "flight.mcap", "--out", "flight.csv", cwd=tmp_path)
    assert (tmp_path / "flight.csv").read_text().startswith("tick,t_s,range_m")


@pytest.fixture
def package(tiny_package: Callable[..., Package], tmp_path: Path) -> Path:
    """A package whose example rollout is what its graph computes here."""
    write_package(sound(tiny_package("state")), tmp_path / "tiny.onnx")
    return tmp_path / "tiny.onnx"


def test_a_base_install_says_what_packages_need(base: Path, package: Path) -> None:
    told = run(base / "wakedeploy", "check", package, cwd=package.parent, status=2)
    assert "-m pip install --constraint constraints.txt '.[onnx]'" in told
    assert "Traceback" not in told


@c_compiler
def test_a_base_install_makes_c_of_a_package_checks_and_flies_it(
    base: Path, package: Path, tmp_path: Path
) -> None:
    export = [base / "wakedeploy", "export", "--package", package, "--c", "c"]
    run(*export, cwd=tmp_path)
    run(base / "wakedeploy", "check", "c", cwd=tmp_path)
    default_rig().changed(disturbance={"rest_s": 0.2}).write(tmp_path / "rig.toml")
    flown = gantry_package(default_lead_s(default_rig()), gain=-0.01)
    write_package(flown, tmp_path / "gantry.onnx")
    fly = ["run-gantry", "--package", "gantry.onnx", "--backend", "c", "--virtual"]
    told = run(base / "wakedeploy", *fly, "--rig", "rig.toml", "--seconds", "6", cwd=tmp_path)
    assert "whole" in told


def test_a_package_is_checked_without_torch(with_onnx: Path, package: Path) -> None:
    check = [with_onnx / "wakedeploy", "check", package, "--json", "check.json"]
    run(*check, cwd=package.parent)
    assert json.loads((package.parent / "check.json").read_text())["ok"]


def test_a_package_is_timed_without_torch(with_onnx: Path, package: Path) -> None:
    """Timed, and the exit status is the verdict's: which of the two depends on the machine."""
    bench = [with_onnx / "wakedeploy", "bench", "latency", package, "--ticks", "64"]
    ended = end(*bench, "--json", "bench.json", cwd=package.parent)
    (row,) = json.loads((package.parent / "bench.json").read_text())["rows"]
    assert 0.0 < row["p50_ms"] <= row["max_ms"]
    assert ended.returncode == (0 if row["within_budget"] else 1), ended.stdout
