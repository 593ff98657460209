"""The import rules cover every folder, no modules import each other, the base install suffices."""

import ast
import graphlib
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("wakedeploy", "trainers", "export", "runtime")


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


def modules_of(root: Path) -> dict[str, Path]:
    """The modules of the packages below a folder, by name; a package's is its `__init__`."""
    found = {}
    for path in (p for package in PACKAGES for p in (root / package).rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_in(node: ast.AST) -> Iterator[str]:
    """What is imported anywhere below a node of a module, but for type checkers alone."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        assert node.level == 0, "relative imports are not followed"
        yield from (f"{node.module}.{alias.name}" for alias in node.names)
    elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        for child in node.orelse:
            yield from imports_in(child)
    else:
        for child in ast.iter_child_nodes(node):
            yield from imports_in(child)


def circle(root: Path) -> list[str]:
    """Modules of which each imports the next, and the last is the first; none where none do."""
    modules = modules_of(root)
    imports = {}
    for name, path in modules.items():
        asked = imports_in(ast.parse(path.read_text("utf-8")))
        # A name that is no module is one of its module's own.
        found = {full if full in modules else full.rpartition(".")[0] for full in asked}
        imports[name] = found & modules.keys()
    try:
        graphlib.TopologicalSorter(imports).prepare()
    except graphlib.CycleError as error:
        return list(reversed(error.args[1]))
    return []


def test_no_modules_import_each_other() -> None:
    assert " imports ".join(circle(ROOT)) == ""


@pytest.mark.parametrize(
    "line", ["import runtime.b", "from runtime import b", "from runtime.b import x"]
)
def test_a_circle_through_a_function_is_found(line: str, tmp_path: Path) -> None:
    folder = tmp_path / "runtime"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "b.py").write_text("from runtime.c import y\n\nx = y\n")
    (folder / "c.py").write_text(f"y = 1\n\n\ndef late():\n    {line}\n")
    assert set(circle(tmp_path)) == {"runtime.b", "runtime.c"}
    (folder / "c.py").write_text(f"if TYPE_CHECKING:\n    {line}\n\ny = 1\n")
    assert circle(tmp_path) == []
