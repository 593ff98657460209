"""Damage that needs no knowledge of the format: to bytes, to text, to its encoding.

Every function takes a source of chance, the content, and the content of another sound file of the
same kind; it gives the damaged content.
"""

import codecs
import random
import re
from collections.abc import Callable

Mutator = Callable[[random.Random, bytes, bytes], bytes]

LONG = 200_000  # letters of a line that is too long, and levels of what is nested too deeply
NUMBERS = (
    "nan", "inf", "-inf", "NaN", "Infinity", "-Infinity", "1e308", "-1e308", "1e999", "1e-400",
    "-0", "-0.0", "0", "1", "-1", "2", "0.5", "255", "65536", "2147483648", "9223372036854775807",
    "9223372036854775808", "18446744073709551616", "1000000000", "1" + "0" * 30, "1" * 400,
    "1" * 5000, "0x10", "1_000", "+1", ".5", "1.", "1e", "--1", "1,5", "٣", "true", "null", "",
)  # fmt: skip
STRANGE = (
    b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"\xc3", b"\xed\xa0\x80", b"\x1b[2J", b"\r", b"\n",
    "\u202e".encode(), "\u2028".encode(), "\x85".encode(), "é".encode(), b'"', b"'", b"\\", b"{",
    b"}", b"[", b"]", b",", b"=", b"#", b"\t", b"\\u0000", b"\\ud800", b"%s", b"{0}", b"$(true)",
)  # fmt: skip
ENCODINGS = ("utf-16", "utf-16-le", "utf-32", "latin-1", "utf-7", "utf-8-sig", "cp1252")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")


def damaged(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """Bytes flipped, cut, doubled, moved, put in, or taken from another file."""
    for _ in range(draw.choice((1, 1, 1, 2, 4))):
        data = draw.choice(_BYTE_WAYS)(draw, data, other)
    return data


def reworded(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """Text with other numbers, strange letters, lines moved, nested brackets, or encodings."""
    for _ in range(draw.choice((1, 1, 2))):
        data = draw.choice(_TEXT_WAYS)(draw, data, other)
    return data


def _span(draw: random.Random, data: bytes) -> tuple[int, int]:
    """A part of the content, mostly a short one."""
    start = draw.randrange(len(data) + 1)
    return start, min(len(data), start + draw.choice((1, 2, 8, 64, 512, len(data))))


def _flipped(draw: random.Random, data: bytes, other: bytes) -> bytes:
    if not data:
        return draw.randbytes(1)
    at = draw.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << draw.randrange(8)]) + data[at + 1 :]


def _overwritten(draw: random.Random, data: bytes, other: bytes) -> bytes:
    start, _ = _span(draw, data)
    new = draw.choice((draw.randbytes(4), b"\xff" * 8, b"\x00" * 8, b"\x7f" * 4, b"\x80" * 2))
    return data[:start] + new + data[start + len(new) :]


def _cut(draw: random.Random, data: bytes, other: bytes) -> bytes:
    return data[: _span(draw, data)[0]]


def _without(draw: random.Random, data: bytes, other: bytes) -> bytes:
    start, end = _span(draw, data)
    return data[:start] + data[end:]


def _doubled(draw: random.Random, data: bytes, other: bytes) -> bytes:
    start, end = _span(draw, data)
    times = draw.choice((2, 3, 50)) if end - start < 1000 else 2
    return data[:start] + data[start:end] * times + data[end:]


def _swapped(draw: random.Random, data: bytes, other: bytes) -> bytes:
    first, second = sorted((_span(draw, data), _span(draw, data)))
    if first[1] > second[0]:
        return data[first[1] :] + data[: first[1]]
    between = data[first[1] : second[0]]
    first_part, second_part = data[slice(*first)], data[slice(*second)]
    return data[: first[0]] + second_part + between + first_part + data[second[1] :]


def _spliced(draw: random.Random, data: bytes, other: bytes) -> bytes:
    at = draw.random()
    return data[: round(at * len(data))] + other[round(at * len(other)) :]


