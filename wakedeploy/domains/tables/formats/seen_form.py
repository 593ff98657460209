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
    columns_of_numbers,
    has_decimal_commas,
    has_number,
    have_units,
    is_missing,
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
    rows = list(itertools.islice(log.rows(), _LOOKED_AT))
    if rows and not _is_table(log.first, rows):
        form = form.model_copy(update={"skip_rows": _lines_before(log.first_lines())})
        log = DelimitedLog(path, form)
        rows = list(itertools.islice(log.rows(), _LOOKED_AT))
    if have_units(rows):
        form = form.model_copy(update={"units_in_cells": True})
        rows = [[parted(cell)[0] for cell in row] for row in rows]
    if mark := thousands_mark(rows):
        form = form.model_copy(update={"thousands": mark, "delimiter": log.delimiter})
    if mark == "." or has_decimal_commas([log.first, *rows]):
        form = form.model_copy(update={"decimal": ",", "delimiter": log.delimiter})
    if not rows:
        return form
    if is_row_of_numbers(log.first, rows) or (form.skip_rows and has_number(log.first)):
        return form.model_copy(update={"header": False})
    begin = _data_begin(rows)
    has_units = is_row_of_units(rows[0], rows[max(begin, 1) :])
    return form.model_copy(update={"units_row": has_units, "more_rows": max(begin - has_units, 0)})


def _lines_before(lines: Sequence[tuple[int, Row]]) -> int:
    """How many lines stand before the header of the first rows that are a table; 0 if none are.

    A table is five rows of one width, or all there are, in which one column holds numbers. The line
    above is its header if it is as wide and holds none; below it units may stand.
    """
    for i, (number, cells) in enumerate(lines):
        run, columns = 0, set(range(len(cells)))
        for _, row in lines[i : i + _LOOKED_AT]:
            columns = {c for c in columns if len(row) == len(cells) and is_number_somehow(row[c])}
            if not columns:
                break
            run += 1
        if run < _ROWS and not (run > 1 and i + run >= len(lines) - 1):
            continue
        above = list[tuple[int, Row]]()
        for line, row in reversed(lines[max(i - 1 - _MOST_BELOW, 0) : i]):
            if len(row) != len(cells) or not any(row) or has_number(row):
                break
            above.append((line, row))
        numbers = [row for _, row in lines[i : i + run]]
        return _header_of(above, numbers, number) - 1
    return 0


def _header_of(above: Sequence[tuple[int, Row]], numbers: Sequence[Row], first: int) -> int:
    """The line of the names among lines `above` numbers, the lowest first; else the numbers' own.

    Names stand above each column of numbers, or, where no line has as many, in the lowest line that
    holds no units.
    """
    columns = columns_of_numbers(numbers)
    named = [(line, row) for line, row in above if not is_row_of_units(row, numbers)]
    whole = [line for line, row in named if all(row[i] for i in columns)]
    return next(iter([*whole, *(line for line, _ in named)]), first)


def _is_table(first: Row, rows: Sequence[Row]) -> bool:
    """Whether rows are as wide as the first, and a column holds numbers, below its unit or not."""
    if any(len(row) != len(first) for row in rows[:-1]):
        return False
    begin = _data_begin(rows)
    return begin == 0 or (begin > 0 and is_row_of_units(rows[0], rows[begin:]))


def _data_begin(rows: Sequence[Row]) -> int:
    """The first row of data; -1 where it is none of the first.

    From it on a column holds numbers. A row that has only texts above numbers is none of it.
    """
    begin = next((k for k in range(1 + _MOST_BELOW) if columns_of_numbers(rows[k:])), -1)
    while 0 <= begin < min(_MOST_BELOW, len(rows) - 1):
        numbers = [i for i in columns_of_numbers(rows[begin + 1 :]) if i < len(rows[begin])]
        cells = [rows[begin][i] for i in numbers]
        if all(map(is_missing, cells)) or any(map(is_number_somehow, cells)):
            break
        begin += 1
    return begin


def _stated_comment(file: IO[str]) -> str | None:
    is_table, size = False, 0
    while (line := file.readline(LONGEST_LINE)) and size <= MOST_BYTES:
        size += len(line)
        mark = next((mark for mark in _COMMENTS if line.startswith(mark)), None)
        if mark is not None and (is_table or mark != COMMENT):
            return mark
        is_table |= mark is None and bool(line.strip())
    return None
