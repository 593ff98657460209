"""The import rules cover every folder, and the base install has what the runtime imports."""

import ast
import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_every_folder_has_its_layer() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    layers, *_ = settings["tool"]["importlinter"]["contracts"]
    named = {name for layer in layers["layers"] for name in re.split(r" [|:] ", layer)}
    folders = {f"wakedeploy.{p.parent.name}" for p in (ROOT / "wakedeploy").glob("*/__init__.py")}
    assert named == folders | {"trainers", "export", "runtime"}


def test_no_module_lies_outside_the_folders() -> None:
    assert {p.name for p in (ROOT / "wakedeploy").glob("*.py")} == {"__init__.py", "__main__.py"}


def imported(path: Path) -> set[str]:
    """Top-level names of what a module imports, at its top or inside a function."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {name.name.split(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(str(node.module).split(".")[0])
    return found


def test_the_base_install_declares_every_library_that_the_runtime_imports() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    stated = {re.split(r"[<>=]", line)[0] for line in project["dependencies"]}
    stated = {{"pyserial": "serial", "tomli-w": "tomli_w"}.get(name, name) for name in stated}
    own = {"wakedeploy", "trainers", "export", "runtime"}
    breakout = {"board", "busio", "adafruit_vl53l0x"}  # with [rig]
    packages = {"onnxruntime"}  # with [onnx], imported with the first session
    logs = {"h5py"}  # with [hdf5], in a process of its own
    modules = [*(ROOT / "runtime").rglob("*.py"), *(ROOT / "wakedeploy/domains").rglob("*.py")]
    used = {name for path in modules for name in imported(path)}
    assert used - own - breakout - packages - logs - set(sys.stdlib_module_names) <= stated
