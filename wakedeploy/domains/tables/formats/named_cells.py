"""Lines whose numbers have their names before them, as boards print for a serial plotter.

In: lines as `t:20, angle:1.5` or `t=20 angle=1.5`. Out: a row of names, and rows of the numbers'
texts in its order.
"""

import itertools
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.formats.cells import is_number, is_number_or_absent

LINES = 200  # that show the names
_FEWEST_LINES, _MOSTLY = 5, 0.9  # that have names, and the share of those that are looked at
_LONGEST_LINE = 4096  # letters, of one that is looked at
_CELL = re.compile(
    r"(?:(?<=[\s,;>|])|^)(?P<name>[A-Za-z_][^\s:=,;>|\"'{}]{0,60})[ \t]{0,8}[:=][ \t]{0,8}"
    r"(?P<value>[^\s,;:=|]*+)(?![:=])"
)
_BETWEEN = re.compile(r"[\s,;|]*")
Line = tuple[int, str]
Row = tuple[int, list[str]]


def lines_before(lines: Iterator[Line]) -> int | None:
    """The number of lines before the first whose numbers have names; None where none have.

    Nearly all lines have names, nothing but numbers behind them, and nothing between. The first may
    be torn: it has a name that no other has.
    """
    seen = list(itertools.islice(lines, LINES))
    if len(seen) < _FEWEST_LINES or any(len(line) > _LONGEST_LINE for _, line in seen):
        return None
    read = [_cells(line) for _, line in seen]
    names = {name for name, count in _names(read[:-1]).items() if count > 1}  # the last may be torn
    first = next((i for i, cells in enumerate(read) if cells and names >= cells.keys()), None)
    if first is None:
        return None
    following = list(zip(read[first:-1], (line for _, line in seen[first:-1]), strict=True))
    sound = sum(
        bool(cells) and names >= cells.keys() and _is_all(cells, line) for cells, line in following
    )
    is_so = sound >= max(_FEWEST_LINES, _MOSTLY * len(following))
    return seen[first][0] - 1 if is_so else None


def _is_all(cells: dict[str, str], line: str) -> bool:
    """Whether numbers stand behind the names, and none before the first: else it is a table."""
    before = re.split(r"[\s,;|]+", before_names(line))
    are_numbers = all(map(is_number_or_absent, cells.values()))
    return are_numbers and not any(map(is_number, before))


def before_names(line: str) -> str:
    """What stands before the first name of a line, as a stamp and an arrow."""
    first = _CELL.search(line)
    return line[: first.start()].strip() if first else ""


def named_rows(path: Path, lines: Iterator[Line], nameless: list[int]) -> Iterator[Row]:
    """The names of the first lines, then each line's numbers below them.

    A name that a line lacks leaves a blank, but in a last line that is cut off: that row is
    shorter. A line without names is left out, and its number goes into `nameless`. UnusableInput
    for one that has a name twice, one that no line had before, or text between its numbers.
    """
    begin = list(itertools.islice(lines, LINES))
    names = [*_names(_cells(line) for _, line in begin)]
    if not names:
        raise UnusableInput(
            f"{path}: has no name before a number, and [csv] names_in_cells says that it has; "
            "delete that line."
        )
    yield begin[0][0], names
    for number, line in itertools.chain(begin, lines):
        cells, has_end = _cells(line), line.endswith(("\n", "\r"))
        if not cells:
            if _CELL.search(line) and not has_end:
                yield number, []  # it is cut off within a cell
                return
            if _CELL.search(line):
                raise UnusableInput(
                    f"{path}, line {number}: has a name twice, or more between its numbers than a "
                    "delimiter; mend the line or delete it."
                )
            nameless.append(number)
            continue
        if unknown := next((name for name in cells if name not in names), None):
            raise UnusableInput(
                f"{path}, line {number}: has {unknown[:40]!r}, which none of the first {LINES} "
                "lines has; mend the line or delete it."
            )
        is_cut = len(cells) < len(names) and not has_end
        yield number, list(cells.values()) if is_cut else [cells.get(n, "") for n in names]


def _names(lines: Iterable[dict[str, str]]) -> Counter[str]:
    """How many lines have each name, in the order in which they come."""
    return Counter(name for cells in lines for name in cells)


def _cells(line: str) -> dict[str, str]:
    """Numbers by the names before them; nothing for a line that has more than these.

    Before the first name anything may stand.
    """
    found = list(_CELL.finditer(line))
    if not found:
        return {}
    cells = {cell["name"]: cell["value"] for cell in found}
    ends = [cell.end() for cell in found]
    starts = [cell.start() for cell in found[1:]] + [len(line)]
    between = (line[a:b] for a, b in zip(ends, starts, strict=True))
    is_whole = len(cells) == len(found) and all(map(_BETWEEN.fullmatch, between))
    return cells if is_whole else {}
