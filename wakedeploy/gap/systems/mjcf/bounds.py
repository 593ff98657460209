"""What an MJCF file may ask for, before MuJoCo reads it: MuJoCo itself knows no end.

In: a file. Out: nothing, or UnusableInput for text that is not UTF-8 or no XML, for numbers that
are none, and for a model so large that reading it takes minutes or all memory.
"""

import math
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from wakedeploy.core.errors import UnusableInput, one_line, why
from wakedeploy.core.files import text_of

_LARGEST = 1e15  # in any unit, nothing that was measured is so large
_LARGEST_COUNT = 1e5  # rows, pixels, samples, iterations: MuJoCo allocates or loops that often
_MOST_ELEMENTS = 5000  # a humanoid has some hundred; ten thousand bodies take ten seconds
_DIGITS = 9  # no count of elements has more
_COUNTS = frozenset({
    "nsample", "nrow", "ncol", "width", "height", "maxhullvert", "iterations", "ls_iterations",
    "noslip_iterations", "ccd_iterations", "sdf_iterations", "sdf_initpoints",
})  # fmt: skip


def require_bounded(path: Path) -> None:
    """Raise UnusableInput for a file, or one that it includes, that MuJoCo should not be given."""
    elements, waiting, seen = 0, [path], set()
    while waiting:
        file = waiting.pop()
        if file.resolve() in seen:
            continue
        seen.add(file.resolve())
        reader = _Reader(path, file)
        reader.read()
        elements += reader.elements
        if elements > _MOST_ELEMENTS:
            raise UnusableInput(
                f"{path}: the model has more than {_MOST_ELEMENTS} elements; give a smaller one."
            )
        waiting += reader.included


class _Reader:
    """Reads one file; `elements` are counted as often as the file has them repeated."""

    def __init__(self, model: Path, file: Path) -> None:
        self._model, self._file = model, file
        self._repeats = [1]
        self.elements = 0
        self.included: list[Path] = []

    def read(self) -> None:
        """Look at every element."""
        try:
            text = text_of(self._file)
        except OSError as error:
            self._refuse(f"it cannot be read ({why(error)})")
        except ValueError as error:  # UnicodeDecodeError is one
            self._refuse(f"it is no UTF-8 text ({one_line(error)})")
        parser = expat.ParserCreate("utf-8")
        parser.StartElementHandler = self._begin
        parser.EndElementHandler = self._end
        parser.StartDoctypeDeclHandler = self._declare
        try:
            parser.Parse(text, True)
        except (expat.ExpatError, ValueError) as error:
            self._refuse(f"it is no XML ({one_line(error)})")

    def _begin(self, name: str, attributes: dict[str, str]) -> None:
        repeats = self._repeats[-1] * _repeated(attributes.get("count", ""))
        self._repeats.append(repeats)
        self.elements += min(repeats, _MOST_ELEMENTS + 1)
        for attribute, value in attributes.items():
            is_count = name == "size" or attribute in _COUNTS
            limit = _LARGEST_COUNT if is_count else _LARGEST
            for word in value.split():
                if not _is_within(word, limit):
                    self._refuse(f"{name} has {attribute}={value[:40]!r}")
        if name == "include" and "file" in attributes:
            self.included.append(self._model.parent / attributes["file"])

    def _end(self, name: str) -> None:
        self._repeats.pop()

    def _declare(self, *declaration: object) -> None:
        """Entities can make a few lines into gigabytes, and no MJCF file needs any."""
        self._refuse("it declares a document type")

    def _refuse(self, reason: str) -> NoReturn:
        including = "" if self._file == self._model else f" (included by {self._model})"
        raise UnusableInput(f"{self._file}{including}: {reason}; mend the file.")


def _repeated(count: str) -> int:
    """How many elements a `count` stands for: 3, or 2·2·5 for a composite."""
    return max(1, math.prod(_counted(word.removeprefix("+")) for word in count.split()))


def _counted(digits: str) -> int:
    """A word's number; of nine digits or more, simply too many. A word that is none counts once."""
    if not digits.isdecimal():
        return 1
    return int(digits) if len(digits) < _DIGITS else 10**_DIGITS


def _is_within(word: str, limit: float) -> bool:
    """Whether a word is no number, or one within ±`limit`."""
    try:
        return abs(float(word)) <= limit  # false for NaN
    except ValueError:
        return True
