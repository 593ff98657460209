"""What cells and rows of a table of text hold: numbers as programs write them, units, names.

In: cells as texts. Out: what they are. Nothing here opens a file.
"""

import csv
import re
from collections.abc import Sequence

from wakedeploy.core.units import is_known, same_unit
from wakedeploy.domains.tables.columns import Delimited

WITH_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+([eE][-+]?[0-9]+)?")
_WITHIN_NUMBER = re.compile(r"(?<=[0-9]),(?=[0-9])")
_WITH_POINT = re.compile(WITH_COMMA.pattern.replace(",", r"\.", 1))
_GROUPED = {  # thousands that are parted, by what parts them
    mark: re.compile(rf"[-+]?[1-9][0-9]{{0,2}}(?:{re.escape(mark)}[0-9]{{3}})+(?:{decimal}[0-9]+)?")
    for mark, decimal in ((",", r"\."), (".", ","), ("'", "[.,]"))
}
PARTING = re.compile(r"[-=_+]+|(?:float|double|int|uint|real)[0-9]*")
_MISSING = {
    *("", "nan", "-nan", "null", "none", "na", "n/a", "-", "--", "---", "nan(ind)", "-nan(ind)"),
    *("#n/a", "#nv", "#value!", "#num!", "#div/0!", "#ref!", "#name?", "#null!"),  # of spreadsheets
}
_MISSING_ON_WINDOWS = re.compile(r"-?1\.#(?:qnan|snan|ind)0*")
_AS_DATA = re.compile(r"[-+.,(\[]*[0-9]")
BOOLEAN = {"true": 1.0, "false": 0.0}
_WITH_UNIT = re.compile(
    r"(?P<number>[-+]?[0-9.,']*[0-9](?:[eE][-+]?[0-9]+)?)(?P<space>\s*)(?P<unit>[A-Za-z%°µμΩ].*)"
)
_IN_BRACKETS = re.compile(r"[(\[](?P<unit>[^()\[\]]+)[)\]]\s*$")
_BETWEEN_SPACES = re.compile(r'"([^"]*)"(?!\S)|(\S+)')
_LONGEST_UNIT = 60  # letters at the end of a name that may be one
_LONGEST_WITH_UNIT = 64  # letters of a cell
Row = list[str]


def unit_in_brackets(name: str) -> str | None:
    """The unit in brackets at the end of a column's name; x[0] has none."""
    match = _IN_BRACKETS.search(name[-_LONGEST_UNIT:])
    return None if match is None or match["unit"].strip().isdigit() else match["unit"]


def is_missing(cell: str) -> bool:
    """Whether it says that there is no number."""
    plain = cell.strip().lower()
    return plain in _MISSING or bool(_MISSING_ON_WINDOWS.fullmatch(plain))


def is_number(text: str) -> bool:
    """Whether Python reads a number in it."""
    try:
        float(text)
    except ValueError:
        return False
    return text.isascii() and "_" not in text


def is_number_somehow(cell: str) -> bool:
    """Whether it is a number, with a point or a comma before its decimals, or between thousands."""
    plain = cell.strip().lower()
    if is_missing(plain):
        return False
    return is_number(plain.replace(",", ".", 1)) or any(
        grouped.fullmatch(plain) for grouped in _GROUPED.values()
    )


def is_number_or_absent(text: str) -> bool:
    """Whether it is a number, or says that there is none."""
    return is_missing(text) or is_number(text)


def is_text(text: str, form: Delimited) -> bool:
    """Whether it is neither a number, as the table writes them, nor a truth value."""
    plain = plain_number(text.strip().lower(), form)
    return not (is_missing(plain) or plain in BOOLEAN or is_number(plain))


def plain_number(text: str, form: Delimited) -> str:
    """A number as Python writes it, without marks between thousands; other texts as they are."""
    mark = form.thousands
    if mark is not None and mark in text:
        if not _GROUPED[mark].fullmatch(text.strip()):
            return text  # 1.21 where points part thousands: no number
        text = text.replace(mark, "")
    return text.replace(",", ".") if form.decimal == "," else text


def parted(cell: str) -> tuple[str, str]:
    """A number and the unit behind it; the cell itself and no unit where it is not both.

    A single letter is a unit only after a space: 71.7W is west, and 6S has six cells.
    """
    text = cell.strip()
    match = _WITH_UNIT.fullmatch(text) if len(text) <= _LONGEST_WITH_UNIT else None
    if match is None:
        return cell, ""
    unit = match["unit"].strip()
    is_unit = is_known(unit) and (len(unit) > 1 or bool(match["space"]) or not unit.isalpha())
    return (match["number"], unit) if is_unit else (cell, "")


def plain_unit(cell: str) -> str:
    """A unit without what it stands in: [m/s] and (m/s) are m/s, and - is none."""
    return cell.strip().strip("[]()").strip().strip("-")


def delimiter_of(line: str) -> str:
    """What separates the cells of a line: whatever is there most often, quoted text aside.

    Beside a semicolon or a tab, a comma within a number stands before its decimals.
    """
    bare = re.sub(r'"[^"]*"', "x", line)
    if ";" in bare or "\t" in bare:
        bare = _WITHIN_NUMBER.sub("", bare)
    most = max(",;\t", key=bare.count)
    return most if most in bare or len(bare.split()) < 2 else " "


def written(delimiter: str) -> str:
    """A delimiter as TOML has it."""
    return delimiter.replace("\t", r"\t")


