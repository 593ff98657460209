"""C exports on simulated AVRs: what fits, and how long a step takes."""

import re
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.compiled.folder import CFolder
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.manifest import FloatArray

HERE = Path(__file__).parent
CLOCK_HZ = 16e6
_LIMIT_S = 300


@dataclass(frozen=True)
class Mcu:
    """An AVR with its memories in bytes."""

    name: str
    mcu: str
    flash: int
    ram: int
    ram_end: int


UNO = Mcu("ATmega328P", "atmega328p", 32 << 10, 2 << 10, 0x08FF)
MEGA = Mcu("ATmega2560", "atmega2560", 256 << 10, 8 << 10, 0x21FF)
MCUS = (UNO, MEGA)


@dataclass(frozen=True)
class OnAvr:
    """What a program of two steps takes; `why_not` says what it does not fit, and the rest is 0."""

    flash: int = 0
    ram: int = 0
    cycles: int = 0
    force: tuple[float, ...] = ()
    why_not: str = ""

    @property
    def ms(self) -> float:
        """A step at 16 MHz."""
        return 1e3 * self.cycles / CLOCK_HZ


def on_avr(folder: CFolder, mcu: Mcu) -> OnAvr:
    """Build a program for an AVR and run it on a simulated one."""
    with tempfile.TemporaryDirectory() as place:
        elf = Path(place) / "program.elf"
        if said := _built(folder, mcu, elf):
            return OnAvr(why_not=said)
        flash, ram = _sizes(elf)
        if flash > mcu.flash or ram > mcu.ram:
            return OnAvr(flash, ram, why_not="too large for its memories")
        return _run(elf, mcu, flash, ram, len(folder.manifest.force))


def _built(folder: CFolder, mcu: Mcu, elf: Path) -> str:
    """Compile and link; the first complaint, or nothing."""
    manifest, name = folder.manifest, folder.document.name
    defines = [
        f"-DMODEL={name}",
        f'-DMODEL_HEADER="{name}.h"',
        f"-DINPUTS={len(manifest.observation)}",
        f"-DOUTPUTS={len(manifest.force)}",
    ]
    done = _called(
        [
            "avr-gcc",
            f"-mmcu={mcu.mcu}",
            "-std=gnu99",
            "-Os",
            *defines,
            f"-I{folder.path}",
            "-fdata-sections",
            "-ffunction-sections",
            "-Wl,--gc-sections",
            str(HERE / "avr_main.c"),
            str(folder.source),
            "-o",
            str(elf),
            "-lm",
        ]
    )
    if done.returncode == 0:
        return ""
    found = re.search(r"error: (.*)|(region .* overflowed.*)|(relocation truncated)", done.stderr)
    return found[0].removeprefix("error: ") if found else done.stderr[:200]


def _sizes(elf: Path) -> tuple[int, int]:
    text, data, bss = map(int, _called(["avr-size", str(elf)]).stdout.splitlines()[1].split()[:3])
    return text + data, data + bss


def _run(elf: Path, mcu: Mcu, flash: int, ram: int, outputs: int) -> OnAvr:
    host = elf.with_name("host")
    built = _called(
        [
            "gcc",
            "-O2",
            "-I/usr/include/simavr",
            "-I/usr/include",
            str(HERE / "avr_host.c"),
            "-o",
            str(host),
            "-lsimavr",
            "-lelf",
        ]
    )
    if built.returncode != 0:
        raise CheckFailed(f"avr_host.c does not compile: {built.stderr[:500]}")
    said = _called([str(host), str(elf), mcu.mcu]).stdout
    found = re.search(r"over (\d) cycles (\d+) lowest (\d+) bytes(.*)", said)
    if found is None or found[1] != "1":
        return OnAvr(flash, ram, why_not="did not end: its stack met its data")
    stack = mcu.ram_end - int(found[3])
    if ram + stack > mcu.ram:
        return OnAvr(flash, ram + stack, why_not="its stack meets its data")
    force: FloatArray = np.frombuffer(bytes.fromhex(found[4].replace(" ", "")), "<f4")
    forces = tuple(float(value) for value in force[:outputs])
    return OnAvr(flash, ram + stack, int(found[2]), forces)


def _called(command: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S, check=False)
