"""The effects that are offered at a port of anybody's system: equation, parameters, source."""

from collections.abc import Iterator

from parts.markdown import plain, table
from wakedeploy.gap.systems.kinds.kind import Kind, Parameter
from wakedeploy.gap.systems.kinds.library import KINDS_BY_ROLE

_HEADS = {
    "input": "On an input: `Port.input`",
    "force": "As a force on a state: `Port.force`",
    "between": "As a force between two bodies: `Port.between`",
    "output": "In a sensor: `Port.output`",
    "constant": "In a constant: `Port.constant`",
}
_NEEDS = {
    "position": "`position`",
    "height": "`height`",
    "inertia": "`inertia`",
    "angle": "a `position` that is an angle",
    "moving": "a state that is the `position`'s speed",
    "level": "a state that is no speed, as a level",
    "other": "a second input or axis",
    "still": "logs in which it comes near 0, or turns",
    "cut above": "logs whose largest reading comes several times",
    "cut below": "logs whose least reading comes several times",
    "turning": "logs in which it turns",
}


def markdown() -> str:
    """A table for each kind of port."""
    return "\n\n".join(_sections())


def _sections() -> Iterator[str]:
    for role, kinds in KINDS_BY_ROLE.items():
        yield f"## {_HEADS[role]}"
        head = ["Effect", "What it is", "Equation", "Parameters", "Needs", "Source"]
        yield table(head, (_row(kind) for kind in kinds))


def _row(kind: Kind) -> list[str]:
    meaning = plain((kind.__doc__ or "").split("\n\n")[0])
    needs = ", ".join(_NEEDS[need] for need in kind.needs) or "–"
    parameters = "; ".join(map(_parameter, kind.parameters))
    return [f"`{kind.name}`", meaning, f"`{kind.equation}`", parameters, needs, kind.source]


def _parameter(parameter: Parameter) -> str:
    over = " · ".join(_power(n, p) for n, p in parameter.of.items() if p > 0)
    under = " · ".join(_power(n, -p) for n, p in parameter.of.items() if p < 0)
    made_of = f"{over or '1'}/({under})" if under else over or "a number"
    return f"*{parameter.name}*, {made_of}"


def _power(name: str, exponent: int) -> str:
    return name if exponent == 1 else f"{name}^{exponent}"
