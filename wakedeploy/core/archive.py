"""Arrays from `.npz` archives that anybody may have made: read, bounded, or refused with a reason.

In: a file or its bytes. Out: its arrays by name. Nothing is unpickled, and no memory is taken that
an array's own bytes do not fill: NumPy's reader believes a header that says ten gigabytes.
"""

import contextlib
import io
import math
import zipfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

MOST_BYTES = 128 << 20  # of all arrays of a file, unpacked: 26 minutes of two quadrotors at 200 Hz
_MOST_ARRAYS = 10_000
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # as NumPy writes them
_ENCRYPTED = 0x1
_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}

Arrays = dict[str, NDArray[Any]]


def read_archive(file: Path | bytes, names: Collection[str] | None = None) -> Arrays:
    """All arrays of an archive, or those of `names` that it has.

    Raises OSError for a file that cannot be opened, ValueError with a clause for one that is
    damaged, foreign, or larger than `MOST_BYTES` unpacked.
    """
    if isinstance(file, bytes):
        return _arrays(io.BytesIO(file), names)
    with file.open("rb") as opened:
        return _arrays(opened, names)


def arrays_in(file: Path) -> dict[str, bool]:
    """Whether each array of an archive can be read, by its header: pickled objects cannot.

    Raises OSError and ValueError as `read_archive` does.
    """
    with file.open("rb") as opened, _opened(opened) as archive:
        return {
            name: not _header(name, archive.open(entry))[2].hasobject
            for name, entry in _entries(archive).items()
        }


def _arrays(file: IO[bytes], names: Collection[str] | None) -> Arrays:
    with _opened(file) as archive:
        return {
            name: _array(name, _content(archive, entry))
            for name, entry in _entries(archive).items()
            if names is None or name in names
        }


@contextlib.contextmanager
def _opened(file: IO[bytes]) -> Iterator[zipfile.ZipFile]:
    """An archive; whatever goes wrong while it is open is an OSError or a ValueError."""
    try:
        with zipfile.ZipFile(file) as archive:
            yield archive
    except (OSError, ValueError):
        raise
    except Exception as error:  # zip, zlib and NumPy's parser of headers each raise their own
        raise ValueError(f"damaged: {error}" if str(error) else "damaged") from error


def _entries(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    """The archive's arrays, whose sizes are those that it will give at most."""
    entries = archive.infolist()
    if len(entries) > _MOST_ARRAYS:
        raise ValueError(f"holds {len(entries)} arrays, and {_MOST_ARRAYS} are the most")
    size = sum(entry.file_size for entry in entries)
    if size > MOST_BYTES:
        raise ValueError(
            f"unpacked it takes {size / 2**20:.0f} MiB, and {MOST_BYTES >> 20} are the most"
        )
    for entry in entries:
        if entry.compress_type not in _METHODS or entry.flag_bits & _ENCRYPTED:
            raise ValueError(f"{entry.filename} is packed as NumPy packs nothing")
    return {entry.filename.removesuffix(".npy"): entry for entry in entries}


def _content(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    """As many bytes as the entry states: asked for all, zipfile unpacks more than it gives."""
    with archive.open(entry) as opened:
        return opened.read(entry.file_size)


def _array(name: str, content: bytes) -> NDArray[Any]:
    """An array of numbers or text whose header says neither more nor less than its bytes hold."""
    reading = io.BytesIO(content)
    shape, by_column, kind = _header(name, reading)
    if kind.hasobject:
        raise ValueError(f"{name} holds pickled objects, which are not read")
    count, held = math.prod(shape), len(content) - reading.tell()
    if min(shape, default=0) < 0 or count * kind.itemsize != held:
        raise ValueError(f"{name} has {held} bytes for {shape} of {kind}")
    values = np.frombuffer(content, kind, count, reading.tell()).copy()
    return values.reshape(shape, order="F" if by_column else "C")


def _header(name: str, reading: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """The shape, whether columns come first, and the kind of an array; its numbers are next."""
    read_header = _HEADERS.get(np.lib.format.read_magic(reading))
    if read_header is None:
        raise ValueError(f"{name} is of a version of NumPy's format that is not known")
    return read_header(reading)
