"""`python -m benchmarks.interruptions`: disturb every command, write the record."""

import argparse
import contextlib
import functools
import json
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks import records
from benchmarks.interruptions.baseline import measured
from benchmarks.interruptions.cases import Case, World, at_a_port, cases, deploying
from benchmarks.interruptions.disks import are_possible, filled
from benchmarks.interruptions.strokes import KILLS, REQUESTS, struck
from benchmarks.interruptions.twice import doubled

KINDS = {
    "kills": functools.partial(struck, KILLS),
    "requests": functools.partial(struck, REQUESTS),
    "disks": filled,
    "twice": doubled,
}


def main() -> None:
    """Run what the options ask for; exit 1 where anything is not as it should be."""
    options = _options()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what is ignored is handed on
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="wakedeploy-interruptions-") as folder:
        result = _disturbed(options, Path(folder))
    minutes = round((time.monotonic() - began_s) / 60.0, 1)
    if options.json:
        records.write(options.json, {"seed": options.seed, "minutes": minutes} | result)
    found = [problem for kind in KINDS for row in result[kind] for problem in row["found"]]
    print(f"{len(found)} things are not as they should be, in {minutes} min.")
    sys.exit(1 if found else 0)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200, help="kill -9, over all commands")
    parser.add_argument("--requests", type=int, default=80, help="SIGINT or SIGTERM")
    parser.add_argument("--disks", type=int, default=40, help="full disks")
    parser.add_argument("--twice", type=int, default=24, help="two processes at once")
    parser.add_argument("--command", nargs="*", default=[], help="only these, by their first words")
    parser.add_argument("--seed", type=int, default=0, help="of the moments and sizes")
    parser.add_argument("--workers", type=int, default=1, help="commands at the same time")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def _disturbed(options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """The rows of each kind; none of full disks where this user may mount none."""
    world = World(folder / "world")
    world.make()
    kinds = [kind for kind in KINDS if kind != "disks" or are_possible(folder)]
    with _chosen(options.command, world, folder) as chosen:
        counts = [
            {kind: _count(getattr(options, kind), kind, case, chosen) for kind in kinds}
            for case in chosen
        ]
        with ThreadPoolExecutor(options.workers) as several:
            of_cases = functools.partial(_of_case, folder, f"{options.seed}")
            rows = list(several.map(of_cases, chosen, counts))
    return {kind: [row[kind] for row in rows if kind in row] for kind in KINDS}


def _of_case(folder: Path, seed: str, case: Case, counts: Mapping[str, int]) -> dict[str, Any]:
    """A command's row for each kind in which it is disturbed."""
    base, rows = measured(case, folder), {}
    print(f"{case.name}: {base.seconds:.1f} s undisturbed", flush=True)
    for kind, count in counts.items():
        if count:
            rows[kind] = KINDS[kind](case, base, folder, count, seed)
            print(json.dumps({kind: rows[kind]}, indent=1), flush=True)
    return rows


def _count(whole: int, kind: str, case: Case, chosen: list[Case]) -> int:
    """How often a command is disturbed in this way, at least once of all that are asked for."""
    if kind not in case.kinds or not whole:
        return 0
    others = sum(chosen_case.share for chosen_case in chosen if kind in chosen_case.kinds)
    return max(1, round(whole * case.share / others))


@contextlib.contextmanager
def _chosen(names: list[str], world: World, folder: Path) -> Iterator[list[Case]]:
    with deploying(world, folder / "rig") as deploy, at_a_port() as port:
        every = [*cases(world), port, deploy]
        yield [case for case in every if not names or case.name.startswith(tuple(names))]


if __name__ == "__main__":
    main()
