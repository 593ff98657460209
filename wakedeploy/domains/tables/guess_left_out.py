"""Columns that a first `columns.toml` does not list, and why: text among numbers, or no number.

In: a log, and the numbers that were read of it. Out: a reason for each column, and comments.
"""

import textwrap
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.formats.cells import BOOLEAN, is_missing
from wakedeploy.domains.tables.guess_clock import MOST_COLUMNS, plain_line
from wakedeploy.domains.tables.log import Field, Log, Values
from wakedeploy.domains.tables.stamps import as_floats

_NEARLY = 0.5  # the share of numbers from which on text is a mistake in some cells
_AGAIN = ", and guess again"
_LONGEST = 40  # letters of a cell that are shown


def left_out(
    log: Log, values: Mapping[str, Values], clocks: Collection[str | None]
) -> dict[str, str]:
    """Why columns of a log are not listed, by their names: those without numbers, and texts."""
    found = {name: _on_numbers(numbers) for name, numbers in values.items() if len(numbers) > 1}
    unread = [field for field in _columns(log) if field.name not in values]
    texts = _texts(log, unread)
    for field in unread:
        read = texts.get(field.name, "")
        found[field.name] = read if isinstance(read, str) else _on_texts(log, field.name, read)
    return {name: reason for name, reason in found.items() if reason and name not in clocks}


def comments_on(reasons: Mapping[str, str]) -> Iterator[str]:
    """The reasons as comments of a `columns.toml`."""
    if reasons:
        yield "\n# Not listed, as they cannot be read as numbers:"
    for name, reason in reasons.items():
        said = f"{plain_line(name)}: {' '.join(reason.split())}"
        yield textwrap.fill(
            said, 96, initial_indent="#   ", subsequent_indent="#     ", break_on_hyphens=False
        )


def _columns(log: Log) -> list[Field]:
    """The fields that would be listed, or that hold texts; those of messages say what they are."""
    fields = [field for field in log.fields() if not field.is_aside and not field.unread]
    return [f for f in fields if f.example is not None or not f.topic][:MOST_COLUMNS]


def _texts(log: Log, fields: Sequence[Field]) -> dict[str, Values | str]:
    """The cells of columns as they stand; for a column that cannot be read, why not."""
    names = [field.name for field in fields]
    try:
        return dict(log.read(names, names)) if names else {}
    except UnusableInput:
        pass
    found: dict[str, Values | str] = {}
    for name in names:
        try:
            found |= log.read([name], [name])
        except UnusableInput as error:
            found[name] = str(error).rpartition(f"column {name!r} ")[2].rstrip(".")
    return found


def _on_numbers(numbers: Values) -> str:
    """What is wrong with a column that was read; "" where it has numbers."""
    if numbers.dtype.kind == "M":
        return "dates"
    if numbers.dtype.kind not in "fiub":
        return "texts"
    return "" if np.isfinite(as_floats(numbers)).any() else "no number in any row"


def _on_texts(log: Log, name: str, cells: Values) -> str:
    """Where a column has text, and what to do where nearly all of it are numbers."""
    if cells.dtype != object:
        return _on_numbers(cells) if len(cells) > 1 else ""
    numbers = np.array([_is_number(cell) for cell in cells])
    is_text = ~numbers & np.array([not _is_none(str(cell)) for cell in cells])
    if not is_text.any():
        return "no number in any row"
    at = int(np.argmax(is_text))
    first = f"{str(cells[at])[:_LONGEST]!r} in {log.place(name, at)}"
    if numbers.sum() < _NEARLY * len(cells):
        return f"texts, as {first}"
    count = int(is_text.sum())
    if count == 1:
        return f"one of {len(cells)} rows holds text, {first}; mend that cell, or empty it{_AGAIN}"
    return (
        f"{count} of {len(cells)} rows hold text, the first {first}; mend those cells, or empty"
        f" them{_AGAIN}"
    )


def _is_none(cell: str) -> bool:
    """Whether a cell is no text among numbers: it has no number, or a truth value."""
    return is_missing(cell) or cell.strip().lower() in BOOLEAN


def _is_number(cell: object) -> bool:
    try:
        return bool(np.isfinite(float(str(cell))))
    except ValueError:
        return False
