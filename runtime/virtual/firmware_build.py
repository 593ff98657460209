"""Compiles `arduino_sketch/`: for the UNO, and its decisions as a library for this machine.

In: a checkout with compilers. Out: files under `build/firmware/`, named by the hash of what they
were made of, so that nothing is compiled twice. `python -m runtime.virtual.firmware_build` builds
the sketch and reports its size.
"""

import contextlib
import hashlib
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from wakedeploy.core.errors import UnusableInput

ROOT = Path(__file__).parents[2]
SKETCH = ROOT / "arduino_sketch"
BUILD = ROOT / "build" / "firmware"
DECISIONS = ("deadman", "frames", "mcu", "session", "stepper", "tick_limits")

# What C++ leaves undefined (an index out of bounds, an overflow) ends the program at once.
UNDEFINED_TRAPS = ("-fsanitize=undefined", "-fsanitize-undefined-trap-on-error")

_SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")

_WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Werror")
_DIALECT = ("-std=c++11", "-fno-exceptions", "-fno-rtti")

# The core where Debian's arduino-core-avr puts it, compiled as the Arduino IDE does.
CORE = Path("/usr/share/arduino/hardware/arduino/avr")
SIMAVR = Path("/usr/include/simavr")
SIMULATOR_HOST = Path(__file__).with_name("simavr_host.c")
AVR_TOOLS = ("avr-gcc", "avr-g++", "avr-gcc-ar", "avr-objcopy", "avr-size")
_UNO = (
    *("-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_AVR_UNO"),
    *("-DARDUINO_ARCH_AVR", "-DDECIMAL_DIG=__DECIMAL_DIG__", "-Os", "-flto"),
    *("-ffunction-sections", "-fdata-sections"),
    *("-I", CORE / "cores/arduino", "-I", CORE / "variants/standard"),
)
_AVR_CPP = ("avr-g++", *_UNO, "-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics")

FLASH_BYTES, RAM_BYTES = 32256, 2048  # of the UNO; the rest of its flash is the boot loader's
MOST_FLASH_BYTES = 8 * 1024  # that the sketch may take
MOST_RAM_BYTES = 512  # likewise, the stack not counted: the deepest call takes about 200 more

Command = Sequence[str | Path]


@dataclass(frozen=True)
class Firmware:
    """The compiled sketch, and the bytes that it takes of the chip's memories."""

    elf: Path
    hex: Path
    flash_bytes: int
    ram_bytes: int  # without the stack


def host_library(shim: Path, *, coverage: bool = False) -> Path:
    """The decisions and `shim`, a C interface to them, as a shared library for this machine.

    With `coverage` it is not optimised and notes what was run beside itself. Raises UnusableInput
    without a compiler, or when it refuses.
    """
    sources = [SKETCH / f"{name}.cpp" for name in DECISIONS]
    flags = ["-O0", "--coverage"] if coverage else ["-O2", *UNDEFINED_TRAPS]
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


def sanitized_program(driver: Path) -> Path:
    """The decisions and `driver`, which has a main, as a program that any undefined behaviour ends.

    Its headers lie beside it. Raises UnusableInput without a compiler, or when it refuses.
    """
    sources = [SKETCH / f"{name}.cpp" for name in DECISIONS]
    command: Command = ("g++", *_DIALECT, *_WARNINGS, "-O2", "-g", *_SANITIZED, "-I", SKETCH)

    def compile_into(folder: Path) -> None:
        _run([*command, *sources, driver, "-o", folder / driver.stem], folder)

    made_of = [*sources, *SKETCH.glob("*.h"), driver, *driver.parent.glob("*.h")]
    return _built(driver.stem, made_of, command, compile_into) / driver.stem


