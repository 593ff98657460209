"""Lines whose numbers have their names before them, as boards print for a serial plotter.

In: lines as `t:20, angle:1.5` or `t=20 angle=1.5`. Out: a row of names, and rows of the numbers'
texts in its order.
"""

import itertools
import re
from collections.abc import Iterator
from pathlib import Path

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.formats.cells import is_number, is_number_or_absent

_FEWEST_LINES, _LINES = 5, 200  # that show how a text is written
_CELL = re.compile(
    r"(?:(?<=[\s,;>|])|^)(?P<name>[A-Za-z_][^:=,;>|\t\"'{}]{0,60}?)\s*[:=]\s*"
    r"(?P<value>[^\s,;:=|]++)(?![:=])"
)
Line = tuple[int, str]
Row = tuple[int, list[str]]


def lines_before(lines: Iterator[Line]) -> int | None:
    """The number of lines before the first whose numbers have names; None where none have.

    From that line on all have the same names, numbers behind them, and no number besides; but the
    last one that is looked at may be torn.
    """
    seen = list(itertools.islice(lines, _LINES))
    names = _names(seen[len(seen) // 2][1]) if seen else []
    if not names or len(set(names)) < len(names):
        return None
    are_named = [_names(line) == names and _holds_no_more(line) for _, line in seen]
    first = are_named.index(True) if True in are_named else len(seen)
    is_so = len(seen) - first >= _FEWEST_LINES and all(are_named[first:-1])
    return seen[first][0] - 1 if is_so else None


def _holds_no_more(line: str) -> bool:
    """Whether numbers, and nothing else, stand behind names, and none elsewhere."""
    rest = re.split(r"[\s,;|]+", _CELL.sub("", line))
    is_numbers = all(is_number_or_absent(value) for _, value in _cells(line))
    return is_numbers and not any(map(is_number, rest))


def before_names(line: str) -> str:
    """What stands before the first name of a line, as a stamp and an arrow."""
    first = _CELL.search(line)
    return line[: first.start()].strip() if first else ""


def named_rows(path: Path, lines: Iterator[Line]) -> Iterator[Row]:
    """The names of the first line, with its number, then each line's numbers below them.

    A name that a line lacks leaves a blank, but in a last line that is cut off: that row is
    shorter. UnusableInput for a name that the first line has not.
    """
    names: list[str] = []
    for number, line in lines:
        if not names:
            names = _names(line)
            if not names:
                raise UnusableInput(
                    f"{path}, line {number}: has no name before a number; delete names_in_cells in "
                    "[csv], or the lines before the first that has, by skip_rows."
                )
            yield number, names
        values = dict(_cells(line))
        if unknown := next((name for name in values if name not in names), None):
            raise UnusableInput(
                f"{path}, line {number}: has {unknown[:40]!r}, which the first line has not; mend "
                "the line or delete it."
            )
        is_cut = len(values) < len(names) and not line.endswith(("\n", "\r"))
        yield number, list(values.values()) if is_cut else [values.get(n, "") for n in names]


def _cells(line: str) -> list[tuple[str, str]]:
    return [(cell["name"].strip(), cell["value"]) for cell in _CELL.finditer(line.rstrip("\r\n"))]


def _names(line: str) -> list[str]:
    return [name for name, _ in _cells(line)]
