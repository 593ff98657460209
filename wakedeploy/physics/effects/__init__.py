"""The library of effects: named pieces of physics that a rig's simulation may be missing.

In: a rig file's `[[effect]]` entries, or values that a fit tries. Out: what they change, for the
plant step by step and for the gap workflow over whole flights. Effects act in one fixed order:
command, actuator, wake, force, body, sensor.
"""

from collections.abc import Mapping
from types import MappingProxyType

from wakedeploy.core.errors import UnusableInput
from wakedeploy.physics.effects import actuator, body, command, force, sensor, wake
from wakedeploy.physics.effects.base import (
    STAGES,
    Effect,
    Motion,
    Number,
    Parameter,
    Setting,
    Values,
)

__all__ = (
    "LIBRARY",
    "STAGES",
    "Effect",
    "Motion",
    "Number",
    "Parameter",
    "Setting",
    "Values",
    "effect",
    "equation_table",
    "markdown_table",
)

LIBRARY: Mapping[str, Effect] = MappingProxyType(
    {
        one.name: one
        for module in (command, actuator, wake, force, body, sensor)
        for one in module.EFFECTS
    }
)


def effect(name: str) -> Effect:
    """The effect of this name; UnusableInput lists the known ones."""
    if name not in LIBRARY:
        known = ", ".join(LIBRARY)
        raise UnusableInput(f"There is no effect {name!r} in the library; it knows {known}.")
    return LIBRARY[name]


def markdown_table() -> str:
    """The library as a Markdown table, one line per effect, in the order in which they act."""
    lines = [
        "| Effect | Acts on | Physics | Parameters (unit, prior scale, bounds) | Confused with "
        "| Split by |",
        "|---|---|---|---|---|---|",
    ]
    for one in LIBRARY.values():
        parameters = "<br>".join(_parameter_cell(parameter) for parameter in one.parameters)
        rivals = ", ".join(f"`{name}`" for name in one.confused_with)
        lines.append(
            f"| `{one.name}` | {one.stage} | {one.physics} | {parameters} | {rivals} "
            f"| {one.split_by} |"
        )
    return "\n".join(lines) + "\n"


def equation_table() -> str:
    """What each effect makes of the rig's quantities, as a Markdown table in the same order."""
    lines = ["| Effect | Equation |", "|---|---|"]
    for one in LIBRARY.values():
        equation = one.equation.replace("|", "\\|")
        lines.append(f"| `{one.name}` | `{equation}` |")
    return "\n".join(lines) + "\n"


def _parameter_cell(one: Parameter) -> str:
    replaced = "" if one.constant is None else f"; rig constant `{one.constant}`"
    return f"`{one.name}` ({one.unit}, {one.scale:g}, {one.low:g}…{one.high:g}{replaced})"
