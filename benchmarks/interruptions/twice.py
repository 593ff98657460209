"""Two processes at once on one folder, one output file, one port.

In: a case, its baseline, a number of times. Out: a row of the record. Either both end right, or one
is refused in one sentence; what is there afterwards is of one of them, whole.
"""

import random
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.interruptions.baseline import Baseline, Place, measured
from benchmarks.interruptions.cases import Case
from benchmarks.interruptions.judge import Row
from benchmarks.interruptions.processes import Command, Ended, wakedeploy


def doubled(case: Case, base: Baseline, work: Path, count: int, seed: str) -> dict[str, Any]:
    """Start a command twice, `count` times, the second at a random moment of the first.

    Where the case has `other` arguments for the same output, the second one has these.
    """
    rng, row = random.Random(f"{seed} {case.name} twice"), Row(case.name)
    second = replace(case, arguments=case.other) if case.other is not None else case
    wanted = [base.result]
    if case.other is not None and count:
        wanted.append(measured(second, work).result)
    for _ in range(count):
        later_s = rng.choice((0.0, rng.uniform(0.0, 0.9 * base.seconds)))
        with Place(work) as place:
            row.strokes += 1
            done = [f"a second one {later_s:.3f} s later"]
            pair = _both(case, second, place, later_s)
            for ended in pair:
                row.judge_files(place.folder, ended, done)
            _judge(case, wanted, place, pair, row, done)
    return row.as_json()


def _both(case: Case, second: Case, place: Place, later_s: float) -> tuple[Ended, Ended]:
    first = Command(wakedeploy(*case.arguments), place.folder)
    time.sleep(later_s)
    after = Command(wakedeploy(*second.arguments), place.folder)
    return first.ended(), after.ended()


def _judge(
    case: Case,
    wanted: list[Any],
    place: Place,
    pair: tuple[Ended, Ended],
    row: Row,
    done: list[str],
) -> None:
    if case.endless:
        refused = [ended for ended in pair if ended.status == 2 and _is_refused(ended)]
        if len(refused) != 1:
            row.found["answer"].append(f"after {done[0]}: {pair[0].stderr} {pair[1].stderr}")
        return
    if not any(ended.status == 0 for ended in pair):
        row.found["not_done"].append(f"after {done[0]}: {pair[0].stderr} {pair[1].stderr}")
        return
    for ended in pair:
        if ended.status != 0 and not _is_refused(ended):
            row.found["answer"].append(f"status {ended.status} after {done[0]}: {ended.stderr}")
    row.let_through += sum(ended.status == 0 for ended in pair)
    try:
        result = case.read_result(place.folder)
    except Exception as error:  # any failure to read what should be there
        row.found["other"].append(f"after {done[0]}: {error!r}")
        return
    if result not in wanted:
        row.found["other"].append(f"after {done[0]}: neither the one nor the other")


def _is_refused(ended: Ended) -> bool:
    """In one sentence that says what to do."""
    error_lines = [line for line in ended.stderr.splitlines() if line.startswith("Error: ")]
    return ended.status in (1, 2) and len(error_lines) == 1 and "; " in error_lines[0]