def _put_in(draw: random.Random, data: bytes, other: bytes) -> bytes:
    at, _ = _span(draw, data)
    new = draw.choice((draw.randbytes(3), draw.randbytes(100), draw.choice(STRANGE)))
    return data[:at] + new + data[at:]


def _replaced_whole(draw: random.Random, data: bytes, other: bytes) -> bytes:
    return draw.choice((b"", b"\n", b"\x00" * 100, draw.randbytes(200), b"null", b"[]", b"{}"))


def _other_number(draw: random.Random, data: bytes, other: bytes) -> bytes:
    found = _NUMBER.search(data, draw.randrange(len(data) + 1)) or _NUMBER.search(data)
    if found is None:
        return _put_in(draw, data, other)
    return data[: found.start()] + draw.choice(NUMBERS).encode() + data[found.end() :]


def _strange_letter(draw: random.Random, data: bytes, other: bytes) -> bytes:
    at, _ = _span(draw, data)
    return data[:at] + draw.choice(STRANGE) + data[at + draw.randrange(2) :]


def _lines_moved(draw: random.Random, data: bytes, other: bytes) -> bytes:
    lines = data.splitlines(keepends=True)
    if len(lines) < 2:
        return _doubled(draw, data, other)
    at, to = draw.randrange(len(lines)), draw.randrange(len(lines))
    foreign = other.splitlines(keepends=True) or [b"\n"]
    way = draw.randrange(5)
    if way == 0:
        lines.pop(at)
    elif way == 1:
        lines.insert(to, lines[at])
    elif way == 2:
        lines[at], lines[to] = lines[to], lines[at]
    elif way == 3:
        lines.insert(at, draw.choice(foreign))
    else:
        lines = lines[:at]
    return b"".join(lines)


def _other_encoding(draw: random.Random, data: bytes, other: bytes) -> bytes:
    way = draw.randrange(4)
    if way == 0:
        return codecs.BOM_UTF8 + data
    if way == 1:
        return data.replace(b"\n", draw.choice((b"\r\n", b"\r", b"\n\n", b"\x0b")))
    text = data.decode("utf-8", "replace")
    return text.encode(draw.choice(ENCODINGS), "replace")


def _nested(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """Brackets within brackets, beyond what a recursive reader can follow, where a value stood."""
    depth = draw.choice((50, 900, 5000, LONG // 2))
    way = draw.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"(", b")"), (b"{a=", b"}"), (b"-", b"")))
    deep = way[0] * depth + draw.choice((b"1", b"")) + way[1] * draw.choice((depth, 0))
    found = _NUMBER.search(data, draw.randrange(len(data) + 1))
    start, end = (found.start(), found.end()) if found else _span(draw, data)
    return data[:start] + deep + data[end:]


def _long(draw: random.Random, data: bytes, other: bytes) -> bytes:
    at, _ = _span(draw, data)
    return (
        data[:at]
        + draw.choice((b"a", b"1", b" ", b"#", b",", b'"', b".", b"\n")) * LONG
        + data[at:]
    )


_BYTE_WAYS: tuple[Mutator, ...] = (
    _flipped, _flipped, _overwritten, _cut, _without, _doubled, _swapped, _spliced, _put_in,
)  # fmt: skip
_TEXT_WAYS: tuple[Mutator, ...] = (
    _other_number, _other_number, _other_number, _other_number, _strange_letter, _strange_letter,
    _lines_moved, _lines_moved, _other_encoding, _spliced, _without, _cut, _flipped,
)  # fmt: skip
_RARE: tuple[Mutator, ...] = (_nested, _long, _replaced_whole)
_RARELY = 0.02


def any_text(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """Damage to a text file; once in fifty what is far too long, too deep, or nothing at all."""
    if draw.random() < _RARELY:
        return draw.choice(_RARE)(draw, data, other)
    return (damaged if draw.random() < 0.25 else reworded)(draw, data, other)
