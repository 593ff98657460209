"""MATLAB files, as far as recordings need them: real numeric arrays of versions 5 to 7.

Written out rather than taken from SciPy, whose reader ends the whole process on some damaged files.
The layout is that of MathWorks' "MAT-File Format", level 5: a header of 128 bytes, then elements,
each with a tag of type and size, padded to 8 bytes, zlib-compressed or not. The fields of a struct
are variables called as HDF5 calls them: `log/x`.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.archive import MOST_BYTES

_HEADER_BYTES = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBER_TYPES = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
_NUMBER_CLASSES = range(6, 16)  # double, single and the integers
_STRUCT, _OPAQUE = 2, 17  # the latter is of a class of its own, and has no dimensions
_OTHER_CLASSES = {
    1: ("is a cell array", "s = struct('x', cell2mat({name}))"),
    3: ("is an object", "s = struct({name})"),
    4: ("is text", ""),
    5: ("is a sparse array", "s = struct('x', full({name}))"),
    16: ("is a function", ""),
}
_OF_A_CLASS = {
    "timeseries": "s = struct('t', {name}.Time, 'x', {name}.Data)",
    "timetable": "s = struct('t', seconds({name}.Time - {name}.Time(1)), 'x', {name}.x)",
    "table": "s = struct('t', {name}.t, 'x', {name}.x)",
}
_COMPLEX = 0x0800
_COMPLEX_NUMBERS = ("holds complex numbers", "s = struct('x', real({name}))")
_DEEPEST, _MOST_VARIABLES = 16, 10_000  # of structs in structs; of all fields together

Bytes = bytes | memoryview
Element = tuple[int, Bytes]  # type, content


class Unread(NamedTuple):
    """A variable that is no array of real numbers: what it is, and what helps in MATLAB, or ""."""

    reason: str
    advice: str


Variable = NDArray[np.float64] | Unread


def read_mat(path: Path) -> dict[str, Variable]:
    """The variables of a MATLAB file by name, float64; `Unread` for one that is not real numbers.

    A struct gives its fields, `log/x` and `log/arm/q`. Raises ValueError for what is damaged or
    another format, OSError for what cannot be read.
    """
    content = path.read_bytes()
    if content[:8] == b"\x89HDF\r\n\x1a\n" or content.startswith(b"MATLAB 7.3"):
        raise ValueError("version 7.3; save it again with: save(…, '-v7')")
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None or len(content) < _HEADER_BYTES:
        raise ValueError("not a MATLAB file of version 5 to 7")
    try:
        return dict(_Reader(order).variables(memoryview(content)[_HEADER_BYTES:]))
    except (struct.error, zlib.error, UnicodeDecodeError) as error:
        raise ValueError(f"damaged: {error}") from error


class _Reader:
    """What is read of a file, within bounds that all of its variables share."""

    def __init__(self, order: str) -> None:
        self._order, self._room, self._count = order, MOST_BYTES, 0

    def variables(self, body: Bytes) -> Iterator[tuple[str, Variable]]:
        """Every variable and every field, by name."""
        for kind, content in _elements(body, self._order):
            if kind == _COMPRESSED:
                kind, content = next(
                    iter(_elements(_unpacked(content, self._room), self._order)), (0, b"")
                )
            if kind != _MATRIX:
                raise ValueError(f"damaged: an element of type {kind} where a variable should be")
            room = self._room
            yield from self._variable(content, "")
            self._take(max(len(content) - (room - self._room), 0))

    def _variable(
        self, content: Bytes, called: str, depth: int = 0
    ) -> Iterator[tuple[str, Variable]]:
        """A matrix element, which is called by its own name, or as the field that it is."""
        parts = _elements(content, self._order)
        (flags,) = struct.unpack(f"{self._order}I", _next(parts)[:4])
        kind = flags & 0xFF
        dimensions = b"" if kind == _OPAQUE else _next(parts)
        name = called or _text(_next(parts))
        if called:
            next(parts, None)
        if not name:  # what MATLAB keeps for objects is no variable
            return
        self._count_one()
        shape = struct.unpack(f"{self._order}{len(dimensions) // 4}i", dimensions)
        if kind == _STRUCT and math.prod(shape) == 1:
            yield from self._fields(parts, name, depth)
        elif kind in _NUMBER_CLASSES and not flags & _COMPLEX:
            yield name, self._numbers(parts, name, shape)
        else:
            yield name, _unread(kind, parts, name, shape)

    def _fields(
        self, parts: Iterator[Element], group: str, depth: int
    ) -> Iterator[tuple[str, Variable]]:
        """The fields of a struct: the length of their names, the names, and a matrix for each."""
        if depth == _DEEPEST:
            raise ValueError(f"{group[:40]} holds structs in structs, more than {_DEEPEST} deep")
        (length,) = struct.unpack(f"{self._order}i", _next(parts))
        names = _next(parts)
        if length < 1 or len(names) % length:
            raise ValueError(f"damaged: {group} has no names for its fields")
        for at in range(0, len(names), length):
            kind, content = next(parts, (0, b""))
            if kind != _MATRIX:
                raise ValueError(f"damaged: {group} has fewer fields than names")
            name = f"{group}/{_text(names[at : at + length])}"
            if len(content):
                yield from self._variable(content, name, depth + 1)
            else:  # a field that was never filled
                self._count_one()
                yield name, np.empty((0, 0))

    def _numbers(
        self, parts: Iterator[Element], name: str, shape: tuple[int, ...]
    ) -> NDArray[np.float64]:
        kind, numbers = next(parts, (0, b""))
        if kind not in _NUMBER_TYPES:
            raise ValueError(f"damaged: {name} has numbers of unknown type {kind}")
        values = np.frombuffer(numbers, dtype=f"{self._order}{_NUMBER_TYPES[kind]}")
        if min(shape, default=-1) < 0 or math.prod(shape) != len(values):
            raise ValueError(f"damaged: {name} has {len(values)} numbers for shape {shape}")
        self._take(8 * len(values))
        return values.astype(np.float64).reshape(shape, order="F")

    def _count_one(self) -> None:
        self._count += 1
        if self._count > _MOST_VARIABLES:
            raise ValueError(f"holds more than {_MOST_VARIABLES} variables")

    def _take(self, count: int) -> None:
        self._room -= count
        if self._room < 0:
            raise ValueError(f"takes more than {MOST_BYTES >> 20} MiB unpacked")


def _next(parts: Iterator[Element]) -> Bytes:
    """The content of the next element; empty where there is none."""
    return next(parts, (0, b""))[1]


def _text(content: Bytes) -> str:
    """A name, which zeros may follow."""
    return bytes(content).partition(b"\0")[0].decode("ascii")


def _unread(kind: int, parts: Iterator[Element], name: str, shape: tuple[int, ...]) -> Unread:
    """What a variable is that is not read, with the line that makes a struct of arrays of it."""
    reason, made = _OTHER_CLASSES.get(kind, _COMPLEX_NUMBERS)
    if kind == _STRUCT:
        reason = f"is a struct array of {' x '.join(map(str, shape))}"
        made = "s = struct('t', [{name}.t], 'x', [{name}.x])"
    if kind == _OPAQUE:
        _next(parts)  # the system of classes
        of = _text(_next(parts))[:40]
        reason = f"is a {of or 'class of its own'}"
        made = _OF_A_CLASS.get(of, "s = struct('t', …, 'x', …)")
    if not made:
        return Unread(reason, "")
    line = made.format(name=name.replace("/", "."))
    return Unread(reason, f"in MATLAB: {line}; save log.mat -struct s")


def _unpacked(content: Bytes, room: int) -> bytes:
    unpacking = zlib.decompressobj()
    unpacked = unpacking.decompress(content, room + 1)
    if len(unpacked) > room:
        raise ValueError(f"takes more than {MOST_BYTES >> 20} MiB unpacked")
    if not unpacking.eof:
        raise ValueError("damaged: a compressed variable is cut off")
    return unpacked


def _elements(content: Bytes, order: str) -> Iterator[Element]:
    """Each element in turn; one of at most four bytes lies within its own tag."""
    at = 0
    while at < len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        start = at + 8
        if kind >> 16:
            kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
        if start + size > len(content) or (start == at + 4 and size > 4):
            raise ValueError(f"damaged: it ends within an element of {size} bytes")
        yield kind, content[start : start + size]
        padded = 0 if kind == _COMPRESSED else -size % 8
        at = at + 8 if start == at + 4 else start + size + padded
