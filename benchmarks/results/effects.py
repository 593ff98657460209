"""What docs/reference/effects.md takes from the library: its effects and their equations."""

from wakedeploy.physics.effects import equation_table, markdown_table

TABLES = (markdown_table, equation_table)
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
