"""The names of `import wakedeploy as wd`: what they cost, and what they say of themselves."""

import ast
import dataclasses
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import wakedeploy as wd

PUBLIC = [name for name in wd.__all__ if name != "__version__"]
ERRORS = {"WakedeployError", "UnusableInput", "CheckFailed", "OutOfRange"}
RESULTS = [n for n in PUBLIC if inspect.isclass(getattr(wd, n)) and n not in ERRORS]
FUNCTIONS = [name for name in PUBLIC if inspect.isfunction(getattr(wd, name))]

# What a docstring says of numbers. Shapes: (T, d), (N,) …; a table's are its rows.
SHAPES = r"\((?:[BTNdo]|\d+)(?:, ?(?:[BTNdo]|\d+))*,?\)"
UNITS = r"\[[a-zµ]+[\w/·]*\]|\bunits?\b|SI\b"
RAISED = r"Raises|UnusableInput|ValueError|KeyError"


@pytest.mark.parametrize("name", [*FUNCTIONS, *RESULTS])
def test_every_public_name_says_shapes_units_and_errors(name: str) -> None:
    text = inspect.getdoc(getattr(wd, name)) or ""
    assert len(text.split()) > 10
    for what, form in (("shapes", SHAPES), ("units", UNITS), ("errors", RAISED)):
        assert re.search(form, text), f"{name} says nothing of {what}"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_argument_of_a_function_is_described(name: str) -> None:
    function = getattr(wd, name)
    described = set(re.findall(r"^ {4}\**(\w+):", inspect.getdoc(function) or "", re.MULTILINE))
    assert set(inspect.signature(function).parameters) <= described


@pytest.mark.parametrize("name", RESULTS)
def test_every_method_and_property_of_a_class_is_described(name: str) -> None:
    kind = getattr(wd, name)
    own = [n for n, v in vars(kind).items() if callable(v) or isinstance(v, property | classmethod)]
    own = [n for n in own if not n.startswith(("_", "model_"))]
    assert [n for n in own if not (inspect.getdoc(getattr(kind, n)) or "").strip()] == []


# What a user writes down shows as it was written.
DECLARED = {"Channel", "Input", "Output", "Constant", "Port"}


@pytest.mark.parametrize("name", [n for n in RESULTS if n not in DECLARED])
def test_every_class_tells_of_itself_in_a_line(name: str) -> None:
    kind = getattr(wd, name)
    assert kind.__repr__ is not object.__repr__
    assert not (dataclasses.is_dataclass(kind) and kind.__dataclass_params__.repr)


def test_the_types_that_editors_see_are_the_names_that_python_finds() -> None:
    stub = ast.parse(Path(wd.__file__).with_suffix(".pyi").read_text("utf-8"))
    imported = {
        alias.asname: (node.module, alias.name)
        for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }  # fmt: skip
    assert sorted(imported) == sorted(PUBLIC)
    for name, (module, original) in imported.items():
        assert getattr(wd, name) is getattr(sys.modules[module], original)


def test_the_import_loads_no_library() -> None:
    code = (
        "import sys; before = set(sys.modules); import wakedeploy as wd; dir(wd);"
        "print(sorted({m.split('.')[0] for m in set(sys.modules) - before}))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"numpy", "pydantic", "torch"}.isdisjoint(ast.literal_eval(told.stdout))


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'fly_away'"):
        wd.fly_away  # noqa: B018
    assert {"fly", "train", "Rig"} <= set(dir(wd))