def cells_of(line: str, delimiter: str) -> list[str]:
    """The cells of one line."""
    if delimiter == " ":
        return cells_between_spaces(line)
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])


def cells_between_spaces(line: str) -> Row:
    """The cells of a line that any number of spaces or tabs part; quoted ones may be empty."""
    if '"' not in line:
        return line.split()
    return [quoted or bare for quoted, bare in _BETWEEN_SPACES.findall(line)]


def has_number(cells: Row) -> bool:
    """Whether a cell is a number; columns may be called by their places: 0, 1, 2."""
    return not _is_counted(cells) and any(map(is_number_somehow, cells))


def _is_counted(cells: Row) -> bool:
    """Whether cells are 0, 1, 2, … or 1, 2, 3, …, as columns are called that have no names.

    The first may be blank, as above the rows' own names.
    """
    texts = [cell.strip() for cell in cells]
    named = texts[1:] if texts and not texts[0] else texts
    return bool(named) and any(
        named == [str(i + first) for i in range(len(named))] for first in (0, 1)
    )


def columns_of_numbers(rows: Sequence[Row]) -> list[int]:
    """The columns that hold numbers, some of which may be missing."""
    return [
        i
        for i in range(min(map(len, rows), default=0))
        if any(is_number_somehow(row[i]) for row in rows)
        and all(is_number_somehow(row[i]) or is_missing(row[i]) for row in rows)
    ]


def _has_decimals(rows: Sequence[Row], column: int) -> bool:
    cells = [row[column].strip() for row in rows if column < len(row)]
    return any(is_number_somehow(cell) and not cell.lstrip("+-").isdigit() for cell in cells)


def is_row_of_numbers(cells: Row, rows: Sequence[Row]) -> bool:
    """Whether a first row is one of the table's, not its header: numbers above all numbers.

    Whole numbers above columns that all have decimals are names, as of years.
    """
    numbers = [i for i in columns_of_numbers(rows) if i < len(cells)]
    heads = [cells[i].strip() for i in numbers]
    if _is_counted(cells) or _is_counted(heads) or not any(map(is_number_somehow, heads)):
        return False
    if not all(is_number_somehow(head) or is_missing(head) for head in heads):
        return False
    if not cells[0].strip() and 0 in numbers:
        return False  # the rows have a name each, and their names have none
    are_whole = all(head.lstrip("+-").isdigit() for head in heads) and len({*heads}) == len(heads)
    return not (are_whole and all(_has_decimals(rows, i) for i in numbers))


def is_row_of_units(cells: Row, below: Sequence[Row]) -> bool:
    """Whether a row holds units and no number, above at least half of the columns of numbers.

    A dash or an empty cell says that there is none; some may be unknown here. A line that parts
    names from numbers, and the types of numbers, stand in the same place.
    """
    numbers = [i for i in columns_of_numbers(below) if i < len(cells)]
    if not numbers or has_number(cells):
        return False
    if all(PARTING.fullmatch(cells[i].strip().lower()) for i in numbers):
        return True
    texts = [plain_unit(cell) for cell in cells]
    known = [text for text in texts if text and is_known(text) and not same_unit(text, "1")]
    return bool(known) and 2 * sum(bool(texts[i]) for i in numbers) >= len(numbers)


def has_decimal_commas(rows: Sequence[Sequence[str]]) -> bool:
    """Whether numbers have commas before their decimals, and none has a point."""
    cells = [cell.strip() for row in rows for cell in row]
    return any(map(WITH_COMMA.fullmatch, cells)) and not any(map(_WITH_POINT.fullmatch, cells))


def have_units(rows: Sequence[Row]) -> bool:
    """Whether a column has one unit behind all of its numbers."""
    columns = zip(*rows, strict=False)
    units = [{parted(cell)[1] for cell in cells if not is_missing(cell)} for cells in columns]
    return any(len(found) == 1 for found in units if "" not in found)


def thousands_mark(rows: Sequence[Row], delimiter: str) -> str | None:
    """What parts the thousands of numbers; None where nothing does for certain.

    A single comma may also stand before three decimals, and 1.100.200 be a version. It is certain
    in a column of numbers that have both marks, or that are parted now once and now twice. Where
    commas part the cells, they do not stand before decimals.
    """
    columns = [[cell.strip() for cell in cells] for cells in zip(*rows, strict=False)]
    for mark, grouped in _GROUPED.items():
        if mark == "." and delimiter == ",":
            continue
        if any(_is_parted(cells, mark, grouped) for cells in columns):
            return mark
    return None


def _is_parted(cells: Sequence[str], mark: str, grouped: re.Pattern[str]) -> bool:
    """Whether a mark surely parts the thousands of a column's numbers."""
    there = [cell for cell in cells if not is_missing(cell)]
    parted_ones = [cell for cell in there if mark in cell]
    others = [cell for cell in there if mark not in cell]
    if not parted_ones or not all(map(grouped.fullmatch, parted_ones)):
        return False
    if not all(is_number(cell.replace(",", ".")) for cell in others):
        return False
    has_both = mark == "'" or any({".", ","} <= {*cell} for cell in parted_ones)
    return has_both or len({cell.count(mark) for cell in parted_ones}) > 1


def begins_as_data(cell: str) -> bool:
    """Whether a cell begins as a number, a date, a vector or a truth value does."""
    plain = cell.strip().lower()
    return plain in BOOLEAN or bool(_AS_DATA.match(plain)) or (bool(plain) and is_missing(plain))
