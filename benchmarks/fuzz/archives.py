"""Damage to archives of arrays: zip entries, the headers of `.npy`, arrays of odd types, bombs."""

import functools
import io
import json
import random
import struct
import zipfile
import zlib
from typing import Any

import numpy as np

from benchmarks.fuzz.documents import altered
from benchmarks.fuzz.text import damaged

Arrays = dict[str, np.ndarray[Any, Any]]

SHAPES = (
    "(-1,)", "(0,)", "()", "(1,)", "(10000000000,)", "(1000000, 1000000)", "(2147483648,)",
    "(-5, 3)", "(1.5,)", "('a',)", "(None,)", "None", "3", "(18446744073709551616,)", "(True,)",
    "(0, 0)", "(1, 1, 1, 1, 1)", "(" + "1," * 60 + ")",
)  # fmt: skip
TYPES = (
    "'|O'", "'<f8'", "'<f4'", "'>f8'", "'<i8'", "'<c16'", "'|S4'", "'<U8'", "'<M8[s]'", "'|b1'",
    "'|V8'", "'<f2'", "'<g16'", "[('a', '<f4'), ('b', '|O')]", "'<f4,<f4'", "'x'", "''", "None",
    "7", "'<f99999'", "'<U1000000000'", "[" * 40 + "]" * 40, "('<f4', (1000000000,))",
)  # fmt: skip
_LOCAL, _CENTRAL, _END = b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06"
_FIELDS = {  # offset and width of the fields of a zip's records
    _LOCAL: ((4, 2), (6, 2), (8, 2), (14, 4), (18, 4), (22, 4), (26, 2), (28, 2)),
    _CENTRAL: (
        (4, 2), (6, 2), (8, 2), (10, 2), (16, 4), (20, 4), (24, 4), (28, 2), (30, 2), (32, 2),
        (34, 2), (36, 2), (38, 4), (42, 4),
    ),
    _END: ((4, 2), (6, 2), (8, 2), (10, 2), (12, 4), (16, 4), (20, 2)),
}  # fmt: skip
_BOMB_BLOCK = 1 << 20


