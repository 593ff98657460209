"""Every constant of a rig file, from the model that reads it."""

import tomllib
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from parts.bounds import bounds, default
from parts.markdown import plain, table
from wakedeploy.core.rig import Rig
from wakedeploy.core.units import unit_of
from wakedeploy.rig.file import default_rig_text


def markdown() -> str:
    """A heading and a table for each section."""
    return "\n\n".join(_sections(Rig, ""))


def _sections(model: type[BaseModel], path: str) -> Iterator[str]:
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            inner = f"{path}{name}"
            if any(_is_constant(below) for below in kind.model_fields.values()):
                yield _section(inner, kind)
            yield from _sections(kind, f"{inner}.")


def _is_constant(field: FieldInfo) -> bool:
    return not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel))


def _section(path: str, model: type[BaseModel]) -> str:
    words = " ".join(plain(part) for part in (model.__doc__ or "").split("\n\n"))
    rows = [_row(path, name, field) for name, field in model.model_fields.items()]
    head = ["Constant", "Unit", "Default rig", "Bounds", "What"]
    return f"## `[{path}]`\n\n{words}\n\n{table(head, rows)}"


def _row(path: str, name: str, field: FieldInfo) -> list[str]:
    unit = "–" if isinstance(field.default, bool | dict) else unit_of(name) or "1"
    words = plain(field.description or "")
    return [f"`{name}`", unit, _shown(_stated(path, name, field)), bounds(field) or "–", words]


def _stated(path: str, name: str, field: FieldInfo) -> Any:
    table_: Any = _DEFAULT_RIG
    for part in (*path.split("."), name):
        table_ = table_.get(part, {}) if isinstance(table_, dict) else table_
    return default(field) if table_ == {} else table_


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(value) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(f"{one:g}" for one in value) if len(value) < 3 else f"{len(value)} points"
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "–"}[value]
    return f"{value:g}"


_DEFAULT_RIG = tomllib.loads(default_rig_text())
