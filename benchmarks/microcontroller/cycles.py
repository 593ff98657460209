"""Cycles of a step on a Cortex-M4F, estimated from every instruction that it executed.

QEMU logs the address of each instruction; the disassembly says what stands there; Arm's Cortex-M4
Technical Reference Manual (section 3.3.1, and 7.2.3 for floating point) says what each kind takes.
Added is what an STM32F405 at 168 MHz waits for weights: its flash gives 16 bytes at a time after 5
wait states, and weights are read once a step, in order. Not counted: stalls between floating-point
instructions that use each other's results, and instruction fetches that its cache does not hold.
"""

import os
import re
import subprocess
import tempfile
import threading
from collections import Counter
from pathlib import Path

from benchmarks.microcontroller.boards import (
    CORTEX_M4F,
    SIMULATOR,
    Board,
    measuring_program,
)
from runtime.compiled.folder import CFolder

CLOCK_HZ = 168e6
FLASH_WAIT, FLASH_LINE = 5, 16  # cycles, bytes
_BRANCH = 3  # 1 + a refill of the pipeline of 1 to 3: two in the middle
# Kinds of instructions by the beginning of their names, the first that fits, and their cycles.
_TIMES = (
    (("vldm", "vstm", "vpush", "vpop", "ldm", "stm", "push", "pop"), None),
    (("vldr", "ldr"), 2),
    (("vstr", "str"), 2),
    (("vfma", "vfms", "vmla", "vmls", "vnmla", "vfnma", "vfnms"), 3),
    (("vdiv", "vsqrt"), 14),
    (("sdiv", "udiv"), 7),
    (
        (
            "b.",
            "bl",
            "bx",
            "cb",
            "beq",
            "bne",
            "bgt",
            "blt",
            "bge",
            "ble",
            "bhi",
            "bls",
            "bcs",
            "bcc",
        ),
        _BRANCH,
    ),
    (("bmi", "bpl", "b\t"), _BRANCH),
)
_TRACED = re.compile(r"\[[0-9a-f]+/([0-9a-f]+)/")


def cycles_of_a_step(folder: CFolder, board: Board = CORTEX_M4F) -> tuple[int, int]:
    """Instructions and estimated cycles of a step, the second one from a reset."""
    with measuring_program(folder, board, steps=1) as elf:
        code = _disassembled(elf)
        counts = _executed(elf, board, code)
    instructions = sum(counts.values())
    cycles = sum(count * _cycles(*code[place]) for place, count in counts.items())
    waits = folder.document.weight_bytes / FLASH_LINE * FLASH_WAIT
    return instructions, round(cycles + waits)


def _cycles(name: str, operands: str) -> int:
    for starts, cycles in _TIMES:
        if name.startswith(starts):
            return 1 + _registers(operands) if cycles is None else cycles
    return _BRANCH if name == "b" else 1


def _registers(operands: str) -> int:
    """How many registers a list such as {r4-r7, lr} names."""
    listed = operands.partition("{")[2].partition("}")[0]
    count = 0
    for part in listed.split(","):
        ends = re.findall(r"\d+", part)
        count += int(ends[1]) - int(ends[0]) + 1 if "-" in part and len(ends) == 2 else 1
    return count


def _disassembled(elf: Path) -> dict[int, tuple[str, str]]:
    listing = subprocess.run(
        ["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", str(elf)],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    code = {}
    for line in listing.splitlines():
        found = re.match(r"\s+([0-9a-f]+):\t(\S+)\s*(.*)$", line)
        if found:
            code[int(found[1], 16)] = (found[2], found[3])
        elif (named := re.match(r"^([0-9a-f]+) <traced_step>:", line)) is not None:
            code[-1] = (named[1], "")
    return code


def _executed(elf: Path, board: Board, code: dict[int, tuple[str, str]]) -> Counter[int]:
    """How often each address was executed in the second call of the traced function."""
    entry = int(code.pop(-1)[0], 16)
    command = [SIMULATOR, "-M", board.machine, "-nographic", "-monitor", "none", "-serial", "none"]
    command += ["-semihosting-config", "enable=on,target=native", "-singlestep"]
    with tempfile.TemporaryDirectory() as place:
        pipe = Path(place) / "trace"
        os.mkfifo(pipe)
        command += ["-d", "exec,nochain", "-D", str(pipe), "-kernel", str(elf)]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        guard = threading.Timer(300, process.kill)
        guard.start()
        try:
            return _counted(pipe, entry)
        finally:
            guard.cancel()
            process.kill()
            process.wait()


def _counted(pipe: Path, entry: int) -> Counter[int]:
    counts: Counter[int] = Counter()
    calls = 0
    with pipe.open(encoding="ascii", errors="replace") as lines:
        for line in lines:
            found = _TRACED.search(line)
            if found is None:
                continue
            place = int(found[1], 16)
            if place == entry:
                calls += 1
                if calls == 1:
                    back = None
            if calls == 2:
                if line.rstrip().endswith(" main") or line.rstrip().endswith(" ticks_of"):
                    return counts
                counts[place] += 1
    raise RuntimeError(f"the traced function was called {calls} times; {back}")
