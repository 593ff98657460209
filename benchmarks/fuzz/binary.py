"""Damage to recordings: MATLAB's elements, MCAP's records, and what is compressed in them."""

import functools
import gzip
import io
import json
import random
import struct
import zlib
from typing import Any

import numpy as np

from benchmarks.fuzz.archives import deflated
from benchmarks.fuzz.documents import altered
from benchmarks.fuzz.tables import csv_file
from benchmarks.fuzz.text import damaged

_MAGIC = b"\x89MCAP0\r\n"
_CHUNK, _MESSAGE, _METADATA, _SCHEMA, _CHANNEL = 6, 5, 12, 3, 4
_NUMBERS = (0, 1, 2, 7, 255, 65535, 2**31 - 1, 2**31, 2**32 - 1, 10**9)
_HUGE = (*_NUMBERS, 2**62, 2**63, 2**64 - 1, 10**12)
_MAT_HEADER = 128


def mat_file(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """A MATLAB file damaged in its bytes, an element's tag, its variables, or its compression."""
    way = draw.random()
    if way < 0.25:
        return damaged(draw, data, other)
    if way < 0.6:
        return _other_tag(draw, data)
    if way < 0.605:
        return data[:_MAT_HEADER] + _mat_bomb(draw)
    return _other_variable(draw, data)


def _other_tag(draw: random.Random, data: bytes) -> bytes:
    """Another type, size, class or dimension: all stand at multiples of four bytes."""
    places = range(_MAT_HEADER, min(len(data) - 4, _MAT_HEADER + 120), 4)
    if draw.random() < 0.4:
        places = range(_MAT_HEADER, max(len(data) - 4, _MAT_HEADER + 1), 4)
    at = draw.choice(places)
    number = draw.choice((*_NUMBERS, draw.randrange(1, 20), 0x00010000, 0x0800))
    return data[:at] + struct.pack("<I", number) + data[at + 4 :]


def _other_variable(draw: random.Random, data: bytes) -> bytes:
    """Variables of other types and shapes, written by SciPy, which is not what reads them here."""
    from scipy.io import savemat

    held = dict(_variables(data))
    name = draw.choice(list(held))
    value = held.pop(name)
    ways: tuple[Any, ...] = (
        None, "text", value.astype(complex), value.astype("f4"), np.zeros((0, 0)), value[:, :1],
        value.T, value.ravel()[:1], np.array([{"a": 1}], object), {"field": value}, [1, "a"],
        np.full_like(value, np.nan), value * 1e300, -value, np.zeros_like(value), value > 0,
        value[:, ::-1], np.stack([value, value]), value.astype("i8"),
    )  # fmt: skip
    new = draw.choice(ways)
    if new is not None:
        with np.errstate(all="ignore"):
            held[name] = new
    file = io.BytesIO()
    savemat(file, held, do_compression=draw.random() < 0.3)
    return file.getvalue()


@functools.lru_cache(maxsize=20)
def _variables(data: bytes) -> dict[str, Any]:
    """The variables of a sound file, not to be changed."""
    from scipy.io import loadmat

    return {k: v for k, v in loadmat(io.BytesIO(data)).items() if not k.startswith("__")}


def _mat_bomb(draw: random.Random) -> bytes:
    """A compressed element that takes up to gigabytes unpacked."""
    size = draw.choice((300, 700, 3000)) << 20
    count = draw.choice((size // 8, 10, 2**31 - 1))
    flags = struct.pack("<IIII", 6, 8, 6, 0)
    shape = struct.pack("<IIii", 5, 8, 1, count)
    name = struct.pack("<HH4s", 1, 4, b"time")
    head = struct.pack("<II", 14, min(size, 2**32 - 1)) + flags + shape + name
    head += struct.pack("<II", 9, min(size - len(head) - 8, 2**32 - 1))
    packed = b"\x78\x9c" + deflated(head, size) + struct.pack(">I", zlib.adler32(b""))
    return struct.pack("<II", 15, len(packed)) + packed


def mcap_file(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """An MCAP file damaged in its bytes, in a record, in a message, or in a chunk's compression."""
    way = draw.random()
    if way < 0.2:
        return damaged(draw, data, other)
    if way < 0.205:
        return _mcap_bomb(draw, data)
    records = _records(data[len(_MAGIC) : -len(_MAGIC)])
    for _ in range(draw.choice((1, 1, 2))):
        records = draw.choice((_other_record, _other_order, _other_content, _other_content))(
            draw, records
        )
    return _MAGIC + _joined(records) + _MAGIC


Record = tuple[int, bytes]


def _records(body: bytes) -> list[Record]:
    found, at = [], 0
    while at + 9 <= len(body):
        kind, length = struct.unpack_from("<BQ", body, at)
        found.append((kind, body[at + 9 : at + 9 + length]))
        at += 9 + length
    return found


def _joined(records: list[Record]) -> bytes:
    return b"".join(struct.pack("<BQ", kind, len(content)) + content for kind, content in records)


def _other_record(draw: random.Random, records: list[Record]) -> list[Record]:
    """A number of a record's, or its kind, replaced; the whole may be cut behind it."""
    at = draw.randrange(len(records))
    kind, content = records[at]
    where = draw.randrange(len(content) + 1)
    width = draw.choice(("<H", "<I", "<Q"))
    number = draw.choice(_HUGE) & (1 << 8 * struct.calcsize(width)) - 1
    new = struct.pack(width, number)
    changed = content[:where] + new + content[where + len(new) :]
    if draw.random() < 0.15:
        kind = draw.randrange(256)
    return [*records[:at], (kind, changed), *records[at + 1 :]]


def _other_order(draw: random.Random, records: list[Record]) -> list[Record]:
    at, to = draw.randrange(len(records)), draw.randrange(len(records))
    copy = list(records)
    if draw.random() < 0.5:
        copy.insert(to, copy[at])
    else:
        copy.pop(at)
    return copy or records


def _other_content(draw: random.Random, records: list[Record]) -> list[Record]:
    """A message's or the metadata's values, in a chunk written anew with the sums that fit."""
    kinds = [i for i, (kind, _) in enumerate(records) if kind in (_CHUNK, _METADATA)]
    if not kinds:
        return records
    at = draw.choice(kinds)
    kind, content = records[at]
    try:
        new = _chunk(draw, content) if kind == _CHUNK else _metadata(draw, content)
    except Exception:  # a change before has left nothing to be read
        new = damaged(draw, content, content)
    return [*records[:at], (kind, new), *records[at + 1 :]]


def _chunk(draw: random.Random, content: bytes) -> bytes:
    """A chunk without compression whose messages, schemas or channels were changed."""
    inner = _records(_unpacked(content))
    if not inner:
        return content
    at = draw.randrange(len(inner))
    kind, body = inner[at]
    if kind == _MESSAGE and draw.random() < 0.8:
        try:
            body = body[:22] + json.dumps(altered(draw, json.loads(body[22:]))).encode()
        except (ValueError, RecursionError):
            body = damaged(draw, body, body)
    elif draw.random() < 0.5:
        inner = _other_order(draw, inner)
        at = min(at, len(inner) - 1)
        kind, body = inner[at]
    else:
        body = damaged(draw, body, body)
    joined = _joined([*inner[:at], (kind, body), *inner[at + 1 :]])
    if draw.random() < 0.1:
        where = draw.randrange(len(joined))
        joined = joined[:where] + struct.pack("<Q", draw.choice(_HUGE)) + joined[where + 8 :]
    return (
        content[:16]
        + struct.pack("<QII", len(joined), 0, 0)
        + struct.pack("<Q", len(joined))
        + joined
    )


def _unpacked(content: bytes) -> bytes:
    import zstandard

    (length,) = struct.unpack_from("<I", content, 28)
    method, packed = content[32 : 32 + length], content[32 + length + 8 :]
    if method == b"zstd":
        return zstandard.decompress(packed, 1 << 24)
    return packed if method == b"" else b""


def _metadata(draw: random.Random, content: bytes) -> bytes:
    """The record's name and pairs, some of them changed."""
    name, rest = _string(content)
    body, pairs = rest[4:], {}
    while body:
        key, body = _string(body)
        pairs[key], body = _string(body)
    changed = altered(draw, pairs)
    if not isinstance(changed, dict):
        return damaged(draw, content, content)
    encoded_pairs = b"".join(_as_string(str(k)) + _as_string(str(v)) for k, v in changed.items())
    return _as_string(name) + struct.pack("<I", len(encoded_pairs)) + encoded_pairs


def _string(content: bytes) -> tuple[str, bytes]:
    (length,) = struct.unpack_from("<I", content)
    return content[4 : 4 + length].decode("utf-8", "replace"), content[4 + length :]


def _as_string(text: str) -> bytes:
    encoded = text.encode("utf-8", "surrogatepass")
    return struct.pack("<I", len(encoded)) + encoded


def _mcap_bomb(draw: random.Random, data: bytes) -> bytes:
    """A chunk of a few kilobytes that takes hundreds of megabytes, or says so, unpacked."""
    import lz4.frame
    import zstandard

    size = draw.choice((1, 300, 700, 3000)) << 20
    records = _records(data[len(_MAGIC) : -len(_MAGIC)])
    if draw.random() < 0.5:
        blocks = zstandard.ZstdCompressor().compressobj()
        packed = b"".join(blocks.compress(bytes(1 << 20)) for _ in range(size >> 20))
        method, packed = b"zstd", packed + blocks.flush()
    else:
        block = lz4.frame.compress(bytes(min(size, 64 << 20)))
        method, packed = b"lz4", block
    stated = draw.choice((size, 10, 2**63, 2**40))
    head = struct.pack("<QQQII", 0, 0, stated, 0, len(method)) + method
    chunk = (_CHUNK, head + struct.pack("<Q", len(packed)) + packed)
    at = draw.randrange(len(records))
    return _MAGIC + _joined([*records[:at], chunk, *records[at:]]) + _MAGIC


def gzipped_csv(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """A compressed table, damaged before or after it was compressed, or a bomb."""
    way = draw.random()
    if way < 0.3:
        return damaged(draw, data, other)
    if way < 0.305:
        head = b"\x1f\x8b\x08\x00\x00\x00\x00\x00\x00\xff"
        return head + deflated(b"Timestamp,RPM,Duty\n", draw.choice((300, 3000)) << 20)
    return gzip.compress(csv_file(draw, gzip.decompress(data), data), mtime=0)
