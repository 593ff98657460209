"""CSV and its relatives, plain or gzipped: read line by line, only the columns that are asked for.

A cell may hold a vector as a list in a quoted string ("[0.1, 0.2]"), of which an address takes one
number. Columns are called by the header, or by their place: #1 is the first.
"""

import codecs
import csv
import gzip
import itertools
import re
import zlib
from array import array
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.units import same_unit
from wakedeploy.domains.tables.columns import Delimited, Encoding
from wakedeploy.domains.tables.formats.cells import (
    BOOLEAN,
    PARTING,
    WITH_COMMA,
    Row,
    begins_as_data,
    cells_between_spaces,
    cells_of,
    delimiter_of,
    has_number,
    is_missing,
    is_number,
    is_number_or_absent,
    is_row_of_numbers,
    is_text,
    parted,
    plain_number,
    plain_unit,
    thousands_mark,
    unit_in_brackets,
    written,
)
from wakedeploy.domains.tables.formats.listed_cells import (
    by_name,
    list_in,
    names_beside,
    numbers_in,
    texts_in,
)
from wakedeploy.domains.tables.formats.named_cells import before_names, lines_before, named_rows
from wakedeploy.domains.tables.log import (
    MOST_BYTES,
    Clock,
    Field,
    Log,
    Values,
    indexed,
    missing,
    refused,
    require_size,
    require_values,
)

_BLOCK = 1 << 15  # rows that are converted at once
LONGEST_LINE = 1 << 20
COMMENT = "#"  # what lines before a header begin with that are none of the table
_MOST_BEFORE = 300  # lines in which a table begins
_LOOKED_AT_BYTES = 1 << 20  # that show how text is encoded
_WORD = re.compile(r"[^\W\d_]{2}")  # two letters in a row
_OF_GZIP = zlib.MAX_WBITS | 16  # as zlib is told that there is a header of gzip
_NOT_IN_CP1252 = {0x81, 0x8D, 0x8F, 0x90, 0x9D}


def open_log(path: Path, csv: Delimited) -> Log:
    """Open a delimited text."""
    require_size(path)
    return DelimitedLog(path, csv)


@dataclass(frozen=True)
class _Cell:
    """Where a column's numbers stand: the place in a row, and in a vector within a cell.

    That is an `element`, or the one that has a `name` in the column `names`, which may be another
    one in the next row.
    """

    address: str
    column: int
    element: int | None = None
    name: str = ""
    names: int | None = None

    @property
    def is_listed(self) -> bool:
        """Whether it is one number of a vector."""
        return self.element is not None or bool(self.name)


