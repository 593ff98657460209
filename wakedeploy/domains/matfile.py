"""MATLAB files, as far as recordings need them: real numeric arrays of versions 5 to 7.

Written out rather than taken from SciPy, whose reader ends the whole process on some damaged files.
The layout is that of MathWorks' "MAT-File Format", level 5: a header of 128 bytes, then elements,
each with a tag of type and size, padded to 8 bytes, zlib-compressed or not.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.archive import MOST_BYTES

_HEADER_BYTES = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBER_TYPES = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8",
}  # fmt: skip
_NUMBER_CLASSES = range(6, 16)  # double, single and the integers
_COMPLEX = 0x0800

Element = tuple[int, bytes]  # type, content


def read_mat(path: Path) -> dict[str, NDArray[np.float64] | None]:
    """The variables of a MATLAB file by name, float64; None for one that is not real numbers.

    Raises ValueError for what is damaged or another format, OSError for what cannot be read.
    """
    content = path.read_bytes()
    if content[:8] == b"\x89HDF\r\n\x1a\n" or content.startswith(b"MATLAB 7.3"):
        raise ValueError("version 7.3; save it again with: save(…, '-v7')")
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None or len(content) < _HEADER_BYTES:
        raise ValueError("not a MATLAB file of version 5 to 7")
    try:
        return dict(_variables(content[_HEADER_BYTES:], order))
    except (struct.error, zlib.error, UnicodeDecodeError) as error:
        raise ValueError(f"damaged: {error}") from error


def _variables(body: bytes, order: str) -> Iterator[tuple[str, NDArray[np.float64] | None]]:
    room = MOST_BYTES
    for kind, content in _elements(body, order):
        if kind == _COMPRESSED:
            (kind, content), *_ = _elements(_unpacked(content, room), order)
        if kind != _MATRIX:
            raise ValueError(f"damaged: an element of type {kind} where a variable should stand")
        name, values = _variable(content, order)
        room -= max(len(content), 0 if values is None else values.nbytes)
        if room < 0:
            raise ValueError(f"takes more than {MOST_BYTES >> 20} MiB unpacked")
        yield name, values


def _unpacked(content: bytes, room: int) -> bytes:
    unpacking = zlib.decompressobj()
    unpacked = unpacking.decompress(content, room + 1)
    if len(unpacked) > room:
        raise ValueError(f"takes more than {MOST_BYTES >> 20} MiB unpacked")
    if not unpacking.eof:
        raise ValueError("damaged: a compressed variable is cut off")
    return unpacked


def _variable(content: bytes, order: str) -> tuple[str, NDArray[np.float64] | None]:
    """Name and array of a matrix element: flags, dimensions, name, then the real part."""
    parts = _elements(content, order)
    (_, flags_part), (_, dimensions), (_, name_part) = (next(parts, (0, b"")) for _ in range(3))
    (flags,) = struct.unpack(f"{order}I", flags_part[:4])
    name = name_part.decode("ascii")
    if flags & 0xFF not in _NUMBER_CLASSES or flags & _COMPLEX:
        return name, None
    kind, numbers = next(parts, (0, b""))
    if kind not in _NUMBER_TYPES:
        raise ValueError(f"damaged: {name} has numbers of unknown type {kind}")
    values = np.frombuffer(numbers, dtype=f"{order}{_NUMBER_TYPES[kind]}")
    shape = struct.unpack(f"{order}{len(dimensions) // 4}i", dimensions)
    if min(shape, default=-1) < 0 or math.prod(shape) != len(values):
        raise ValueError(f"damaged: {name} has {len(values)} numbers for shape {shape}")
    if 8 * len(values) > MOST_BYTES:
        raise ValueError(f"{name} takes more than {MOST_BYTES >> 20} MiB")
    return name, values.astype(np.float64).reshape(shape, order="F")


def _elements(content: bytes, order: str) -> Iterator[Element]:
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
