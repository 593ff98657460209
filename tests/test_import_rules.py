"""The import rules cover every module: a new one is ground, or stands above it, by decision."""

import ast
import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
ABOVE_THE_GROUND = {
    "cli",
    "domains",
    "gap",
    "study",
    "sweep",
    "__init__",
    "__main__",
    "__pycache__",
}


def test_every_module_of_the_ground_is_named_in_its_rule() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    ground, *_ = settings["tool"]["importlinter"]["contracts"]
    folder = ROOT / "wakedeploy"
    modules = {p.stem for p in folder.iterdir() if p.suffix == ".py" or p.is_dir()}
    named = {name.removeprefix("wakedeploy.") for name in ground["source_modules"]}
    assert named == modules - ABOVE_THE_GROUND


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
    stated = {{"pyserial": "serial"}.get(name, name) for name in stated}
    own = {"wakedeploy", "trainers", "export", "runtime"}
    breakout = {"board", "busio", "adafruit_vl53l0x"}  # with [rig]
    modules = [*(ROOT / "runtime").rglob("*.py"), *(ROOT / "wakedeploy/domains").rglob("*.py")]
    used = {name for path in modules for name in imported(path)}
    assert used - own - breakout - set(sys.stdlib_module_names) <= stated