class DelimitedLog:
    """A CSV file and how it is written."""

    def __init__(self, path: Path, form: Delimited) -> None:
        self.path, self._form, self.notes = path, form, list[str]()
        self._lines = array("q")  # of each row, where the first is 1
        self._again = list[int]()  # lines in which the header stands once more
        self._nameless = list[int]()  # lines that hold no number with its name
        self._of = dict[str, str]()  # whose number an element of a vector is, by its address
        rows = self._rows()
        self.delimiter = form.delimiter or ","
        first = next(rows, None)
        if first is None:
            raise UnusableInput(f"{path}: is empty; give a log with a header and rows.")
        line, cells = first
        self.first: Row = cells
        if form.names_in_cells and (before := before_names(self.line(line))):
            self.notes.append(
                f"{path}: what stands before the first name of a line, as {before[:40]!r}, is left "
                "out"
            )
        named = [cell.strip() for cell in cells] if form.header else [""] * len(cells)
        self._names = [name or f"#{i}" for i, name in enumerate(named, 1)]
        units = next(rows, (0, []))[1] if form.header and form.units_row else []
        count = form.more_rows if form.header else 0
        self.left_out = list(itertools.islice(rows, count))
        self._units = {
            name: "" if PARTING.fullmatch(unit.strip().lower()) else plain_unit(unit)
            for name, unit in zip(self._names, units, strict=False)
        }
        self._example = next(rows, (0, []))[1] if form.header else cells
        self._unit_behind = [
            parted(cell)[1] if form.units_in_cells else "" for cell in self._example
        ]
        numbers = [self._bare(cell) for cell in self._example]
        self._lacks_header = form.header and is_row_of_numbers(
            [self._bare(cell) for cell in cells], [numbers]
        )
        self.notes += [
            f"{path}: line {line} holds numbers and was left out, as more_rows in [csv] says"
            for line, row in self.left_out
            if has_number(row)
        ]
        if self._lacks_header:
            self.notes.append(
                f"{path}: its first row, which holds numbers, was taken for names and left out; "
                "header = false in [csv] reads it"
            )

    def fields(self) -> list[Field]:
        """Every column, vectors number by number."""
        found = []
        for i, name in enumerate(self._names):
            text = self._bare(self._example[i]).strip() if i < len(self._example) else ""
            unit = self._units.get(name) or self._behind(i) or unit_in_brackets(name)
            count = len(numbers_in(text)) if list_in(text) is not None else 0
            if self._names.count(name) > 1:  # X of a position, and X of a rotation
                name = f"#{i + 1}"
            called = self._called(name, count)
            names = [f"{name}[{each}]" for each in called or range(count)] or [name]
            value = None if not count and is_text(text, self._form) else 0.0
            found += [
                Field(address, unit=unit, example=value, of=of)
                for address, of in zip(names, called or [""] * len(names), strict=True)
            ]
        return found

    def _called(self, name: str, count: int) -> list[str]:
        """What the first row calls the elements of a column's vector; none where it does not."""
        beside = names_beside(name, self._names)
        if beside is None or self._names.count(beside) > 1:
            return []
        called = texts_in(self._example[self._names.index(beside)])
        is_clear = len(called) == count == len({*called}) and not any(map(str.isdigit, called))
        return called if is_clear and all(called) else []

    def clock_of(self, address: str) -> Clock | None:
        """None: stamps are a column."""
        return None

    def read(self, addresses: Collection[str], stamps: Collection[str]) -> dict[str, Values]:
        """Read the columns of these addresses in one pass."""
        cells = [self._cell(address) for address in addresses]
        kept = {cell.address: _Growing() for cell in cells}
        del self._lines[:]
        for block in self._blocks():
            columns = list(zip(*block, strict=True))
            for cell in cells:
                is_stamp = cell.address in stamps
                texts = self._elements(cell, columns) if cell.is_listed else columns[cell.column]
                kept[cell.address].add(self._converted(cell, texts, is_stamp))
            require_values(self.path, len(cells) * len(self._lines))
        if not self._lines:
            raise UnusableInput(f"{self.path}: has no row below its header; record it again.")
        return {address: growing.whole() for address, growing in kept.items()}

    def rows(self) -> Iterator[list[str]]:
        """The cells of each row below the header, as texts."""
        yield from (
            cells for _, cells in itertools.islice(self._rows(), int(self._form.header), None)
        )

    def first_lines(self) -> list[tuple[int, Row]]:
        """The first lines that are no comments, each parted by what is most often in it."""
        marks = (self._form.comment or COMMENT, COMMENT)
        found = []
        with opened(self.path, self._form.encoding) as file:
            for number, line in itertools.islice(self._text_lines(file), _MOST_BEFORE):
                if not line.startswith(marks):
                    delimiter = self._form.delimiter or delimiter_of(line)
                    found.append((number, [cell.strip() for cell in cells_of(line, delimiter)]))
        return found

    def uneven(self) -> UnusableInput | None:
        """What is wrong with rows of another width than the header's; None where none is."""
        try:
            for _ in self._blocks():
                pass
        except UnusableInput as error:
            return error
        return None

    def named_cells_begin(self) -> int | None:
        """Lines before the first whose numbers have their names before them; None for none."""
        with opened(self.path, self._form.encoding) as file:
            return lines_before(self._from_header(self._text_lines(file)))

    def line(self, number: int) -> str:
        """A line of the text, the first of which is 1, without its end."""
        with opened(self.path, self._form.encoding) as file:
            return next(itertools.islice(file, number - 1, None), "").strip()

    def place(self, address: str, index: int) -> str:
        """The line of a row."""
        return f"line {self._lines[index]}"

    def _cell(self, address: str) -> _Cell:
        if (at := self._position(address)) is not None:
            return _Cell(address, at)
        column, name = by_name(address) or ("", "")
        column, index = (column, (None,)) if name else indexed(address)
        at, beside = self._position(column), names_beside(column, self._names)
        if at is None or len(index) != 1 or (name and beside is None):
            self._require_names(address)
            raise missing(self.path, address, self._names)
        names = None if beside is None else self._position(beside)
        return _Cell(address, at, index[0], name, names)

    def _require_names(self, address: str) -> None:
        """UnusableInput for a header of numbers, or of one name with another delimiter inside."""
        if self._lacks_header:
            reason = "is not there: the first row holds numbers, no names"
            advice = 'write [csv] header = false in columns.toml; "#1" is then the first column'
            raise refused(self.path, address, reason, advice)
        other = delimiter_of(self._names[0])
        if len(self._names) > 1 or other == self.delimiter or other not in self._names[0]:
            return
        reason = f"is not there: the header is one name, {self._names[0][:80]!r}"
        advice = f'write [csv] delimiter = "{written(other)}" in columns.toml'
        raise refused(self.path, address, reason, advice)

    def _position(self, name: str) -> int | None:
        if self._names.count(name) > 1:
            raise refused(self.path, name, "is there twice", "say which by its place, as in '#2'")
        if name in self._names:
            return self._names.index(name)
        place = re.fullmatch(r"#([1-9][0-9]{0,4})", name)
        return int(place[1]) - 1 if place and int(place[1]) <= len(self._names) else None

    # --- lines and rows

    def _blocks(self) -> Iterator[list[list[str]]]:
        """Rows of the header's width, some thousands at a time; the last may be cut off."""
        rows = itertools.islice(self._rows(), self._above_data, None)
        block: list[list[str]] = []
        width, torn = len(self._names), None
        for line, row in rows:
            if torn is not None:
                raise self._uneven(*torn)
            if len(row) != width:
                torn = line, row
                if len(row) > width:
                    raise self._uneven(*torn)
                continue
            block.append(row)
            self._lines.append(line)
            if len(block) == _BLOCK:
                yield block
                block = []
        if self._again:
            more = f" and {len(self._again) - 1} more" if len(self._again) > 1 else ""
            self.notes.append(
                f"{self.path}: its header stands again in line {self._again[0]}{more} and was left "
                "out there"
            )
        if self._nameless:
            more = f" and {len(self._nameless) - 1} more" if len(self._nameless) > 1 else ""
            self.notes.append(
                f"{self.path}: line {self._nameless[0]}{more} has no number with its name, and was "
                "left out"
            )
        if torn is not None:
            self.notes.append(f"{self.path}: its last line is cut off and was left out")
        if block:
            yield block

    def _behind(self, column: int) -> str:
        """The unit behind the numbers of a column, if they have one there."""
        return self._unit_behind[column] if column < len(self._unit_behind) else ""

    def _bare(self, cell: str) -> str:
        """A cell without a unit behind its number."""
        return parted(cell)[0] if self._form.units_in_cells else cell

    @property
    def _above_data(self) -> int:
        """Rows of the header, of the units and of what else stands above the data."""
        form = self._form
        return 1 + form.units_row + form.more_rows if form.header else 0

    def _uneven(self, line: int, row: Sequence[str]) -> UnusableInput:
        return UnusableInput(
            f"{self.path}, line {line}: has {len(row)} fields, but the header {len(self._names)};"
            " mend the line or delete it."
        )

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        """Each row with the number of its line; the first one shows the delimiter."""
        try:
            with opened(self.path, self._form.encoding) as file:
                lines = self._from_header(self._text_lines(file))
                if self._form.names_in_cells:
                    self._nameless = []
                    yield from named_rows(self.path, lines, self._nameless)
                else:
                    yield from self._evened(self._parsed(lines))
        except UnicodeError as error:
            seen = seen_encoding(self.path)
            is_same = seen.removesuffix("-sig") == self._form.encoding.removesuffix("-sig")
            other = "latin-1" if is_same else seen
            raise UnusableInput(
                f"{self.path}: is not text in {self._form.encoding} ({one_line(error)}); write "
                f'[csv] encoding = "{other}" in columns.toml.'
            ) from error
        except (OSError, EOFError, zlib.error, csv.Error, ValueError) as error:
            raise UnusableInput(
                f"{self.path}: cannot be read as a table of text ({one_line(error)}); copy it"
                " again, or say in [csv] how it is written."
            ) from error

    def _evened(self, rows: Iterator[tuple[int, list[str]]]) -> Iterator[tuple[int, list[str]]]:
        """Rows without the blank cell that a delimiter at their end makes, and the header once.

        Some loggers write the header again whenever they start, and the units below it.
        """
        begin = list(itertools.islice(rows, 2))
        if not begin:
            return
        number, names = begin[0]
        if len(begin) > 1 and not names[-1].strip() and len(begin[1][1]) == len(names) - 1:
            names = names[:-1]
        yield number, names
        is_named = self._form.header and any(
            not (is_missing(name) or is_number(name.strip())) for name in names
        )
        self._again, is_longer = list[int](), False
        for number, row in itertools.chain(begin[1:], rows):
            if not row[-1].strip() and len(row) == len(names) + 1:
                row, is_longer = row[:-1], True
            elif not row[-1].strip() and len(row) == len(names) and is_longer:
                row = row[:-1]  # the others have one more delimiter: it is cut off
            if is_named and row == names:
                self._again.append(number)
            elif self._again and row == begin[1][1] and not any(map(begins_as_data, row)):
                continue
            else:
                yield number, row

    def _text_lines(self, file: IO[str]) -> Iterator[tuple[int, str]]:
        """Lines below those to skip that are not blank, each with its number and with an end."""
        size = 0
        for number in range(1, MOST_BYTES):
            line = file.readline(LONGEST_LINE)
            size += len(line)
            if not line:
                return
            if len(line) == LONGEST_LINE or size > MOST_BYTES:
                raise ValueError(f"line {number} has no end, or the text none")
            if number > self._form.skip_rows and line.strip():
                yield number, line

    def _from_header(self, lines: Iterator[tuple[int, str]]) -> Iterator[tuple[int, str]]:
        """Lines from the header on; comments before it are left out, whether or not it is stated.

        A header may be such a comment itself: the last one, if it names what the first row holds.
        """
        mark = self._form.comment or COMMENT
        last: tuple[int, str] | None = None
        for number, line in lines:
            if line.startswith(mark):
                last = number, line.removeprefix(mark).lstrip(f"{mark} ")
                continue
            if last is not None and self._form.header and self._is_named_by(line, last[1]):
                yield last
            yield number, line
            last = None
            break
        if last is not None and self._form.header and last[1].strip():
            yield last  # of a log without rows
        stated = self._form.comment
        yield from (row for row in lines if not (stated and row[1].startswith(stated)))

    def _is_named_by(self, row: str, header: str) -> bool:
        """Whether a line holds numbers, and a comment before it as many names."""
        delimiter = self._form.delimiter or delimiter_of(header)
        cells, names = (cells_of(line, delimiter) for line in (row, header))
        has_numbers = any(not is_text(cell, self._form) for cell in cells if cell.strip())
        is_of_names = all(name.strip() and is_text(name, self._form) for name in names)
        return has_numbers and is_of_names and len(cells) == len(names)

    def _parsed(self, lines: Iterator[tuple[int, str]]) -> Iterator[tuple[int, list[str]]]:
        first = next(lines, None)
        if first is None:
            return
        number, line = first
        delimiter = self._form.delimiter or delimiter_of(line)
        self.delimiter = delimiter
        if delimiter == " ":
            yield number, cells_between_spaces(line)
            yield from ((n, cells_between_spaces(text)) for n, text in lines)
            return
        at = [number]

        def fed() -> Iterator[str]:
            yield line
            for at[0], text in lines:
                yield text

        for row in csv.reader(fed(), delimiter=delimiter, skipinitialspace=True):
            yield at[0], row

    # --- cells

    def _converted(self, cell: _Cell, texts: Sequence[str], is_stamp: bool) -> Values:
        if behind := self._behind(cell.column):
            first = len(self._lines) - len(texts)
            texts = [self._without(behind, cell, text, first + i) for i, text in enumerate(texts)]
        if self._form.decimal == "," or self._form.thousands:
            texts = [plain_number(text, self._form) for text in texts]
        joined = "".join(texts)
        if joined.isascii() and "_" not in joined:
            try:
                if is_stamp:
                    return np.array(array("q", map(int, texts)))
            except (ValueError, OverflowError):
                pass
            try:
                return np.array(array("d", map(float, texts)))
            except ValueError:
                pass
        if is_stamp and not all(map(is_number_or_absent, texts)):
            return np.array([text.strip() for text in texts], dtype=object)
        first = len(self._lines) - len(texts)
        return np.array([self._number(cell, text, first + i) for i, text in enumerate(texts)])

    def _number(self, cell: _Cell, text: str, index: int) -> float:
        plain = text.strip()
        folded = plain.lower()
        if is_missing(plain):
            return float("nan")
        if folded in BOOLEAN:
            return BOOLEAN[folded]
        if not is_number(plain):
            reason = f"holds {plain[:40]!r} in line {self._lines[index]}, which is no number"
            raise refused(self.path, cell.address, reason, self._advice_on_text(plain))
        return float(plain)

    def _without(self, unit: str, cell: _Cell, text: str, index: int) -> str:
        """A number without the unit behind it; UnusableInput where it has none or another."""
        bare = text.strip()
        if is_missing(bare):
            return bare
        if not bare.endswith(unit) or parted(bare)[1] != unit:
            reason = f"holds {bare[:40]!r} in line {self._lines[index]}, and others end in {unit}"
            raise refused(self.path, cell.address, reason, "mend it, or leave the column out")
        return bare.removesuffix(unit).rstrip()

    def require_unit(self, address: str, unit: str) -> None:
        """UnusableInput where the numbers of a column have another unit behind them."""
        if not self._form.units_in_cells:
            return
        if not any(self._unit_behind):
            raise UnusableInput(
                f"{self.path}: has no unit behind a number, and [csv] units_in_cells says that it "
                "has; give it a columns.toml of its own."
            )
        behind = self._behind(self._cell(address).column)
        if behind and not same_unit(behind, unit):
            reason = f"has numbers in {behind}, and columns.toml says {unit}"
            raise refused(self.path, address, reason, "give it a columns.toml of its own")

    def _advice_on_text(self, cell: str) -> str:
        """What to do about a cell that is no number as the table is said to be written."""
        if mark := thousands_mark([[cell]], self.delimiter):
            decimal = ' and decimal = ","' if mark == "." else ""
            return f'write [csv] thousands = "{mark}"{decimal} in columns.toml'
        if self._form.decimal == "." and WITH_COMMA.fullmatch(cell):
            return (
                'where numbers have commas before their decimals, write [csv] decimal = "," and'
                f' delimiter = "{written(self.delimiter)}" in columns.toml'
            )
        if _WORD.search(cell):
            return "mend it, leave the column out, or write a column of 0 and 1 for each such word"
        return "mend it, or leave the column out"

    def _elements(self, cell: _Cell, columns: Sequence[Sequence[str]]) -> list[str]:
        """One number of the vector in each cell of a block; blank where there is none."""
        texts = columns[cell.column]
        if cell.names is None:
            return [self._element(cell, text, cell.element) for text in texts]
        called = {names: texts_in(names) for names in set(columns[cell.names])}
        return [
            self._element(cell, text, self._element_at(cell, called[names], len(texts) - i))
            for i, (text, names) in enumerate(zip(texts, columns[cell.names], strict=True))
        ]

    def _element_at(self, cell: _Cell, called: Sequence[str], before: int) -> int | None:
        """The element of a row that is so many lines from the last one; None where it has none."""
        if cell.element is None:
            return called.index(cell.name) if cell.name in called else None
        now = called[cell.element] if cell.element < len(called) else ""
        known = self._of.setdefault(cell.address, now)
        if now != known:
            reason = f"is that of {now!r} in line {self._lines[-before]}, and above of {known!r}"
            column, _ = indexed(cell.address)
            advice = f'give the name in place of the index: "{column}[{known}]"'
            raise refused(self.path, cell.address, reason, advice)
        return cell.element

    def _element(self, cell: _Cell, text: str, element: int | None) -> str:
        numbers = numbers_in(text)
        if not numbers or element is None:
            return ""
        if element >= len(numbers):
            line = self._lines[len(self._lines) - 1] if self._lines else 0
            reason = f"has only {len(numbers)} numbers in a cell at or before line {line}"
            raise refused(self.path, cell.address, reason, "mend it, or give another index")
        return numbers[element]


