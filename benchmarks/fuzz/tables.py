"""Damage within tables of text: cells, rows and columns of CSV files."""

import random

from benchmarks.fuzz.text import NUMBERS, any_text

CELLS = (
    *NUMBERS, "RUNNING", "FAILSAFE", "ARMED", "x", '"', '"a', "a\x00b", "\ud7ff", " 1 ", "1;2",
    "2019-99-99 18:45:58:868", "overrun+overrun", "+", "é",
)  # fmt: skip


def csv_file(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """A CSV file with other cells, rows or columns, or damaged as a text."""
    if draw.random() < 0.25:
        return any_text(draw, data, other)
    table = [line.split(b",") for line in data.split(b"\n")]
    for _ in range(draw.choice((1, 1, 2, 4))):
        way = draw.choice((_cell, _cell, _cell, _row, _column, _names, _whole_column))
        way(draw, table)
        if not table:
            break
    return b"\n".join(b",".join(row) for row in table)


def _text(draw: random.Random) -> bytes:
    return draw.choice(CELLS).encode("utf-8", "replace")


def _cell(draw: random.Random, table: list[list[bytes]]) -> None:
    row = draw.choice(table)
    row[draw.randrange(len(row))] = _text(draw)


def _row(draw: random.Random, table: list[list[bytes]]) -> None:
    at, to = draw.randrange(len(table)), draw.randrange(len(table))
    way = draw.randrange(5)
    if way == 0:
        table.pop(at)
    elif way == 1:
        table.insert(to, list(table[at]))
    elif way == 2:
        table[at], table[to] = table[to], table[at]
    elif way == 3:
        del table[at:]
    else:
        table[at] = table[at][:-1] if draw.random() < 0.5 else [*table[at], _text(draw)]
        if not table[at]:
            table.pop(at)


def _column(draw: random.Random, table: list[list[bytes]]) -> None:
    """A column left out, doubled, or put in another's place."""
    width = max(map(len, table))
    at, to = draw.randrange(width), draw.randrange(width)
    way = draw.randrange(3)
    for row in table:
        if at >= len(row) or to >= len(row) or len(row) < 2:
            continue
        if way == 0:
            row.pop(at)
        elif way == 1:
            row.insert(to, row[at])
        else:
            row[at], row[to] = row[to], row[at]


def _names(draw: random.Random, table: list[list[bytes]]) -> None:
    """Other names in the first row."""
    head = table[0]
    at = draw.randrange(len(head))
    new = (head[draw.randrange(len(head))], head[at].upper(), head[at] + b" ", b"", _text(draw))
    head[at] = draw.choice(new)


def _whole_column(draw: random.Random, table: list[list[bytes]]) -> None:
    """One value from top to bottom, so that what needs variety or order meets none."""
    at, new = draw.randrange(max(map(len, table))), _text(draw)
    for row in table[1:]:
        if at < len(row):
            row[at] = new