def npz_file(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """An `.npz` damaged in its bytes, its zip records, an array's header, or its arrays."""
    way = draw.random()
    if way < 0.2:
        return damaged(draw, data, other)
    if way < 0.4:
        return _other_record(draw, data)
    if way < 0.405:
        return bomb(draw)
    arrays = dict(arrays_of(data))
    if way < 0.65:
        return _forged_header(draw, arrays)
    for _ in range(draw.choice((1, 1, 2))):
        _other_array(draw, arrays)
    return packed(arrays, draw.random() < 0.3)


@functools.lru_cache(maxsize=100)
def arrays_of(data: bytes) -> Arrays:
    """The arrays of a sound archive, not to be changed."""
    with np.load(io.BytesIO(data)) as archive:
        return {name: archive[name] for name in archive.files}


def packed(arrays: Arrays, is_compressed: bool = False) -> bytes:
    """Arrays as an archive; those of objects are pickled, as a forger would do."""
    file = io.BytesIO()
    method = zipfile.ZIP_DEFLATED if is_compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, array in arrays.items():
            entry = io.BytesIO()
            np.lib.format.write_array(entry, np.asanyarray(array))
            archive.writestr(f"{name}.npy", entry.getvalue())
    return file.getvalue()


def _other_record(draw: random.Random, data: bytes) -> bytes:
    """Another number in a field of a zip record."""
    for _ in range(draw.choice((1, 1, 2))):
        mark = draw.choice(tuple(_FIELDS))
        places = _places(data, mark)
        if not places:
            continue
        offset, width = draw.choice(_FIELDS[mark])
        at = draw.choice(places) + offset
        number = draw.choice(
            (0, 1, 8, 14, 99, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, draw.getrandbits(31))
        )
        new = (number & (1 << 8 * width) - 1).to_bytes(width, "little")
        data = data[:at] + new + data[at + width :]
    return data


def _places(data: bytes, mark: bytes) -> list[int]:
    found, at = [], data.find(mark)
    while at >= 0:
        found.append(at)
        at = data.find(mark, at + 1)
    return found


def _forged_header(draw: random.Random, arrays: Arrays) -> bytes:
    """One array whose header says what its bytes do not hold."""
    file, chosen = io.BytesIO(), draw.choice(list(arrays))
    with zipfile.ZipFile(file, "w") as archive:
        for name, array in arrays.items():
            entry = io.BytesIO()
            np.lib.format.write_array(entry, array)
            content = entry.getvalue()
            if name == chosen:
                content = _with_header(draw, array)
            archive.writestr(f"{name}.npy", content)
    return file.getvalue()


def _with_header(draw: random.Random, array: np.ndarray[Any, Any]) -> bytes:
    """The array's bytes behind another header."""
    shape, kind = repr(array.shape), repr(array.dtype.str)
    order = "False"
    way = draw.randrange(6)
    if way < 2:
        shape = draw.choice(SHAPES)
    elif way < 4:
        kind = draw.choice(TYPES)
    elif way == 4:
        shape, kind, order = draw.choice(SHAPES), draw.choice(TYPES), draw.choice(("True", "7"))
    text = f"{{'descr': {kind}, 'fortran_order': {order}, 'shape': {shape}, }}"
    if way == 5:
        deep = "(" * draw.choice((30, 150, 5000))
        text = draw.choice((deep, text * 2, text[:-3], "[]", "9" * 9000, f"{text}{' ' * 20_000}"))
    header = text.encode() + b"\n"
    version = draw.choice(((1, 0), (1, 0), (2, 0), (3, 0), (4, 0), (0, 0)))
    length = struct.pack("<H" if version == (1, 0) else "<I", min(len(header), 65535))
    return b"\x93NUMPY" + bytes(version) + length + header + array.tobytes()


def _other_array(draw: random.Random, arrays: Arrays) -> None:
    name = draw.choice(list(arrays))
    array = arrays[name]
    way = draw.randrange(6)
    if way == 0:
        arrays.pop(name)
        if draw.random() < 0.5 or not arrays:
            arrays[draw.choice(("x", "observation", "../x", "é", "", "file", "a" * 300))] = array
    elif way == 1:
        arrays[name] = _of_other_type(draw, array)
    elif way == 2:
        arrays[name] = _of_other_shape(draw, array)
    else:
        arrays[name] = _with_other_numbers(draw, array)


def _of_other_type(draw: random.Random, array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    kind = draw.choice(
        ("f2", "f4", "f8", "i1", "i8", "u8", "c16", "O", "S8", "U8", "?", ">f8", "g")
    )
    with np.errstate(all="ignore"):
        try:
            return array.astype(kind)
        except (ValueError, TypeError):
            return np.zeros(array.shape, kind)


def _of_other_shape(draw: random.Random, array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    ways = (
        lambda a: a.T, lambda a: a.ravel(), lambda a: a[..., None], lambda a: a[None],
        lambda a: a[:1], lambda a: a[:0], lambda a: a[: len(a) // 2],
        lambda a: a.ravel()[0] if a.size else a,
        lambda a: np.concatenate([a, a]), lambda a: a[::-1], lambda a: np.asfortranarray(a),
        lambda a: np.repeat(a, 2, axis=-1),
    )  # fmt: skip
    return np.asarray(draw.choice(ways)(np.atleast_1d(array)))


def _with_other_numbers(draw: random.Random, array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    changed = np.array(array, ndmin=1)
    value = draw.choice((np.nan, np.inf, -np.inf, 1e308, -1e30, 3e38, 0.0, -0.0, 1e-320, 1.0, -1.0))
    flat = changed.reshape(-1)
    if not len(flat):
        return changed
    with np.errstate(all="ignore"):
        if draw.random() < 0.3:
            flat[:] = np.asarray(value).astype(changed.dtype)
        else:
            flat[draw.randrange(len(flat))] = np.asarray(value).astype(changed.dtype)
    return changed.reshape(np.shape(array) or (1,))


def bomb(draw: random.Random) -> bytes:
    """A small archive of one array that takes hundreds of megabytes, or says so, when unpacked."""
    size = draw.choice((300, 700, 3000)) * _BOMB_BLOCK
    shape = draw.choice((f"({size // 4},)", f"({size // 4 // 8}, 8)", "(10,)"))
    name = draw.choice(("observation", "t", "uav_1_states", "fit"))
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}".encode() + b"\n"
    head = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header
    stated = draw.choice((size + len(head), 10 << 30, 0xFFFFFFFF, size // 2))
    return zip_of(f"{name}.npy", deflated(head, size), min(stated, 0xFFFFFFFF))


def deflated(head: bytes, zeros: int) -> bytes:
    """A head and `zeros` zeros as a raw deflate stream, made without unpacked memory."""
    packing = zlib.compressobj(9, zlib.DEFLATED, -15)
    first = packing.compress(head) + packing.flush(zlib.Z_FULL_FLUSH)
    return first + _zeros() * (zeros // _BOMB_BLOCK) + b"\x03\x00"


@functools.cache
def _zeros() -> bytes:
    """A block of zeros that follows any other: a flush before and behind it lets it repeat."""
    packing = zlib.compressobj(9, zlib.DEFLATED, -15)
    return packing.compress(bytes(_BOMB_BLOCK)) + packing.flush(zlib.Z_FULL_FLUSH)


def zip_of(name: str, packed: bytes, size: int) -> bytes:
    """A zip of one entry that is compressed already, with the size that it states."""
    encoded_name = name.encode()
    sizes = struct.pack("<III", 0, len(packed), size)
    common = struct.pack("<HHHHH", 20, 0, 8, 0, 0x21) + sizes
    local = _LOCAL + common + struct.pack("<HH", len(encoded_name), 0) + encoded_name + packed
    central = _CENTRAL + struct.pack("<H", 20) + common
    central += struct.pack("<HHHHHII", len(encoded_name), 0, 0, 0, 0, 0, 0) + encoded_name
    end = _END + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(central), len(local), 0)
    return local + central + end


def safetensors_file(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """A safetensors file damaged in its bytes, its header's length, or its header's tree."""
    way = draw.random()
    if way < 0.35:
        return damaged(draw, data, other)
    (length,) = struct.unpack("<Q", data[:8])
    header, tensors = data[8 : 8 + length], data[8 + length :]
    if way < 0.45:
        stated = draw.choice((0, 1, length - 1, length + 1, 2**31, 2**63, 2**64 - 1, 10**9))
        return struct.pack("<Q", stated) + header + tensors
    text = json.dumps(altered(draw, json.loads(header))).encode()
    text += b" " * (-len(text) % 8)
    if draw.random() < 0.1:
        tensors = draw.choice((b"", tensors[:-4], tensors + b"\x00" * 8))
    return struct.pack("<Q", len(text)) + text + tensors
