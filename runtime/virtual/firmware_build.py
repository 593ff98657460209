"""Compiles `arduino_sketch/`: for the UNO, and its decisions as a library for this machine.

In: a checkout with compilers. Out: files under `build/firmware/`, named by the hash of what they
were made of, so that nothing is compiled twice. `python -m runtime.virtual.firmware_build` builds
the sketch and tells its size.
"""

import contextlib
import hashlib
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from wakedeploy.errors import UnusableInput

ROOT = Path(__file__).parents[2]
SKETCH = ROOT / "arduino_sketch"
BUILD = ROOT / "build" / "firmware"
DECISIONS = ("deadman", "frames", "limits", "mcu", "session", "stepper")

_WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Werror")
_DIALECT = ("-std=c++11", "-fno-exceptions", "-fno-rtti")

Command = Sequence[str | Path]


def host_library(shim: Path, *, coverage: bool = False) -> Path:
    """The decisions and `shim`, a C interface to them, as a shared library for this machine.

    With `coverage` it is not optimised and notes what was run beside itself. Raises UnusableInput
    without a compiler, or when it refuses.
    """
    sources = [SKETCH / f"{name}.cpp" for name in DECISIONS]
    flags = ["-O0", "--coverage"] if coverage else ["-O2"]
    command: list[str | Path] = [
        "g++",
        *_DIALECT,
        *_WARNINGS,
        *flags,
        "-fPIC",
        "-shared",
        "-I",
        SKETCH,
    ]

    def compile_into(folder: Path) -> None:
        _run([*command, *sources, shim, "-o", folder / "decisions.so"], folder)

    made_of = [*sources, *SKETCH.glob("*.h"), shim]
    return _built("host-coverage" if coverage else "host", made_of, command, compile_into) / (
        "decisions.so"
    )


def missing_tools(*tools: str) -> str | None:
    """A sentence when a program is not installed, or None."""
    missing = [tool for tool in tools if shutil.which(tool) is None]
    return f"{' and '.join(missing)} not installed" if missing else None


def _built(
    name: str, made_of: Sequence[Path], command: Command, build: Callable[[Path], None]
) -> Path:
    """The folder with what `build` made of these files and flags; built once."""
    known = hashlib.sha256("\0".join(map(str, command)).encode())
    for source in sorted(made_of):
        known.update(source.name.encode() + b"\0" + source.read_bytes())
    folder = BUILD / f"{name}-{known.hexdigest()[:16]}"
    if not folder.exists():
        BUILD.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=BUILD, ignore_cleanup_errors=True) as making:
            (Path(making) / name).mkdir()
            build(Path(making) / name)
            with contextlib.suppress(OSError):  # another process was faster
                (Path(making) / name).rename(folder)
    return folder


def _run(command: Command, folder: Path) -> str:
    """Run a compiler in `folder`; what it printed. UnusableInput when it fails."""
    tool = str(command[0])
    try:
        ended = subprocess.run(  # noqa: S603 - compilers named in this file
            [str(part) for part in command], cwd=folder, capture_output=True, text=True, check=False
        )
    except FileNotFoundError as error:
        raise UnusableInput(f"{tool} is not installed; the firmware cannot be built.") from error
    if ended.returncode != 0:
        raise UnusableInput(f"{tool} refuses the firmware:\n{ended.stderr.strip()}")
    return ended.stdout
