"""Ask the workflow about the known plants and count its answers.

`python -m benchmarks.known_plants --json docs/records/known-plants.json` takes twelve minutes of a
processor; it keeps each answer in the folder `--out` and goes on where it was stopped.
"""

import json
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from benchmarks.known_plants.cases import CASES, Case
from benchmarks.known_plants.controlled import CONTROLLED
from benchmarks.known_plants.plants import PLANTS
from benchmarks.known_plants.recording import controlled, recorded
from benchmarks.records import COMMIT, write
from wakedeploy import System
from wakedeploy.core.files import append_json_line, read_json_lines
from wakedeploy.core.recording import Recording
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.results import answer_of, before_after
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.logs import LogModel

Row = dict[str, Any]


def answered(case: Case) -> Row:
    """The answer, whether it is right, and the seconds that it took."""
    recording, system = flown(case)
    began_s = time.process_time()
    model = LogModel(checked(system()), [recording])
    base = fitted_base(model)
    naming = named(model, base)
    seconds = time.process_time() - began_s
    document = answer_of(naming)
    names = [e.name for e in document.effects]
    answer = {"verdict": document.verdict, "named": names, "class": document.rivals}
    leading = document.rounds[0].ranking[:3] if document.rounds else []
    return {
        "case": case.name,
        **answer,
        "judged": judged(case, answer),
        "threshold_nats": document.threshold_nats,
        "leading": [
            e.model_dump(
                include={"name", "gain_nats", "needed_nats", "interval", "judged", "forecast"}
            )
            for e in leading
        ],
        "removed": before_after(naming.model, naming.base, naming.found).removed.model_dump(),
        "seconds": seconds,
    }


def flown(case: Case) -> tuple[Recording, type[System]]:
    """A case's recording, and the system that knows nothing of what is hidden."""
    if case.plant in CONTROLLED:
        plant = CONTROLLED[case.plant]
        return controlled(plant, case.hidden, case.seed), plant.system
    driven = PLANTS[case.plant]
    recording = recorded(driven, case.hidden, case.drive, case.seed, case.coloured)
    return recording, driven.system


def judged(case: Case, answer: Mapping[str, Any]) -> str:
    """Right, class, partly (another name beside the right one), wrong, unknown or none.

    A class of more than three is an answer of "unknown". One that holds nothing that is known of
    the plant is another name.
    """
    names, alike = {*answer["named"], *answer["class"]}, {*answer["class"]}
    known = {*case.expected, *case.further}
    if case.hidden and not case.expected and answer["verdict"] == "unknown":
        return "right"
    if not names or answer["verdict"] == "unknown":
        return str(answer["verdict"])
    if not names & set(case.expected):
        return "wrong"
    if names - alike <= known and (not alike or alike & known):
        return "class" if alike else "right"
    return "partly"


def counted(rows: Sequence[Row]) -> dict[str, dict[str, int]]:
    """How often each judgement fell, with an effect hidden and without."""
    hidden = {case.name for case in CASES if case.hidden}
    return {
        "hidden": dict(Counter(row["judged"] for row in rows if row["case"] in hidden)),
        "nothing hidden": dict(Counter(row["judged"] for row in rows if row["case"] not in hidden)),
    }


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("runs/known-plants"))
@click.option("--part", nargs=2, type=int, default=(0, 1), help="K N: every N-th case from K on")
@click.option("--json", "record", type=click.Path(path_type=Path), help="write the record here")
def main(out: Path, part: tuple[int, int], record: Path | None) -> None:
    """Print each answer, and the counts of all that the folder has."""
    out.mkdir(parents=True, exist_ok=True)
    kept = out / "answers.jsonl"
    known = {row["case"]: row for row in read_json_lines(kept) if row["commit"] == COMMIT}
    for case in CASES[part[0] :: part[1]]:
        if case.name not in known:
            known[case.name] = {"commit": COMMIT, **answered(case)}
            append_json_line(kept, known[case.name])
            click.echo(_line(known[case.name]))
    rows = [known[case.name] for case in CASES if case.name in known]
    counts = counted(rows)
    click.echo(json.dumps(counts))
    if record is not None:
        kept_rows = [{k: v for k, v in row.items() if k != "commit"} for row in rows]
        write(record, {"counts": counts, "rows": kept_rows})


def _line(row: Row) -> str:
    said = ", ".join(row["named"]) + (f" of {row['class']}" if row["class"] else "")
    return f"{row['judged']:8} {row['case']:45} {said} ({row['seconds']:.1f} s)"


if __name__ == "__main__":
    main()