class _Growing:
    """A column that comes in blocks: whole numbers as long as all are, texts once one is."""

    def __init__(self) -> None:
        self._parts: list[Values] = []

    def add(self, part: Values) -> None:
        self._parts.append(part)

    def whole(self) -> Values:
        if any(part.dtype == object for part in self._parts):
            return np.concatenate([part.astype(object) for part in self._parts])
        return np.concatenate(self._parts)


def seen_encoding(path: Path) -> Encoding:
    """How a text is encoded, as far as its begin shows: Unicode, or else as Windows writes it."""
    try:
        with path.open("rb") as file:
            begin = file.read(_LOOKED_AT_BYTES)
        if path.suffix.lower() == ".gz":  # as far as it goes: it may be cut off
            begin = zlib.decompressobj(_OF_GZIP).decompress(begin, _LOOKED_AT_BYTES)
    except (OSError, zlib.error):  # who reads it says so
        return "latin-1"
    if begin.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(begin)  # its end may be cut
    except UnicodeError:
        return "latin-1" if set(begin) & _NOT_IN_CP1252 else "cp1252"
    return "utf-8-sig"


def opened(path: Path, encoding: str) -> IO[str]:
    """A text, gzipped or not, with lines as they end in it."""
    if path.suffix.lower() == ".gz":
        return gzip.open(path, "rt", encoding=encoding, newline="")
    return path.open(encoding=encoding, newline="")
