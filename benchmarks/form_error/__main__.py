"""Fly the gantries of other forms, ask the workflow about each, and print a dose curve.

`python -m benchmarks.form_error --out FOLDER [--per-dose N] [--per-effect N] [--workers N]` keeps
flights and answers in the folder, so that a run goes on where it was stopped; `--record` writes
`docs/records/form-error.json`, with `--table-only` of the cases that the folder has. All cases
take hours of a core: `--go-on` counts those of the record as done, each with its commit.
"""

import json
import random
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click

from benchmarks.form_error.cases import Case, flights_of
from benchmarks.form_error.judge import row
from benchmarks.form_error.plan import hidden_names, no_effect, trivial, with_effect
from benchmarks.form_error.table import curve, curve_text
from benchmarks.form_error.worth import worth_of
from benchmarks.records import COMMIT, FOLDER, write
from wakedeploy.core.files import append_json_line, read_json_lines
from wakedeploy.core.parallel import parallel_map
from wakedeploy.gap.systems.gantry.workflow import close
from wakedeploy.rig.file import default_rig

RECORD = FOLDER / "form-error.json"


def answered(case: Case, out: Path) -> dict[str, Any]:
    """One case's row: flown, asked about, judged."""
    logs = flights_of(case, out / "flights")
    began_s = time.process_time()
    folder = out / "answers" / f"{case.name}-{case.digest}"
    result = close(logs[0].parent / "rig.toml", logs, folder, workers=1, report=False, plan=False)
    seconds, hidden = time.process_time() - began_s, hidden_names(case)
    worth = worth_of(hidden, logs, folder) if hidden else {}
    return {"commit": COMMIT, **row(case, result.as_json(), default_rig(), seconds, worth)}


def rows_of(out: Path) -> dict[str, dict[str, Any]]:
    """The rows that a folder has, by their case's digest."""
    return {line["digest"]: line for line in read_json_lines(out / "rows.jsonl") if "worth" in line}


def go_on(out: Path) -> None:
    """Rows of the record that a folder lacks are written there."""
    record, known = json.loads(RECORD.read_text("utf-8")), rows_of(out)
    out.mkdir(parents=True, exist_ok=True)
    for line in record["rows"]:
        if line["digest"] not in known:
            append_json_line(out / "rows.jsonl", {"commit": record["commit"], **line})


def run(cases: Sequence[Case], out: Path, workers: int) -> list[dict[str, Any]]:
    """All rows; those that the folder has already are not made again.

    They are made in an order that leaves some of each kind where a run is stopped.
    """
    kept = out / "rows.jsonl"
    out.mkdir(parents=True, exist_ok=True)
    known = rows_of(out)
    remaining = [case for case in cases if case.digest not in known]
    random.Random(0).shuffle(remaining)

    def keep(case: Case, line: dict[str, Any]) -> None:
        append_json_line(kept, {"digest": case.digest, **line})
        known[case.digest] = line
        click.echo(f"{line['case']}: {line['answer']}")

    parallel_map(partial(answered, out=out), remaining, workers=workers, on_done=keep)
    return [known[case.digest] for case in cases]


@click.command()
@click.option("--out", type=click.Path(path_type=Path), required=True)
@click.option("--per-dose", default=20, help="gantries without an effect, at each misfit to 4 %")
@click.option("--per-effect", default=4, help="gantries for each library effect")
@click.option("--trivia", default=6, help="gantries with effects too small to matter")
@click.option("--workers", default=2)
@click.option("--go-on", "goes_on", is_flag=True, help="cases of the record are done")
@click.option("--table-only", is_flag=True, help="fly nothing: tables of what is there")
@click.option("--record", is_flag=True, help="write docs/records/form-error.json")
def main(
    out: Path,
    per_dose: int,
    per_effect: int,
    trivia: int,
    workers: int,
    goes_on: bool,
    table_only: bool,
    record: bool,
) -> None:
    """Tell the dose curve."""
    cases = [*no_effect(per_dose), *with_effect(per_effect), *trivial(trivia)]
    if goes_on:
        go_on(out)
    if table_only:
        known = rows_of(out)
        rows = [known[case.digest] for case in cases if case.digest in known]
    else:
        rows = run(cases, out, workers)
    click.echo(curve_text(curve(rows)))
    if record:
        write(RECORD, {"curve": curve(rows), "rows": rows})
    (out / "curve.json").write_text(json.dumps(curve(rows), indent=1))


if __name__ == "__main__":
    main()
