"""What the first commands take: the help, and a virtual flight of 20 s.

Each command runs several times, in a process of its own, once before to warm the caches. Processor
seconds count: wall seconds also grow with whatever else the machine does. Minutes on one core.

    python -m benchmarks.first_minutes --json docs/records/first-minutes.json
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks import records
from benchmarks.faults import WORK, trained

RUNS = 7
FLIGHT = ["run-gantry", "--virtual", "--seconds", "20"]


def main() -> None:
    """Run, print, write."""
    options = _options()
    package = options.package or trained(WORK)
    commands = {
        "wakedeploy --help": (["--help"], 0.3),
        "wakedeploy run-gantry --virtual --seconds 20 --baseline": ([*FLIGHT, "--baseline"], 3.0),
        "wakedeploy run-gantry --virtual --seconds 20 --package gru.onnx": (
            [*FLIGHT, "--package", str(package)],
            3.0,
        ),
    }
    load = round(os.getloadavg()[0], 1)  # of the last minute
    rows = []
    for shown, (words, bound_s) in commands.items():
        rows.append({"command": shown, "bound_s": bound_s} | repeated(words, options.runs))
        print(rows[-1])
    if options.json:
        records.write(options.json, {"runs": options.runs, "load": load, "rows": rows})


def repeated(words: list[str], runs: int) -> dict[str, Any]:
    """Processor and wall seconds of each run of a command."""
    once(words)
    taken = [once(words) for _ in range(runs)]
    return {
        "processor_s": [round(processor_s, 3) for processor_s, _ in taken],
        "wall_s": [round(wall_s, 3) for _, wall_s in taken],
    }


def once(words: list[str]) -> tuple[float, float]:
    """Processor seconds of a command and of all that it started and waited for, and wall seconds.

    Raises CalledProcessError where it fails.
    """
    command = [sys.executable, "-m", "wakedeploy", *words]
    began_s = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - began_s
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return used.ru_utime + used.ru_stime, wall_s


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--package", type=Path, help="Default: a GRU, trained once.")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main()
