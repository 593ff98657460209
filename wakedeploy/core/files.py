"""Writing files so that a killed process leaves the old one or none, never half a new one."""

import contextlib
import errno
import hashlib
import io
import json
import math
import os
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.names import near, one_of

_MARK = ".unfinished-"  # in the names of files that are being written
_NO_LINKS = (
    errno.EPERM,
    errno.ENOTSUP,
    errno.EMLINK,
)  # where files have one name, as on a USB stick
MOST_TEXT_BYTES = 64 << 20


def path_from(given: object, name: str) -> Path:
    """The path that an argument of this name gives; UnusableInput for what is none, such as a list.

    Text and what stands for it are paths, as everywhere in Python; bytes are not, nor is an empty
    text, which would be the current folder. `~` is the home folder.
    """
    text = os.fspath(given) if isinstance(given, str | os.PathLike) else None
    if not isinstance(text, str) or not text:
        raise UnusableInput(f"{name} is {given!r:.60}: give a path, as text or as a Path.")
    return at_home(Path(text))


def at_home(path: Path) -> Path:
    """The path with the home folder for a first part `~`, as a shell has it.

    As a name, it would make a folder that nobody dares to delete by its name.
    """
    is_meant = path.parts[:1] == ("~",)
    try:
        return path.expanduser() if is_meant else path
    except RuntimeError:  # nobody has told where it is
        return path


def absent(path: Path, accepted: str) -> str:
    """The sentence for a path at which no file lies: where it was looked for, and what to give.

    `accepted` is what would do, as "a run log, .mcap or .csv".
    """
    folder = path.absolute().parent
    if path.is_dir():
        return f"{path}: is a folder; give {accepted}."
    if not folder.is_dir():
        return f"{path}: there is no folder {folder}; give {accepted}."
    if any(mark in path.name for mark in "*?["):  # a shell leaves a pattern that matches nothing
        return f"{path}: no file in {folder} is called so; give {accepted}."
    close: list[str] = []
    with contextlib.suppress(OSError):  # of a folder that nobody may list
        close = near(path.name, sorted(other.name for other in folder.iterdir()))
    hint = f"did you mean {one_of(close)}? Give" if close else "give"
    return f"{path}: there is no such file in {folder}; {hint} {accepted}."


def write_whole(path: Path, write: Callable[[Path], None]) -> None:
    """Let `write` fill a temporary file beside `path`, then rename it over `path`.

    Raises whatever `write` raises; the temporary file is removed then. An OSError names `path`. A
    device or a pipe is written to as it is.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        with named(path):
            write(path)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with named(path), _unnamed_beside(path) as temporary:
        write(temporary)
        temporary.chmod(0o666 & ~_umask())
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        temporary.replace(path)


@contextlib.contextmanager
def named(path: Path) -> Iterator[None]:
    """An OSError in the block is about `path`; what is written to an open file says no name."""
    try:
        yield
    except OSError as error:
        is_unnamed = error.filename is None or _MARK in Path(str(error.filename)).name
        if error.errno is None or not is_unnamed:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


@contextlib.contextmanager
def begun(path: Path) -> Iterator[Path]:
    """A file to begin, whose name is `path` from the end of the block on; it may stay open.

    Nobody sees it under that name without what was written in the block. Raises FileExistsError
    where another file has the name by then; an empty one gives way. A device or a pipe is itself.
    """
    if path.exists() and not path.is_file():
        yield path
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with named(path), _unnamed_beside(path) as temporary:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        _name(temporary, path)


def _name(temporary: Path, path: Path) -> None:
    """Give a file a name that no other has."""
    try:
        os.link(temporary, path)  # the one way to name a file that refuses a name that is taken
    except OSError as error:
        if error.errno not in (errno.EEXIST, *_NO_LINKS):
            raise
        if path.exists() and path.stat().st_size > 0:
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from error
        temporary.replace(path)


def remove_unfinished(folder: Path) -> None:
    """Remove what killed writers left in a folder; nobody else may be writing there."""
    for path in folder.glob(f".*{_MARK}*"):
        path.unlink(missing_ok=True)


@contextlib.contextmanager
def _unnamed_beside(path: Path) -> Iterator[Path]:
    """A temporary file beside `path`, gone with the block."""
    prefix = f".{path.name}{_MARK}"
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=prefix, suffix=path.suffix)
    temporary = Path(name)
    try:
        os.close(handle)
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)


def write_text_whole(path: Path, text: str) -> None:
    """`write_whole` for UTF-8 text."""
    write_whole(path, lambda temporary: _write_text(temporary, text))


def write_bytes_whole(path: Path, data: bytes) -> None:
    """`write_whole` for bytes."""
    write_whole(path, lambda temporary: _write_bytes(temporary, data))


def sha256_of(data: bytes) -> str:
    """Hexadecimal SHA-256 of some bytes."""
    return hashlib.sha256(data).hexdigest()


def append_json_line(path: Path, line: Mapping[str, Any]) -> None:
    """One line in one write; begins with a line break where a killed writer left half a line."""
    text = json.dumps(line) + "\n"
    with named(path), path.open("ab+") as file:
        if file.tell() > 0:
            file.seek(-1, os.SEEK_END)
            text = text if file.read(1) == b"\n" else "\n" + text
        file.write(text.encode())
        file.flush()
        os.fsync(file.fileno())


def read_json_lines(path: Path) -> list[dict[str, Any]]:
    """Every whole line in the order of writing, without those that a killed writer left torn."""
    if not path.exists():
        return []
    lines = []
    for text in path.read_bytes().splitlines():
        try:
            lines.append(json_of(text))
        except ValueError:  # torn, maybe within a letter
            continue
    return [line for line in lines if isinstance(line, dict)]


def text_of(path: Path) -> str:
    """The text of a document; OSError where it cannot be read, ValueError for one that has no end.

    A name in a file may be that of a device.
    """
    with path.open("rb") as file:
        content = file.read(MOST_TEXT_BYTES + 1)
    if len(content) > MOST_TEXT_BYTES:
        raise ValueError(f"it is larger than {MOST_TEXT_BYTES >> 20} MiB")
    return io.TextIOWrapper(io.BytesIO(content), "utf-8").read()


def json_of(text: str | bytes) -> Any:
    """The value of a JSON document; ValueError for none, and for one that is nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def toml_of(text: str) -> dict[str, Any]:
    """The tables of a TOML document; ValueError for none, and for one that is nested too deeply.

    A mark of the byte order, which editors on Windows put first, is no part of it.
    """
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _write_bytes(path: Path, data: bytes) -> None:
    path.write_bytes(data)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def json_text(value: Any) -> str:
    """The value as JSON; NaN and infinities become null, NumPy's numbers Python's, paths text."""
    return json.dumps(finite(value), indent=2, allow_nan=False) + "\n"


def finite(value: Any) -> Any:
    """The value as JSON holds it: NaN and infinities None, NumPy's numbers Python's, paths text."""
    if isinstance(value, dict):
        return {str(key): finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    if hasattr(value, "tolist"):
        return finite(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
