"""What docs/reference/effects.md takes from the library: its effects and their equations."""

from wakedeploy.physics.effects import LIBRARY, Parameter

_ENDS = "<!-- end of table -->"


def filled(text: str) -> str:
    """The page with the library's present tables; ValueError where a mark is missing."""
    for made in TABLES:
        begins = f"<!-- table: {made.__module__}.{made.__name__}() -->\n"
        before, begun, rest = text.partition(begins)
        _, ended, after = rest.partition(_ENDS)
        if not (begun and ended):
            raise ValueError(
                f"docs/reference/effects.md: the marks around {made.__name__}() are missing"
            )
        text = before + begins + made() + _ENDS + after
    return text


def markdown_table() -> str:
    """The library as a Markdown table, one line per effect, in the order in which they act."""
    lines = [
        "| Effect | Acts on | Physics | Parameters (unit, prior scale, bounds) | Confused with "
        "| Split by |",
        "|---|---|---|---|---|---|",
    ]
    for shape in LIBRARY.values():
        parameters = "<br>".join(_parameter_cell(parameter) for parameter in shape.parameters)
        rivals = ", ".join(f"`{name}`" for name in shape.confused_with)
        lines.append(
            f"| `{shape.name}` | {shape.stage} | {shape.physics} | {parameters} | {rivals} "
            f"| {shape.split_by} |"
        )
    return "\n".join(lines) + "\n"


def equation_table() -> str:
    """What each effect makes of the rig's quantities, as a Markdown table in the same order."""
    lines = ["| Effect | Equation |", "|---|---|"]
    for shape in LIBRARY.values():
        equation = shape.equation.replace("|", "\\|")
        lines.append(f"| `{shape.name}` | `{equation}` |")
    return "\n".join(lines) + "\n"


def _parameter_cell(parameter: Parameter) -> str:
    replaced = "" if parameter.constant is None else f"; rig constant `{parameter.constant}`"
    bounds = f"{parameter.low:g}…{parameter.high:g}"
    return f"`{parameter.name}` ({parameter.unit}, {parameter.scale:g}, {bounds}{replaced})"


TABLES = (markdown_table, equation_table)
