"""Changes the firmware's decisions one token at a time and asks the tests whether they notice.

    python tests/firmware/mutants.py [--every N] [--start N] [--listed | --again]
        [--workers N] [--json docs/records/mutants.json]

Prints the mutants that survive. Those in `EQUIVALENT` behave as the original does: each has to
survive and does not count. Exits 1 when fewer than nine in ten of the others are noticed or when a
listed one is, 2 when nothing can be judged. `--listed` tries the list alone, as is due after a
change of the sketch; `--again` the survivors of the record, after a change of the tests. The record
of the last whole run is docs/records/mutants.json.
"""

import argparse
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks import records  # noqa: E402
from runtime.virtual.firmware_build import DECISIONS, SKETCH, UNDEFINED_TRAPS  # noqa: E402

HERE = Path(__file__).parent
LEAST_SHARE = 0.9
TESTS = ("test_decisions.py", "test_noise.py", "test_frames.py")
LIMIT_S = 600  # the tests take 10 s of a core, on a busy machine minutes

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

# Changes that cannot be seen from outside, and why: file, line before, line after.
Change = tuple[str, str, str]
EQUIVALENT: dict[Change, str] = {
    (
        "session.h",
        "uint16_t last_sequence_ = 0;",
        "uint16_t last_sequence_ = 1;",
    ): "a greeting sets it, and before one nothing is heard",
    (
        "session.h",
        "bool may_arm_ = false;",
        "bool may_arm_ = true;",
    ): "a greeting sets it, and before one nothing is heard",
    (
        "stepper.h",
        "int32_t phase_ = 0;",
        "int32_t phase_ = 1;",
    ): "a part of a step in 655 million",
    (
        "deadman.cpp",
        "if (expected_in_quarters_ <= 0) {",
        "if (expected_in_quarters_ < 0) {",
    ): "the count is odd at every tick",
    (
        "deadman.cpp",
        "} else if (quiet_ticks_ < HUNG_AFTER_TICKS) {",
        "} else if (quiet_ticks_ <= HUNG_AFTER_TICKS) {",
    ): "one more tick beyond the end is no other",
    (
        "deadman.h",
        "uint32_t silent_ticks_ = 0;",
        "uint32_t silent_ticks_ = 1;",
    ): "starting a flight sets it",
    (
        "deadman.h",
        "int16_t expected_in_quarters_ = 0;",
        "int16_t expected_in_quarters_ = 1;",
    ): "starting a flight sets it",
    (
        "deadman.h",
        "void turned() { has_turned_ = 1; }",
        "void turned() { has_turned_ = 2; }",
    ): "any number but zero says so",
    ("mcu.h", "bool armed_ = false;", "bool armed_ = true;"): "the constructor disarms",
    ("mcu.cpp", "stepper_.aim(0);", "stepper_.aim(1);"): "a 65,536th of a step in a second",
    ("stepper.cpp", "speed_q16_ = 0;", "speed_q16_ = 1;"): "a 65,536th of a step in a second",
    ("stepper.cpp", "target_q16_ = 0;", "target_q16_ = 1;"): "a 65,536th of a step in a second",
    (
        "stepper.h",
        "int32_t target_q16_ = 0;",
        "int32_t target_q16_ = 1;",
    ): "the constructor disarms, which stops the carriage",
    (
        "stepper.h",
        "int32_t speed_q16_ = 0;",
        "int32_t speed_q16_ = 1;",
    ): "the constructor disarms, which stops the carriage",
    (
        "tick_limits.cpp",
        "const uint32_t FASTEST_SLEW_US_PER_S = 2500UL * TICKS_PER_S;",
        "const uint32_t FASTEST_SLEW_US_PER_S = 2501UL * TICKS_PER_S;",
    ): "either covers the whole range in a tick",
    (
        "tick_limits.cpp",
        "uint32_t smaller(uint32_t one, uint32_t other) { return one < other ? one : other; }",
        "uint32_t smaller(uint32_t one, uint32_t other) { return one <= other ? one : other; }",
    ): "equal is equal",
    (
        "tick_limits.cpp",
        "uint32_t larger(uint32_t one, uint32_t other) { return one < other ? other : one; }",
        "uint32_t larger(uint32_t one, uint32_t other) { return one <= other ? other : one; }",
    ): "equal is equal",
    (
        "tick_limits.cpp",
        "return value > high ? high : value;",
        "return value >= high ? high : value;",
    ): "equal is equal",
    ("tick_limits.cpp", "if (value < low) {", "if (value <= low) {"): "equal is equal",
    (
        "frames.cpp",
        "const uint8_t MAX_BODY_BYTES = STATUS_FRAME_BYTES - 2;",
        "const uint8_t MAX_BODY_BYTES = STATUS_FRAME_BYTES + 2;",
    ): "a larger buffer",
    (
        "frames.h",
        "const uint8_t STATUS_FRAME_BYTES = 35;",
        "const uint8_t STATUS_FRAME_BYTES = 36;",
    ): "a larger buffer",
    ("frames.cpp", "return 0;", "return 1;"): "too short for a frame, too",
    (
        "frames.cpp",
        "oversized_ = true;",
        "oversized_ = false;",
    ): "what fits of an oversized frame is no frame either",
    ("frames.cpp", "oversized_ = true;", ";"): "what fits of an oversized frame is no frame either",
    (
        "frames.cpp",
        "if (length < HEADER_BYTES + CRC_BYTES) {",
        "if (length < HEADER_BYTES - CRC_BYTES) {",
    ): "a body so short has no payload of any type's length",
    (
        "frames.h",
        "const uint8_t MAX_FRAME_BYTES = 64;",
        "const uint8_t MAX_FRAME_BYTES = 65;",
    ): "the longest valid frame has 35 bytes",
    (
        "frames.h",
        "uint8_t pending_[MAX_FRAME_BYTES - 1];",
        "uint8_t pending_[MAX_FRAME_BYTES + 1];",
    ): "the longest valid frame has 35 bytes",
    (
        "frames.h",
        "uint8_t pending_[MAX_FRAME_BYTES - 1];",
        "uint8_t pending_[MAX_FRAME_BYTES - 2];",
    ): "the longest valid frame has 35 bytes",
}


