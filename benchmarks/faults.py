"""Faults in flight: how hard the sufferer meets a stop when something breaks, and what notices it.

Flies the default rig in simulated time with the loop that flies at the rig. Every fault of
`benchmarks.injected` begins in every phase of a flight, with a GRU's feedforward and, where it has
nothing to do with predictions, by PID alone too. With --mismatch all of it is flown again with
plants that differ from the rig file as far as calibration leaves open. A flight is unsafe when the
sufferer meets the lower stop faster than 1.0 m/s or the upper stop faster than 0.5 m/s, or when a
motor turns at the end.

    python -m benchmarks.faults --mismatch --json docs/records/faults.json

With --healthy nothing breaks: how often the loop ends a flight that it should not have ended.

    python -m benchmarks.faults --healthy 500 --json docs/records/faults-healthy.json

With --blind the link or the sensor is gone at random moments, on other plants, in weak and strong
wakes.

    python -m benchmarks.faults --blind 100 --json docs/records/faults-blind.json
"""

import argparse
import itertools
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from benchmarks import records
from benchmarks.injected import descents, healthy, table
from benchmarks.injected.catalogue import FAULTS, GROUPS
from benchmarks.injected.flight import REST_S, SECONDS, Case, Moment, fly
from benchmarks.injected.parting import fly_all
from benchmarks.injected.phases import PHASES, moments
from wakedeploy.core.processes import processes

WORK = Path(tempfile.gettempdir()) / "wakedeploy-faults"
MINUTES = 8.0
LINE_EVERY_S = 10.0
MOST_OF_A_BUNDLE = 40
Job = TypeVar("Job")
Done = TypeVar("Done")


def main() -> None:
    """Fly, print the tables, write them."""
    options = _options()
    package = options.package or trained(WORK)
    work = healthy_flights if options.healthy else blind_descents if options.blind else campaign
    for result in work(options, package):
        if options.json:
            records.write(options.json, result)


def campaign(options: argparse.Namespace, package: Path) -> Iterator[dict[str, Any]]:
    """Every chosen fault in every phase, on the exact plant, then perhaps on others."""
    chosen = _chosen(options.only, options.group)
    when = moments(list(PHASES)[: options.phases])
    result: dict[str, Any] = {
        "seconds": SECONDS,
        "rest_s": REST_S,
        "phases": [moment.phase for moment in when],
        "seeds": [moment.seed for moment in when],
        "unsafe_flights": table.COLUMNS,
    }
    for name in ("exact", "mismatched") if options.mismatch else ("exact",):
        jobs = bundles(chosen, when, package, is_mismatched=name == "mismatched")
        flights = [flight for bundle in each(fly_all, jobs, options.workers) for flight in bundle]
        rows = table.by_fault(flights)
        print(f"\n{name} plant\n{table.printed(rows)}")
        result[name] = {"faults": rows, "unsafe_flights": table.unsafe_rows(flights)}
        yield result


def healthy_flights(options: argparse.Namespace, package: Path) -> Iterator[dict[str, Any]]:
    """Flights without a fault, a fifth as many with strong wakes."""
    rows: list[dict[str, Any]] = []
    for wake, count in zip(healthy.WAKES, (options.healthy, options.healthy // 5), strict=True):
        jobs = healthy.healthy_cases(wake, count, package)
        rows += healthy.summed_up(wake, each(fly, jobs, options.workers))
    print(healthy.printed(rows))
    yield {"seconds": SECONDS, "rows": rows}


def blind_descents(options: argparse.Namespace, package: Path) -> Iterator[dict[str, Any]]:
    """Descents without a link or a height, from anywhere."""
    rows = descents.summed_up(each(fly, descents.cases(options.blind, package), options.workers))
    print(descents.printed(rows))
    yield {"seconds": SECONDS, "rows": rows}


def bundles(
    faults: Sequence[str], when: Sequence[Moment], package: Path, *, is_mismatched: bool = False
) -> list[list[Case]]:
    """Every fault in every phase, with the package, and by PID alone where that makes sense.

    A bundle's cases have everything in common until their faults begin.
    """
    found: list[list[Case]] = []
    for moment, pilot in itertools.product(when, (package, None)):
        by_rig: dict[str, list[Case]] = {}
        for name in faults:
            if pilot is not None or not FAULTS[name].needs_predictor:
                case = Case(name, moment, pilot, is_mismatched)
                by_rig.setdefault(repr(FAULTS[name].rig), []).append(case)
        for alike in by_rig.values():
            found += [
                alike[i : i + MOST_OF_A_BUNDLE] for i in range(0, len(alike), MOST_OF_A_BUNDLE)
            ]
    return found


def each(work: Callable[[Job], Done], jobs: Sequence[Job], workers: int) -> list[Done]:
    """Do all jobs on `workers` processes; a line on stderr shows how far they are."""
    done: list[Done] = []
    began_s = told_s = time.monotonic()
    with processes(workers) as mapped:
        for result in mapped(work, jobs):
            done.append(result)
            if (now_s := time.monotonic()) > told_s + LINE_EVERY_S or len(done) == len(jobs):
                told_s = now_s
                print(f"{len(done)} of {len(jobs)}, {now_s - began_s:.0f} s", file=sys.stderr)
    return done


def trained(work: Path) -> Path:
    """A GRU's package of the default rig, made in a folder if it is not there yet."""
    path, data, runs = work / "gru.onnx", work / "set", work / "runs"
    if not path.exists():
        if not (data / "dataset.json").exists():
            _run("data", "make", "gantry", "--out", data, "--minutes", MINUTES, "--seed", 0)
        _run("train", "--data", data, "--arch", "gru", "--out", runs)
        run = runs / "gantry" / "gru" / "s0"
        _run("export", "--arch", "gru", "--run", run, "--data", data, "--out", path)
    return path


def _run(*arguments: object) -> None:
    command = [sys.executable, "-m", "wakedeploy", *(str(a) for a in arguments)]
    subprocess.run(command, check=True, stdout=sys.stderr)


def _chosen(only: Sequence[str], group: str | None) -> list[str]:
    return [
        name
        for name, fault in FAULTS.items()
        if (not only or name in only) and group in (None, fault.group)
    ]


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--phases", type=int, default=len(PHASES), choices=range(1, len(PHASES) + 1)
    )
    parser.add_argument("--mismatch", action="store_true", help="Fly other plants as well.")
    parser.add_argument("--healthy", type=int, metavar="FLIGHTS", help="Let nothing break.")
    parser.add_argument("--blind", type=int, metavar="FLIGHTS", help="Of each fault and wake.")
    parser.add_argument("--only", nargs="+", default=[], choices=list(FAULTS), metavar="NAME")
    parser.add_argument("--group", choices=GROUPS)
    parser.add_argument("--package", type=Path, help="Default: a GRU, trained once.")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    main()
