"""Whether any frame, damaged frame or noise makes the firmware's decisions do what they must not.

Compiles the decisions with sanitizers and a driver that sends them what a broken cable and a mad
host could send, and checks after every byte and every tick what must hold. One core takes
about half an hour for 10⁸ frames.

    python -m benchmarks.frames --count 100000000 --json docs/records/frames.json
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks import records
from runtime.virtual.firmware_build import sanitized_program
from wakedeploy.core.errors import UnusableInput

DRIVER = records.ROOT / "tests" / "firmware" / "frames_fuzz.cpp"


def tried(count: int, seed: int) -> dict[str, Any]:
    """What `count` frames were and did; UnusableInput with the program's words when one fails."""
    program = sanitized_program(DRIVER)
    began_s = time.monotonic()
    ended = subprocess.run(
        [str(program), str(count), str(seed)], capture_output=True, text=True, check=False
    )
    if ended.returncode != 0:
        raise UnusableInput(f"{count} frames with seed {seed}: {ended.stderr.strip()}")
    counts: dict[str, Any] = json.loads(ended.stdout)
    return {"seed": seed, "seconds": time.monotonic() - began_s} | counts


def main() -> None:
    """Compile, send, print, write."""
    options = _options()
    try:
        result = tried(options.count, options.seed)
    except UnusableInput as error:
        sys.exit(str(error))
    print(json.dumps(result, indent=1))
    if options.json:
        records.write(options.json, result)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1_000_000, help="frames")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main()
