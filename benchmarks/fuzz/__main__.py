"""Read damaged files for some minutes: `python -m benchmarks.fuzz --minutes 20`.

`--kind K --seed S --number N` reads one again, and shows what becomes of it; `--keep FOLDER` leaves
its files there, as small as they can be made.
"""

import argparse
import collections
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.fuzz.pool import (
    Failure,
    Outcome,
    Pool,
    Tally,
    alone,
    judged,
    limit_memory,
    unread_sound,
)

_EXAMPLES = 3  # of one failure that are printed
_SHOWN = 300  # letters of either end of a line


class Account:
    """What a run came to: a tally for each kind, and failures by what they have in common."""

    def __init__(self) -> None:
        self.tallies: dict[str, Tally] = collections.defaultdict(Tally)
        self.failures: dict[tuple[str, ...], list[Failure]] = collections.defaultdict(list)

    def add(self, outcome: Outcome) -> None:
        """Count a batch, and report new failures."""
        self.tallies[outcome.batch.kind].join(outcome.tally)
        for failure in outcome.failures:
            alike = self.failures[(failure.kind, *failure.verdict.signature)]
            alike.append(failure)
            if len(alike) <= _EXAMPLES:
                print(failure_text(failure, brief=len(alike) > 1), flush=True)

    @property
    def files(self) -> int:
        """How many files were read in all."""
        return sum(tally.files for tally in self.tallies.values())


def failure_text(failure: Failure, brief: bool = False) -> str:
    """A failure, and what makes it again."""
    verdict = failure.verdict
    first = f"{failure.kind} {failure.number}: {verdict.trouble} at {verdict.where}"
    return first if brief else "\n    ".join([first, *map(shown, verdict.said.strip().split("\n"))])


def shown(line: str) -> str:
    """A line as a terminal may show it: without control characters, and not for ever."""
    plain = line if line.isprintable() else ascii(line)
    return plain if len(plain) <= 2 * _SHOWN else f"{plain[:_SHOWN]} … {plain[-_SHOWN:]}"


def main() -> int:
    """Read, count, print."""
    options = _options()
    alone()
    from benchmarks.fuzz.kinds import MAKE, made

    names = options.kind or list(MAKE)
    began_s = time.monotonic()
    kinds = made(names)
    print(f"{len(kinds)} kinds made in {time.monotonic() - began_s:.0f} s", flush=True)
    if options.number is not None:
        (kind,) = kinds.values()
        return _again(kind, options.seed, options.number, options.keep)
    unread = [failure_text(failure) for kind in kinds.values() for failure in unread_sound(kind)]
    if unread:
        sys.exit("\n".join(["Sound files that are not read:", *unread]))
    account, began_s = Account(), time.monotonic()
    for outcome in Pool(kinds, options.seed, options.workers).outcomes(60.0 * options.minutes):
        account.add(outcome)
    seconds = time.monotonic() - began_s
    _print(account, seconds)
    if options.json:
        from benchmarks import records

        records.write(options.json, _record(account, options, seconds, kinds))
    return 1 if account.failures else 0


def _print(account: Account, seconds: float) -> None:
    print(f"{'kind':16s} {'files':>9s} {'read':>9s} {'refused':>9s} {'failed':>7s} {'per s':>8s}"
          f" {'slowest s':>9s} {'MiB':>6s}")  # fmt: skip
    for name, kind in sorted(account.tallies.items()):
        rate = kind.files / kind.seconds if kind.seconds else 0.0
        print(f"{name:16s} {kind.files:9d} {kind.read:9d} {kind.refused:9d} {kind.failed:7d}"
              f" {rate:8.0f} {kind.slowest_s:9.2f} {kind.most_mib:6.0f}")  # fmt: skip
    failed = sum(tally.failed for tally in account.tallies.values())
    print(f"{account.files} files in {seconds:.0f} s, {failed} failures of"
          f" {len(account.failures)} kinds")  # fmt: skip


def _record(
    account: Account, options: argparse.Namespace, seconds: float, kinds: dict[str, Any]
) -> dict[str, Any]:
    from benchmarks.fuzz.kind import SLOWEST_S
    from benchmarks.fuzz.pool import MOST_MIB

    return {
        "seed": options.seed,
        "workers": options.workers,
        "seconds": round(seconds, 1),
        "processor_s": round(sum(tally.seconds for tally in account.tallies.values()), 1),
        "files": account.files,
        "failures": [failure_text(alike[0]) for alike in account.failures.values()],
        "slowest_allowed_s": SLOWEST_S,
        "most_allowed_mib": MOST_MIB,
        "kinds": [
            {"kind": name, "what": kinds[name].what} | vars(account.tallies[name]) for name in kinds
        ],
    }


def _again(kind: Any, seed: int, number: int, keep: Path | None) -> int:
    """One file, with all that its reader says; the smallest that fails alike is kept."""
    from benchmarks.fuzz.judge import Judge
    from benchmarks.fuzz.kind import put
    from benchmarks.fuzz.smallest import smallest

    sound, damaged = kind.damaged(seed, number)
    limit_memory()
    with tempfile.TemporaryDirectory() as place:
        judge = Judge(Path(place))
        with judge.listening():
            verdict = judged(judge, kind, seed, number)
            if verdict.outcome == "failed":
                damaged = smallest(judge, kind, sound, damaged, verdict)
    print(f"{verdict.outcome} in {verdict.seconds:.3f} s {verdict.trouble}\n{verdict.said}")
    for name, content in damaged.items():
        shown = content if len(content) < 2000 else content[:2000] + b"..."
        print(f"--- {name}: {len(content)} bytes\n{shown!r}")
    if keep:
        put(keep, {**sound, **damaged})
        print(f"Kept in {keep}.")
    return 1 if verdict.outcome == "failed" else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="benchmarks.fuzz", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--kind", action="append", help="Only this kind; may be repeated.")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--number", type=int, help="Of one file, with --kind and --seed.")
    parser.add_argument("--keep", type=Path, help="Where that file is left, with --number.")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if options.number is not None and len(options.kind or ()) != 1:
        parser.error("--number is of one --kind")
    return options


if __name__ == "__main__":
    sys.exit(main())
