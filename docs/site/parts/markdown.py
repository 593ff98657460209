"""Small pieces of Markdown."""

import re
from collections.abc import Iterable, Sequence


def plain(text: str) -> str:
    """A text whose stars, underscores and angle brackets mean nothing, but for `code`."""
    parts = re.split(r"(`[^`]*`)", " ".join(text.split()))
    return "".join(
        part if part[:1] == "`" else re.sub(r"([*_<>])", r"\\\1", part) for part in parts
    )


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; a bar within a cell is one of its letters."""
    cells = [[cell.replace("|", r"\|") for cell in row] for row in (head, *rows)]
    lines = [cells[0], ["---"] * len(head), *cells[1:]]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