def firmware() -> Firmware:
    """The sketch compiled for the UNO, as the Arduino IDE would.

    Raises UnusableInput without `missing_for_the_uno`, or when the compiler refuses.
    """
    if not SKETCH.is_dir():
        raise UnusableInput("The firmware is not part of an installation; use a checkout.")
    if (missing := missing_for_the_uno()) is not None:
        raise UnusableInput(f"The firmware cannot be built: {missing}.")
    made_of = [path for path in SKETCH.iterdir() if path.suffix in (".ino", ".h", ".cpp")]
    folder = _built("uno", made_of, _AVR_CPP, _compile_sketch)
    sizes = _run(["avr-size", "-A", "sketch.elf"], folder)
    sections = {line.split()[0]: int(line.split()[1]) for line in sizes.splitlines()[2:-2]}
    data = sections.get(".data", 0)
    return Firmware(
        folder / "sketch.elf",
        folder / "sketch.hex",
        flash_bytes=sections[".text"] + data,
        ram_bytes=data + sections.get(".bss", 0) + sections.get(".noinit", 0),
    )


def simulator_library() -> Path:
    """The simulator with an UNO around it, as a shared library; one process can use it once.

    Raises UnusableInput without `missing_for_the_simulator`, or when the compiler refuses.
    """
    if (missing := missing_for_the_simulator()) is not None:
        raise UnusableInput(f"The firmware cannot be simulated: {missing}.")
    command = ["gcc", "-std=gnu11", "-Wall", "-Wextra", "-Werror", "-O2", "-fPIC", "-shared"]

    def compile_into(folder: Path) -> None:
        places: Command = ("-isystem", SIMAVR, SIMULATOR_HOST, "-o", "simulator.so")
        _run([*command, *places, "-lsimavr", "-lelf"], folder)

    return _built("simulator", [SIMULATOR_HOST], command, compile_into) / "simulator.so"


def missing_for_the_simulator() -> str | None:
    """What is not installed of what simulates the UNO, as a sentence; None when all is."""
    missing = missing_for_the_uno() or missing_tools("gcc")
    if missing is None and not (SIMAVR / "sim_avr.h").is_file():
        return "no simavr installed (Debian's libsimavr-dev and libelf-dev)"
    return missing


def missing_for_the_uno() -> str | None:
    """What is not installed of what compiles the sketch, as a sentence; None when all is."""
    if (missing := missing_tools(*AVR_TOOLS)) is not None:
        return f"{missing} (Debian's gcc-avr, binutils-avr and avr-libc)"
    return None if CORE.is_dir() else "no Arduino core installed (Debian's arduino-core-avr)"


def _compile_sketch(folder: Path) -> None:
    """The core goes into an archive: linked whole, its Tone.cpp would take Timer2's interrupt."""
    objects: list[Path] = []
    dialects: dict[str, Command] = {
        ".cpp": _AVR_CPP,
        ".c": ("avr-gcc", *_UNO),
        ".S": ("avr-gcc", *_UNO, "-x", "assembler-with-cpp"),
    }
    for source in sorted((CORE / "cores/arduino").iterdir()):
        if source.suffix in dialects:
            objects.append(folder / f"{source.name}.o")
            _run([*dialects[source.suffix], "-w", "-c", source, "-o", objects[-1]], folder)
    _run(["avr-gcc-ar", "rcs", "core.a", *objects], folder)
    sources = [SKETCH / f"{name}.cpp" for name in DECISIONS]
    ino: Command = (
        "-x",
        "c++",
        "-include",
        "Arduino.h",
        SKETCH / "arduino_sketch.ino",
        "-x",
        "none",
    )
    link = ["-Wall", "-Wextra", "-Wl,--gc-sections", "-fuse-linker-plugin"]
    _run([*_AVR_CPP, *link, *sources, *ino, "core.a", "-lm", "-o", "sketch.elf"], folder)
    _run(["avr-objcopy", "-O", "ihex", "-R", ".eeprom", "sketch.elf", "sketch.hex"], folder)


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


def main() -> None:
    """Build the sketch and report how much of the UNO it takes."""
    try:
        built = firmware()
    except UnusableInput as error:
        sys.exit(str(error))
    sys.stdout.write(
        f"{built.hex}\n{built.flash_bytes} of {FLASH_BYTES} bytes of flash, "
        f"{built.ram_bytes} of {RAM_BYTES} bytes of RAM without the stack\n"
    )


if __name__ == "__main__":
    main()
