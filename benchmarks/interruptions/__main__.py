"""`python -m benchmarks.interruptions`: disturb every command, write the record."""

import argparse
import contextlib
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks import records
from benchmarks.interruptions.baseline import measured
from benchmarks.interruptions.cases import Case, World, cases, deploying
from benchmarks.interruptions.strokes import KILLS, REQUESTS, struck


def main() -> None:
    """Run what the options ask for; exit 1 where anything is not as it should be."""
    options = _options()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what is ignored is handed on
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="wakedeploy-interruptions-") as folder:
        result = _disturbed(options, Path(folder))
    result["minutes"] = round((time.monotonic() - began_s) / 60.0, 1)
    if options.json:
        records.write(options.json, result)
    found = [one for rows in result.values() if isinstance(rows, list) for row in rows for one in row["found"]]
    print(f"{len(found)} things are not as they should be, in {result['minutes']} min.")
    sys.exit(1 if found else 0)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200, help="kill -9, over all commands")
    parser.add_argument("--requests", type=int, default=120, help="SIGINT or SIGTERM")
    parser.add_argument("--disks", type=int, default=60, help="full disks")
    parser.add_argument("--twice", type=int, default=30, help="two processes at once")
    parser.add_argument("--command", nargs="*", default=[], help="only these, by their first words")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def _disturbed(options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    world = World(folder / "world")
    world.make()
    result: dict[str, Any] = {"kills": [], "requests": [], "disks": [], "twice": []}
    with _chosen(options.command, world, folder) as chosen:
        whole = sum(case.share for case in chosen)
        for case in chosen:
            base = measured(case, folder)
            print(f"{case.name}: {base.seconds:.1f} s, {base.files} files, {base.bytes} bytes", flush=True)
            for kind, numbers in (("kills", KILLS), ("requests", REQUESTS)):
                count = round(getattr(options, kind) * case.share / whole)
                row = struck(case, base, folder, count, numbers, f"{options.seed}")
                result[kind].append(row)
                print(json.dumps({kind: row}, indent=1), flush=True)
    return result


@contextlib.contextmanager
def _chosen(names: list[str], world: World, folder: Path) -> Iterator[list[Case]]:
    with deploying(world, folder / "rig") as deploy:
        every = [*cases(world), deploy]
        yield [case for case in every if not names or case.name.startswith(tuple(names))]


if __name__ == "__main__":
    main()
