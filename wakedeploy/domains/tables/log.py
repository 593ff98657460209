"""What every kind of log offers: its fields, a clock for each, and their numbers.

In: the reader of a format. Out: a `Log`, and what every reader needs: bounds, addresses of numbers
in arrays, sentences for what cannot be read. A log is read only as far as it is asked for, and
never beyond the bounds below, whatever the file says of itself. `log_kinds` opens one.
"""

import importlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.errors import UnusableInput, installs, one_line

MOST_BYTES = 2 << 30  # of a file, unpacked
MOST_VALUES = 64 << 20  # of all columns that are read of a file: 512 MiB

Values = NDArray[Any]


@dataclass(frozen=True)
class Field:
    """A column that a log has, by its address; `unit` where the format keeps one.

    `topic` groups fields with one clock; `example` is the first sample, None for a text. `remark`
    is on a unit that a format leaves open. A field of a message whose type is known `is_typed`; one
    that `is_aside` is no measurement, as a covariance. `unread` is why a field holds no
    numbers, with what to do about it. `of` is the joint, model or frame whose number it is, by the
    names in the first messages.
    """

    name: str
    topic: str = ""
    unit: str | None = None
    example: float | None = 0.0
    remark: str = ""
    is_typed: bool = False
    is_aside: bool = False
    unread: str = ""
    of: str = ""


class Clock(NamedTuple):
    """The address of stamps, and the unit that they count in.

    Where `nanoseconds` is the address of those beyond whole seconds, both together count in ns.
    """

    address: str
    unit: str
    nanoseconds: str | None = None


class Log(Protocol):
    """An opened log. All methods raise UnusableInput with file, field and reason."""

    path: Path
    notes: list[str]  # what was noticed and gone on with

    def fields(self) -> list[Field]:
        """Every field that can be asked for."""

    def clock_of(self, address: str) -> Clock | None:
        """The log's own clock of a field; None where stamps are a column like any other."""

    def read(self, addresses: Collection[str], stamps: Collection[str]) -> dict[str, Values]:
        """Fields (n,) by address; of those in `stamps` whole numbers stay whole, texts texts.

        Numbers that are not there are NaN.
        """

    def place(self, address: str, index: int) -> str:
        """Where a sample of a field stands: "line 12"."""


def library(path: Path, module: str, package: str, extra: str) -> Any:
    """A library that an extra brings; UnusableInput says how to install it where it is absent."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise UnusableInput(f"{path}: needs {package}: {installs(extra)}.") from error


def unreadable(path: Path, error: BaseException) -> UnusableInput:
    """The sentence for a file that its reader cannot make sense of."""
    return UnusableInput(f"{path}: cannot be read ({one_line(error)}); copy or record it again.")


def refused(path: Path, column: str, reason: str, advice: str) -> UnusableInput:
    """The sentence for a column that cannot be used."""
    return UnusableInput(f"{path}: column {column!r} {reason}; {advice}.")


def require_size(path: Path) -> int:
    """The size of a file; UnusableInput for one that is too large or cannot be read."""
    try:
        size = path.stat().st_size
    except OSError as error:
        raise unreadable(path, error) from error
    if size > MOST_BYTES:
        raise UnusableInput(
            f"{path}: has {size / 2**30:.1f} GiB, and {MOST_BYTES >> 30} are the most; cut it."
        )
    return size


def missing(path: Path, address: str, there: Collection[str]) -> UnusableInput:
    """The sentence for a field that a log does not have, with those that are near."""
    import difflib

    folded = {name.lower(): name for name in there}
    close = [folded[n] for n in difflib.get_close_matches(address.lower(), folded, 3, 0.5)]
    hint = close or list(there)[:8]
    what_is_there = f"it has {', '.join(map(repr, hint))}" if hint else "it has none"
    return refused(path, address, "is not there", what_is_there + (" and others" if close else ""))


class Arrays:
    """Whole arrays of a file as fields: (n,), or (n, k) of which an index chooses, as in `x[2]`.

    The longer axis of a table is time, since MATLAB's users write it either way.
    """

    def __init__(self, path: Path, shapes: Mapping[str, tuple[int, ...]]) -> None:
        self.path = path
        self.shapes = shapes

    def split(self, address: str) -> tuple[str, tuple[int, ...]]:
        """The array of an address, and the index of one number in each sample."""
        name, index = indexed(address)
        if address in self.shapes:
            name, index = address, ()
        if name not in self.shapes:
            raise missing(self.path, address, self.shapes)
        return name, index

    def column(self, address: str, array: Values) -> Values:
        """The column (n,) that an address chooses of its array."""
        _, index = self.split(address)
        upright = time_first(array)
        inner = upright.shape[1:]
        if not index and inner:
            last = ", ".join(str(n - 1) for n in inner)
            advice = f"say which, up to {address}[{last}]"
            raise refused(self.path, address, f"holds {inner} numbers a sample", advice)
        if len(index) != len(inner) or any(i >= n for i, n in zip(index, inner, strict=False)):
            raise refused(self.path, address, f"has no such number in {inner}", "give another")
        chosen: Values = upright[(slice(None), *index)]  # type: ignore[arg-type]  # NumPy's own
        return chosen


def indexed(address: str) -> tuple[str, tuple[int, ...]]:
    """An address without its index, and the index: "x[2]" or "x[2, 1]"."""
    if not address.endswith("]") or "[" not in address:
        return address, ()
    name, _, inside = address[:-1].rpartition("[")
    parts = [part.strip() for part in inside.split(",")]
    if not all(part.isascii() and part.isdigit() and len(part) < 8 for part in parts):
        return address, ()
    return name, tuple(map(int, parts))


def time_first(array: Values) -> Values:
    """An array whose first axis is time; a table of one row or column becomes (n,)."""
    if array.ndim == 2:
        array = array.T if array.shape[0] < array.shape[1] else array
        return array[:, 0] if array.shape[1] == 1 else array
    return array.reshape(1) if array.ndim == 0 else array


def elements(name: str, shape: tuple[int, ...], most: int = 32) -> list[str]:
    """The addresses of the numbers in each sample of an array of this shape."""
    if len(shape) == 2:
        shape = (max(shape), min(shape))
    inner = shape[1:]
    if not inner or inner == (1,):
        return [name]
    count = min(int(np.prod(inner)), most)
    indices = (np.unravel_index(i, inner) for i in range(count))
    return [f"{name}[{', '.join(str(int(i)) for i in index)}]" for index in indices]


def require_values(path: Path, count: int) -> None:
    """Refuse what would take more memory than there may be."""
    if count > MOST_VALUES:
        raise UnusableInput(
            f"{path}: the columns hold {count} numbers, and {MOST_VALUES} are the most; cut it, or"
            " use fewer columns."
        )
