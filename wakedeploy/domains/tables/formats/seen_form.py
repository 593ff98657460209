"""How a table of text is written, as far as its first rows show.

In: a file. Out: its encoding, the lines before the header, what stands below it, how numbers are
written.
"""

import itertools
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import Delimited
from wakedeploy.domains.tables.formats.cells import (
    Row,
    begins_as_data,
    columns_of_numbers,
    has_decimal_commas,
    has_number,
    have_units,
    is_number_somehow,
    is_row_of_numbers,
    is_row_of_units,
    parted,
    thousands_mark,
)
from wakedeploy.domains.tables.formats.delimited import (
    COMMENT,
    LONGEST_LINE,
    DelimitedLog,
    opened,
    seen_encoding,
)
from wakedeploy.domains.tables.log import MOST_BYTES, require_size

_COMMENTS = (COMMENT, "%", "//", "!")  # that are looked for
_ROWS = 5  # that are a table
_MOST_BELOW = 3  # rows between a header and the data
_LOOKED_AT = 200  # rows that show how numbers are written


def seen_form(path: Path) -> Delimited:
    """How a text is written, as far as it is seen from its first rows and what lines begin with.

    A comment before the header is left out in any case if it begins with #; any other is stated.
    """
    require_size(path)
    try:
        encoding = seen_encoding(path)
        with opened(path, encoding) as file:
            form = Delimited(comment=_stated_comment(file), encoding=encoding)
        return _seen_in_rows(path, form)
    except (OSError, EOFError, zlib.error, UnicodeError, UnusableInput):  # who reads it says so
        return Delimited()


def _seen_in_rows(path: Path, form: Delimited) -> Delimited:
    """The form, with what stands before the table, its header, its units and its decimals."""
    log = DelimitedLog(path, form)
    if (begin := log.named_cells_begin()) is not None:
        return form.model_copy(update={"names_in_cells": True, "skip_rows": begin})
    rows = list(itertools.islice(log.rows(), _LOOKED_AT))
    if rows and not _is_table(log.first, rows):
        form = form.model_copy(update={"skip_rows": _lines_before(log.first_lines())})
        log = DelimitedLog(path, form)
        rows = list(itertools.islice(log.rows(), _LOOKED_AT))
    first = log.first
    if have_units(rows):
        form = form.model_copy(update={"units_in_cells": True})
        first, *rows = ([parted(cell)[0] for cell in row] for row in [first, *rows])
    if mark := thousands_mark(rows, log.delimiter):
        form = form.model_copy(update={"thousands": mark, "delimiter": log.delimiter})
    if mark == "." or has_decimal_commas([first, *rows]):
        form = form.model_copy(update={"decimal": ",", "delimiter": log.delimiter})
    if not rows:
        return form
    if is_row_of_numbers(first, rows) or (form.skip_rows and has_number(first)):
        return form.model_copy(update={"header": False})
    begin = _data_begin(rows)
    has_units = is_row_of_units(rows[0], _surely_data(rows))
    return form.model_copy(update={"units_row": has_units, "more_rows": max(begin - has_units, 0)})


def _lines_before(lines: Sequence[tuple[int, Row]]) -> int:
    """How many lines stand before the header of the first rows that are a table; 0 if none are.

    A table is five rows of one width, or all there are, in which one column holds numbers. The line
    above is its header if it is as wide and holds none; below it units may stand.
    """
    for i, (number, cells) in enumerate(lines):
        run, columns = 0, set(range(len(cells)))
        for _, row in lines[i : i + _LOOKED_AT]:
            kept = columns if _are_as_wide(row, cells) else ()
            columns = {c for c in kept if c < len(row) and is_number_somehow(row[c])}
            if not columns:
                break
            run += 1
        if run < _ROWS and not (run > 1 and i + run >= len(lines) - 1):
            continue
        above = list[tuple[int, Row]]()
        for line, row in reversed(lines[max(i - 1 - _MOST_BELOW, 0) : i]):
            if not _are_as_wide(row, cells) or not any(row) or has_number(row):
                break
            above.append((line, row))
        numbers = [row for _, row in lines[i : i + run]]
        return _header_of(above, numbers, number) - 1
    return 0


def _are_as_wide(row: Row, other: Row) -> bool:
    """Whether two rows have as many cells, but for a blank one that a delimiter at an end makes."""
    shorter, longer = sorted((row, other), key=len)
    return len(longer) == len(shorter) or (len(longer) == len(shorter) + 1 and not longer[-1])


def _header_of(above: Sequence[tuple[int, Row]], numbers: Sequence[Row], first: int) -> int:
    """The line of the names among lines `above` numbers, the lowest first; else the numbers' own.

    Names stand right above units, and above each column of numbers but the first, which may be the
    rows' own. Names may read as units do, as t, V and A; then nothing that is whole is above them.
    What several columns are of, as a body of motion capture, is no name of theirs.
    """
    columns = [i for i in columns_of_numbers(numbers) if i > 0]
    whole = [all(row[i : i + 1] != [""] for i in columns) for _, row in above]
    for k, (_, row) in enumerate(above[:-1]):
        line, names = above[k + 1]
        are_own = k == 0 or len({*names}) == len(names)
        if whole[k + 1] and are_own and is_row_of_units(row, numbers):
            return line
    found = [line for (line, _), is_whole in zip(above, whole, strict=True) if is_whole]
    return next(iter([*found, *(line for line, _ in above)]), first)


def _is_table(first: Row, rows: Sequence[Row]) -> bool:
    """Whether rows are as wide as the first, and a column holds numbers, below its unit or not."""
    if any(len(row) != len(first) for row in rows[:-1]):
        return False
    if _data_begin(rows) == 0:
        return bool(columns_of_numbers(rows))
    return is_row_of_units(rows[0], _surely_data(rows))


def _data_begin(rows: Sequence[Row]) -> int:
    """The first row of data: those above it hold only texts, above most columns of numbers."""
    found = columns_of_numbers(_surely_data(rows))
    for k, row in enumerate(rows[:_MOST_BELOW]):
        numbers = [i for i in found if i < len(row)]
        named = sum(bool(row[i].strip()) for i in numbers)
        if any(map(begins_as_data, row)) or not named or 2 * named < len(numbers):
            return k
    return min(_MOST_BELOW, len(rows))


def _surely_data(rows: Sequence[Row]) -> Sequence[Row]:
    """The rows below all that may stand between a header and the data."""
    return rows[_MOST_BELOW:] or rows[-1:]


def _stated_comment(file: IO[str]) -> str | None:
    is_table, size = False, 0
    while (line := file.readline(LONGEST_LINE)) and size <= MOST_BYTES:
        size += len(line)
        mark = next((mark for mark in _COMMENTS if line.startswith(mark)), None)
        if mark is not None and (is_table or mark != COMMENT):
            return mark
        is_table |= mark is None and bool(line.strip())
    return None