@dataclass(frozen=True)
class Mutant:
    """One line of one file, changed."""

    file: str
    line: int
    before: str
    after: str

    @property
    def change(self) -> Change:
        return self.file, self.before.strip(), self.after.strip()

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.before.strip()} -> {self.after.strip()}"


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


def fate(mutant: Mutant | None, folder: Path) -> str:
    """'killed', 'timed out', 'survived', or 'no program' when it does not compile.

    None is the firmware as it is. RuntimeError when the tests did not run.
    """
    sketch = folder / "sketch"
    shutil.rmtree(sketch, ignore_errors=True)
    shutil.copytree(SKETCH, sketch)
    if mutant is not None:
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
    environment["WAKEDEPLOY_EXAMPLES"] = "unshrunk"
    frames_first = mutant is not None and mutant.file.startswith("frames")
    tests = TESTS[::-1] if frames_first else TESTS  # the likelier ones first
    pytest_alone = [sys.executable, "-m", "pytest", "-qx", "-p", "no:cacheprovider"]
    try:
        ended = subprocess.run(
            [*pytest_alone, *(HERE / name for name in tests)],
            cwd=ROOT, env=environment, capture_output=True, text=True, timeout=LIMIT_S,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "timed out"
    if ended.returncode > 1:  # below 0: undefined behaviour has ended the tests
        raise RuntimeError(f"pytest could not run the tests:\n{ended.stdout}{ended.stderr}")
    return "survived" if ended.returncode == 0 else "killed"


def unmatched(every: Sequence[Mutant]) -> list[Change]:
    """Entries of `EQUIVALENT` that change nothing, or more than one line."""
    return [change for change in EQUIVALENT if sum(m.change == change for m in every) != 1]


def judged(fates: Sequence[tuple[Mutant, str]]) -> dict[str, Any]:
    """The record of a run: how many were tried and noticed, and which of them say something."""
    programs = [(mutant, end) for mutant, end in fates if end != "no program"]
    real = [(mutant, end) for mutant, end in programs if mutant.change not in EQUIVALENT]
    listed = [(mutant, end) for mutant, end in programs if mutant.change in EQUIVALENT]
    noticed = sum(end != "survived" for _, end in real)
    return {
        "tried": len(real),
        "noticed": noticed,
        "share": noticed / len(real) if real else None,
        "no_program": len(fates) - len(programs),
        "timed_out": [str(mutant) for mutant, end in real if end == "timed out"],
        "survived": [str(mutant) for mutant, end in real if end == "survived"],
        "equivalent": {str(m): EQUIVALENT[m.change] for m, end in listed if end == "survived"},
        "wrongly_listed": [str(mutant) for mutant, end in listed if end != "survived"],
    }


def tried(wanted: Sequence[Mutant], workers: int) -> list[tuple[Mutant, str]]:
    """What becomes of each; SystemExit (2) when the firmware as it is does not pass."""

    def one(mutant: Mutant | None) -> str:
        with tempfile.TemporaryDirectory() as folder:
            return fate(mutant, Path(folder))

    if (end := one(None)) != "survived":
        print(f"The firmware as it is does not pass these tests ({end}).", file=sys.stderr)
        sys.exit(2)
    fates = []
    with ThreadPoolExecutor(workers) as pool:
        for mutant, end in zip(wanted, pool.map(one, wanted), strict=True):
            fates.append((mutant, end))
            if end in ("survived", "timed out") and mutant.change not in EQUIVALENT:
                print(f"{end}: {mutant}", flush=True)
    return fates


def tried_again(record: dict[str, Any], every: Sequence[Mutant], workers: int) -> dict[str, Any]:
    """The record of a whole run, with what tests added since notice of its survivors.

    SystemExit (2) when it is of other decisions or of some mutants only.
    """
    judged_then = record["tried"] + record["no_program"]
    judged_then += len(record["equivalent"]) + len(record["wrongly_listed"])
    if record["decisions"] != digest_of_decisions() or judged_then != len(every):
        print("The record is of other decisions, or of some mutants only.", file=sys.stderr)
        sys.exit(2)
    now = judged(tried([m for m in every if str(m) in record["survived"]], workers))
    of = record["tried"] - len(now["equivalent"]) - len(now["wrongly_listed"])
    noticed = of - len(now["survived"])
    more = ("timed_out", "wrongly_listed")
    return record | {
        "tried": of,
        "noticed": noticed,
        "share": noticed / of,
        "survived": now["survived"],
        "equivalent": record["equivalent"] | now["equivalent"],
        **{key: record[key] + now[key] for key in more},
    }


def digest_of_decisions() -> str:
    """Which code a record is of: the decisions', line by line, comments left out."""
    files = sorted(f"{name}{suffix}" for name in DECISIONS for suffix in (".cpp", ".h"))
    lines = [(SKETCH / file).read_text().splitlines() for file in files]
    code = "\0".join("\n".join(line.split("//")[0].rstrip() for line in one) for one in lines)
    return hashlib.sha256(code.encode()).hexdigest()[:16]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--every", type=int, default=1, help="try every Nth mutant only")
    parser.add_argument("--start", type=int, default=0, help="begin with this one")
    parser.add_argument("--listed", action="store_true", help="try those in EQUIVALENT only")
    parser.add_argument(
        "--again", action="store_true", help="try what survived in the record at --json, no more"
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="mutants at a time")
    parser.add_argument("--json", type=Path, help="write the record here")
    asked = parser.parse_args()
    every = list(mutants())
    for change in (gone := unmatched(every)):
        print(f"in EQUIVALENT, and no such mutant or several: {change}", file=sys.stderr)
    if gone:
        sys.exit(2)
    if asked.again:
        record = tried_again(json.loads(asked.json.read_text()), every, asked.workers)
    else:
        wanted = [m for m in every if m.change in EQUIVALENT] if asked.listed else every
        record = judged(tried(wanted[asked.start :: asked.every], asked.workers))
    print(
        f"{record['noticed']} of {record['tried']} mutants noticed, {len(record['timed_out'])} of "
        f"them by running out of time; {len(record['equivalent'])} are equivalent."
    )
    for mutant in record["wrongly_listed"]:
        print(f"in EQUIVALENT, and noticed: {mutant}")
    if asked.json:
        of = {"decisions": digest_of_decisions()}
        of |= {"start": asked.start, "every": asked.every, "of": len(every)}
        records.write(asked.json, of | record)
    too_few = record["tried"] and record["share"] < LEAST_SHARE
    sys.exit(1 if too_few or record["wrongly_listed"] else 0)


if __name__ == "__main__":
    main()
