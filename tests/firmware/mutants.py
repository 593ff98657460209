"""Changes the firmware's decisions one token at a time and asks the tests whether they notice.

    python tests/firmware/mutants.py [--every N] [--start N] [--json FILE]

Prints the mutants that survive. Those in `EQUIVALENT` behave as the original does.
Exits 1 when fewer than nine in ten of the others are killed.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from runtime.virtual.firmware_build import DECISIONS, SKETCH, UNDEFINED_TRAPS  # noqa: E402

HERE = Path(__file__).parent
LEAST_SHARE = 0.9
TESTS = ("test_decisions.py", "test_noise.py", "test_frames.py")
LIMIT_S = 120

SWAPS = {
    " < ": (" <= ", " > "),
    " <= ": (" < ",),
    " > ": (" >= ", " < "),
    " >= ": (" > ",),
    " == ": (" != ",),
    " != ": (" == ",),
    " && ": (" || ",),
    " || ": (" && ",),
    " + ": (" - ",),
    " - ": (" + ",),
    " += ": (" -= ",),
    " -= ": (" += ",),
    " * ": (" / ",),
    " / ": (" * ",),
    " << ": (" >> ",),
    " >> ": (" << ",),
    " & ": (" | ",),
    " ^= ": (" |= ",),
    "++": ("--",),
    "true": ("false",),
    "false": ("true",),
    "!": ("",),
}
NUMBER = re.compile(r"(?<![\w.])(0x[0-9A-Fa-f]+|\d+)(?=UL\b|\b)")
DECLARATION = "return|const|int|uint|bool|Reader|Body|Frame|Limits|Status"
STATEMENT = re.compile(rf"^\s+(?!{DECLARATION})[\w.\[\]]+(\(.*\)| [-+^]?= .*);$")

# Changes that cannot be seen from outside, and why. A key ends where several changes share it.
EQUIVALENT = {
    "deadman.cpp: if (expected_in_quarters_ <= 0) { -> if (expected_in_quarters_ < 0) {": (
        "the count is odd at every tick"
    ),
    "deadman.cpp: } else if (quiet_ticks_ < HUNG_AFTER_TICKS) { -> } else if (quiet_ticks_ <=": (
        "one more tick beyond the end is no other"
    ),
    "deadman.h: uint32_t silent_ticks_ = 0; ->": "starting a flight sets it",
    "deadman.h: int16_t expected_in_quarters_ = 0; ->": "starting a flight sets it",
    "deadman.h: uint16_t missed_ = 0; -> uint16_t missed_ = 1;": "starting a flight sets it",
    "deadman.h: void turned() { has_turned_ = 1; } -> void turned() { has_turned_ = 2; }": (
        "any number but zero says so"
    ),
    "mcu.h: bool armed_ = false; ->": "the constructor disarms",
    "mcu.h: bool ramping_ = false; ->": "the first command clears it, and nothing moves before",
    "mcu.cpp: stepper_.aim(0); -> stepper_.aim(1);": "a 65,536th of a step in a second",
    "stepper.cpp: speed_q16_ = 0; -> speed_q16_ = 1;": "a 65,536th of a step in a second",
    "stepper.cpp: target_q16_ = 0; -> target_q16_ = 1;": "a 65,536th of a step in a second",
    "stepper.h: int32_t target_q16_ = 0; ->": "the constructor disarms, which stops the carriage",
    "stepper.h: int32_t speed_q16_ = 0; ->": "the constructor disarms, which stops the carriage",
    "tick_limits.cpp: const uint32_t FASTEST_SLEW_US_PER_S = 2500UL * TICKS_PER_S; -> "
    "const uint32_t FASTEST_SLEW_US_PER_S = 2501UL": "either covers the whole range in a tick",
    "tick_limits.cpp: uint32_t smaller(uint32_t one, uint32_t other) { return one < other ? one : "
    "other; } -> uint32_t smaller(uint32_t one, uint32_t other) { return one <=": "equal is equal",
    "tick_limits.cpp: return value > high ? high : value; -> return value >=": "equal is equal",
    "tick_limits.cpp: if (value < low) { -> if (value <= low) {": "equal is equal",
    "frames.cpp: const uint8_t MAX_BODY_BYTES = STATUS_FRAME_BYTES - 2; -> "
    "const uint8_t MAX_BODY_BYTES = STATUS_FRAME_BYTES + 2": "a larger buffer",
    "frames.h: const uint8_t STATUS_FRAME_BYTES = 35; ->": "a larger buffer",
    "frames.cpp: return 0; -> return 1;": "too short for a frame, too",
    "frames.cpp: oversized_ = true; ->": "what fits of an oversized frame is no frame either",
    "frames.cpp: if (length < HEADER_BYTES + CRC_BYTES) { ->": (
        "a body so short has no payload of any type's length"
    ),
    "frames.h: const uint8_t MAX_FRAME_BYTES = 64; ->": "the longest valid frame has 28 bytes",
    "frames.h: uint8_t pending_[MAX_FRAME_BYTES - 1]; ->": "the longest valid frame has 28 bytes",
}


@dataclass(frozen=True)
class Mutant:
    """One line of one file, changed."""

    file: str
    line: int
    before: str
    after: str

    @property
    def name(self) -> str:
        return f"{self.file}: {self.before.strip()} -> {self.after.strip()}"


def mutants() -> Iterator[Mutant]:
    """Every single change of a token of the decision code."""
    for file in sorted(f"{name}{suffix}" for name in DECISIONS for suffix in (".cpp", ".h")):
        for number, line in enumerate((SKETCH / file).read_text().splitlines(), 1):
            code = line.split("//")[0].rstrip()
            if code and not code.startswith("#"):
                for after in sorted(set(changed(code)) - {code}):
                    yield Mutant(file, number, code, after)


def changed(code: str) -> Iterator[str]:
    for token, others in SWAPS.items():
        for found in re.finditer(re.escape(token), code):
            if token == "!" and code[found.start() + 1] == "=":
                continue
            for other in others:
                yield code[: found.start()] + other + code[found.end() :]
    for found in NUMBER.finditer(code):
        yield code[: found.start()] + str(int(found[1], 0) + 1) + code[found.end() :]
    if STATEMENT.match(code):
        yield ";"


def fate(mutant: Mutant, folder: Path) -> str:
    """'killed', 'survived', or 'no program' when it does not compile."""
    sketch = folder / "sketch"
    shutil.rmtree(sketch, ignore_errors=True)
    shutil.copytree(SKETCH, sketch)
    lines = (sketch / mutant.file).read_text().splitlines()
    lines[mutant.line - 1] = mutant.after
    (sketch / mutant.file).write_text("\n".join(lines) + "\n")
    library = folder / "decisions.so"
    sources = [sketch / f"{name}.cpp" for name in DECISIONS]
    flags = ["-std=c++11", "-fno-exceptions", "-fno-rtti", "-w", "-O1", *UNDEFINED_TRAPS]
    flags += ["-fPIC", "-shared", "-I", sketch]
    compiled = subprocess.run(
        ["g++", *flags, *sources, HERE / "decisions.cpp", "-o", library], capture_output=True
    )
    if compiled.returncode != 0:
        return "no program"
    environment = os.environ | {"WAKEDEPLOY_DECISIONS": str(library), "PYTHONPATH": str(ROOT)}
    tests = TESTS[::-1] if mutant.file.startswith("frames") else TESTS  # the likelier ones first
    pytest_alone = [sys.executable, "-m", "pytest", "-qx", "-p", "no:cacheprovider"]
    try:
        ended = subprocess.run(
            [*pytest_alone, *(HERE / name for name in tests)],
            cwd=ROOT, env=environment, capture_output=True, timeout=LIMIT_S,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "killed"
    return "survived" if ended.returncode == 0 else "killed"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--every", type=int, default=1, help="try every Nth mutant only")
    parser.add_argument("--start", type=int, default=0, help="begin with this one")
    parser.add_argument("--json", type=Path, help="write what became of each here")
    asked = parser.parse_args()
    fates: list[tuple[Mutant, str]] = []
    with tempfile.TemporaryDirectory() as folder:
        for mutant in list(mutants())[asked.start :: asked.every]:
            fates.append((mutant, fate(mutant, Path(folder))))
            if fates[-1][1] == "survived":
                print(f"survived: {mutant.file}:{mutant.line}: {mutant.name}", flush=True)
    real = [(mutant, end) for mutant, end in fates
            if end != "no program" and not mutant.name.startswith(tuple(EQUIVALENT))]  # fmt: skip
    killed = sum(end == "killed" for _, end in real)
    print(f"{killed} of {len(real)} mutants killed ({killed / len(real):.1%})")
    if asked.json:
        told = [asdict(mutant) | {"fate": end} for mutant, end in fates]
        asked.json.write_text(json.dumps(told, indent=1) + "\n")
    sys.exit(killed / len(real) < LEAST_SHARE)


if __name__ == "__main__":
    main()
