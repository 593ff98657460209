"""Boards that QEMU simulates, and programs on them."""

import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from runtime.compiled.folder import CFolder
from wakedeploy.core.errors import CheckFailed, UnusableInput

HERE = Path(__file__).parent
COMPILER, SIMULATOR = "arm-none-eabi-gcc", "qemu-system-arm"
_SHIFT = 5  # of QEMU's -icount: an instruction takes 2^5 ns of simulated time
_SCALE_INSTRUCTIONS = 2001  # of `known` in measure.c
_LIMIT_S = 300
_FLAGS = ("-O2", "-std=c99", "-ffunction-sections", "-fdata-sections", "-fno-common")
_STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror")


@dataclass(frozen=True)
class Board:
    """A board of QEMU's with the processor that it stands for."""

    name: str
    machine: str
    flags: tuple[str, ...]
    flash_start: int
    ram_start: int


CORTEX_M4F = Board(
    "Cortex-M4F",
    "mps2-an386",
    ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
    0x0000_0000,
    0x2000_0000,
)
CORTEX_M33 = Board(
    "Cortex-M33",
    "mps2-an505",
    ("-mcpu=cortex-m33", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16"),
    0x1000_0000,
    0x3800_0000,
)
BOARDS = (CORTEX_M4F, CORTEX_M33)


@dataclass(frozen=True)
class Taken:
    """What a model takes on a board, in bytes and instructions.

    `flash` is that of the model's own object, `libm` what it calls of the C library, `static_ram`
    what the object itself reserves; the state is the caller's.
    """

    instructions: int
    stack: int
    state: int
    flash: int
    libm: int
    static_ram: int

    @property
    def ram(self) -> int:
        """State and deepest stack of a step."""
        return self.state + self.stack + self.static_ram


def missing_tools() -> list[str]:
    """Programs that are not on this machine."""
    return [name for name in (COMPILER, SIMULATOR) if shutil.which(name) is None]


def require_tools() -> None:
    """UnusableInput where something is missing."""
    if missing := missing_tools():
        raise UnusableInput(
            f"{' and '.join(missing)} not found: sudo apt install gcc-arm-none-eabi"
            " libnewlib-arm-none-eabi qemu-system-arm"
        )


def self_tested(folder: CFolder, board: Board) -> float:
    """The self-test's worst relative difference on a board; CheckFailed where it does not pass."""
    with tempfile.TemporaryDirectory() as place:
        elf = built([folder.source, folder.test], Path(place), board, strict=True)
        said = run(elf, board)
    found = re.search(r"passed, max_rel (\S+)", said)
    if found is None:
        raise CheckFailed(f"{folder.path}: on the {board.name} its self-test says: {said.strip()}")
    return float(found[1])


def taken(folder: CFolder, board: Board, steps: int = 40) -> Taken:
    """What a step takes on a board, after some others."""
    with measuring_program(folder, board, steps) as elf:
        said = run(elf, board, "-icount", f"shift={_SHIFT}")
        found = re.search(r"ticks (\d+) scale (\d+) stack (\d+) state (\d+)", said)
        if found is None:
            raise CheckFailed(f"{folder.path}: on the {board.name} it says: {said.strip()}")
        ticks, scale, stack, state = map(int, found.groups())
        sizes = _sizes(elf.with_suffix(".map"), folder.document.name)
    return Taken(
        instructions=round(ticks * _SCALE_INSTRUCTIONS / scale), stack=stack, state=state, **sizes
    )


@contextmanager
def measuring_program(folder: CFolder, board: Board, steps: int) -> Iterator[Path]:
    """The program of measure.c around a model."""
    manifest, name = folder.manifest, folder.document.name
    defines = {
        "MODEL": name,
        "MODEL_HEADER": f'"{name}.h"',
        "INPUTS": len(manifest.observation),
        "OUTPUTS": len(manifest.force),
        "SAMPLE": f"{0.5 * (manifest.observation[0].min + manifest.observation[0].max) + 0.1:.6f}f",
        "STEPS": steps,
    }
    flags = [f"-D{key}={value}" for key, value in defines.items()]
    with tempfile.TemporaryDirectory() as place:
        sources = [folder.source, HERE / "measure.c"]
        yield built(sources, Path(place), board, (f"-I{folder.path}", *flags))


def built(
    sources: Sequence[Path],
    place: Path,
    board: Board,
    flags: Sequence[str] = (),
    *,
    strict: bool = False,
) -> Path:
    """A program for a board, with its linker map beside it."""
    script, elf = place / "board.ld", place / "program.elf"
    text = (HERE / "mps2.ld").read_text(encoding="utf-8")
    for word, address in (("FLASH_START", board.flash_start), ("RAM_START", board.ram_start)):
        text = text.replace(word, hex(address))
    script.write_text(text, encoding="utf-8")
    objects = []
    for source in sources:
        objects.append(place / f"{source.stem}.o")
        warned = _STRICT if strict else ()
        _called([COMPILER, *board.flags, *_FLAGS, *warned, *flags, "-c", source, "-o", objects[-1]])
    linked = ("-specs=rdimon.specs", "-nostartfiles", "-T", script, "-Wl,--gc-sections")
    libraries = (f"-Wl,-Map={elf.with_suffix('.map')}", "-lm", "-lc", "-lrdimon")
    sources_of_all = (HERE / "startup.c", *objects)
    _called([COMPILER, *board.flags, "-O2", *sources_of_all, "-o", elf, *linked, *libraries])
    return elf


def run(elf: Path, board: Board, *options: str) -> str:
    """What a program prints on a board; CheckFailed where it does not end by itself."""
    command = [SIMULATOR, "-M", board.machine, "-nographic", "-monitor", "none", "-serial", "none"]
    command += ["-semihosting-config", "enable=on,target=native", *options, "-kernel", str(elf)]
    try:
        ended = subprocess.run(
            command, capture_output=True, text=True, timeout=_LIMIT_S, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise CheckFailed(
            f"{elf.name} had not ended after {_LIMIT_S} s on {board.name}."
        ) from error
    return ended.stdout + ended.stderr


def _called(command: Sequence[object]) -> None:
    ended = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        raise CheckFailed(f"{' '.join(map(str, command))} failed: {ended.stderr[:1000]}")


_SECTION = re.compile(r"^ (\.[\w.]+)\s+0x[0-9a-f]+\s+0x([0-9a-f]+) (\S.*)$")


def _sizes(linker_map: Path, name: str) -> dict[str, int]:
    """Bytes of the model's object and of libm, by the map of what was linked."""
    text = linker_map.read_text(encoding="utf-8").partition("Linker script and memory map")[2]
    text = re.sub(r"^( \.[\w.]+)\n\s+", r"\1 ", text, flags=re.MULTILINE)
    sizes = dict.fromkeys(("flash", "libm", "static_ram"), 0)
    for line in text.splitlines():
        found = _SECTION.match(line)
        if found is None:
            continue
        section, size, origin = found[1], int(found[2], 16), found[3]
        is_ram = section.startswith((".bss", ".data"))
        if origin.endswith(f"/{name}.o"):
            sizes["static_ram" if is_ram else "flash"] += size
        elif "libm.a(" in origin and not is_ram:
            sizes["libm"] += size
    return sizes
