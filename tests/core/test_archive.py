"""Archives of arrays: what NumPy writes is read, what asks for more than it holds is refused."""

import io
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from benchmarks.fuzz.archives import deflated, packed, zip_of
from wakedeploy.core.archive import MOST_BYTES, read_archive

ARRAYS = {
    "rows": np.arange(6.0).reshape(2, 3),
    "columns": np.asfortranarray(np.arange(6, dtype=np.float32).reshape(2, 3)),
    "names": np.array(["ab", "c"]),
    "one": np.array(3),
    "none": np.zeros((0, 4)),
}
HEADER = "{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}\n"


def entry(shape: str, kind: str = "'<f4'", body: bytes = bytes(40), version: int = 1) -> bytes:
    header = HEADER.format(kind=kind, shape=shape).encode()
    length = len(header).to_bytes(2 if version == 1 else 4, "little")
    return b"\x93NUMPY" + bytes([version, 0]) + length + header + body


def holding(content: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("a.npy", content)
    return file.getvalue()


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_what_numpy_writes_is_read_and_may_be_changed(save, tmp_path: Path) -> None:
    save(tmp_path / "all.npz", **ARRAYS)
    read = read_archive(tmp_path / "all.npz")
    assert read.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert np.array_equal(read[name], array)
        assert read[name].dtype == array.dtype
        assert read[name].flags.writeable
    assert read_archive((tmp_path / "all.npz").read_bytes(), {"one"}).keys() == {"one"}


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (entry("(10000000000,)"), "40 bytes for"),
        (entry("(-10,)"), "40 bytes for"),
        (entry("(9,)"), "40 bytes for"),
        (entry("(1000000000000,)", "'<U0'", b""), "itemsize"),
        (entry("(10,)", version=3), "version"),
        (entry("(5,)", "'|O'"), "pickled objects"),
        (entry("(5,)", "[('a', '<f4'), ('b', '|O')]"), "pickled objects"),
        (entry("(5,)", "(" * 300), "damaged"),
        (b"no array at all", "magic"),
    ],
)
def test_an_array_that_is_not_what_it_says_is_refused(content: bytes, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        read_archive(holding(content))


@pytest.mark.parametrize("stated", [10, 1 << 20, MOST_BYTES + 1, 0xFFFFFFFF])
def test_a_small_file_that_unpacks_to_a_gigabyte_takes_no_memory(stated: int) -> None:
    head = entry("(268435456,)", body=b"")
    bomb = zip_of("a.npy", deflated(head, 1 << 30), stated)
    assert len(bomb) < 3 << 20
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=r"bytes for|MiB|damaged"):
            read_archive(bomb)
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()


def test_other_packings_and_damage_are_told_in_a_clause(tmp_path: Path) -> None:
    sound = packed({"a": np.arange(9.0)})
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("a.npy", entry("(10,)"))
    for data in (file.getvalue(), sound[:-40], sound[:60] + b"\xff" * 9 + sound[69:], b"PK"):
        with pytest.raises(ValueError, match=r"\S"):
            read_archive(data)
    with pytest.raises(OSError, match=r"none\.npz"):
        read_archive(tmp_path / "none.npz")
