"""Ask the workflow about systems that others recorded, and judge its answers.

`python -m benchmarks.real_systems --json docs/records/real-systems.json` keeps each answer in the
folder `--out`, so that a run goes on where it was stopped, and writes all of them as the record.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from benchmarks.real_systems.answering import PARTS, answer
from benchmarks.real_systems.cases import CASES, Case
from benchmarks.real_systems.judge import agreement, answers, judged_left_in, judged_left_out
from benchmarks.records import COMMIT, write
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import append_json_line, read_json_lines

Key = tuple[str, str]


def run(cases: Sequence[Case], parts: Sequence[str], out: Path) -> dict[Key, dict[str, Any]]:
    """Every part's answer by case and part; those that the present commit has given are kept."""
    out.mkdir(parents=True, exist_ok=True)
    kept = out / "answers.jsonl"
    known = {
        (row["case"], row["part"]): row for row in read_json_lines(kept) if row["commit"] == COMMIT
    }
    for case in cases:
        for part in parts:
            if (case.name, part) in known or (part == "in" and case.added is None):
                continue
            part_answer = {
                "case": case.name,
                "part": part,
                "commit": COMMIT,
                **_answered(case, part),
            }
            append_json_line(kept, part_answer)
            known[case.name, part] = part_answer
            said = (
                ", ".join(sorted(answers(part_answer)))
                if "verdict" in part_answer
                else part_answer["refused"]
            )
            click.echo(f"{case.name}, {part}: {part_answer.get('verdict', 'refused')} {said}")
    return known


def rows(cases: Sequence[Case], known: Mapping[Key, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """A row for each case whose answers are there."""
    return [_row(case, known) for case in cases if (case.name, "out") in known]


def _row(case: Case, known: Mapping[Key, Mapping[str, Any]]) -> dict[str, Any]:
    found = {p: known[case.name, p] for p in PARTS if (case.name, p) in known}
    row: dict[str, Any] = {"case": case.name, "expected": case.expected, "source": case.source}
    row["answers"] = {
        p: {k: v for k, v in part_answer.items() if k not in ("case", "part", "commit")}
        for p, part_answer in found.items()
    }
    usable = {p: part_answer for p, part_answer in found.items() if "verdict" in part_answer}
    row["left_out"] = judged_left_out(case, usable["out"]) if "out" in usable else "refused"
    if "in" in found:
        row["left_in"] = judged_left_in(case, usable["in"]) if "in" in usable else "refused"
    if {"first", "second"} <= set(usable):
        row["halves"] = agreement(usable["first"], usable["second"])
    return row


def _answered(case: Case, part: str) -> dict[str, Any]:
    try:
        return answer(case, part)
    except UnusableInput as error:
        return {"refused": str(error)}


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("runs/real-systems"))
@click.option("--case", "chosen", multiple=True, type=click.Choice([c.name for c in CASES]))
@click.option("--part", "parts", multiple=True, type=click.Choice(PARTS))
@click.option("--json", "record", type=click.Path(path_type=Path), help="write the record here")
def main(out: Path, chosen: tuple[str, ...], parts: tuple[str, ...], record: Path | None) -> None:
    """Print each answer; write the record of all that the folder has."""
    cases = [c for c in CASES if not chosen or c.name in chosen]
    known = run(cases, parts or PARTS, out)
    record_rows = rows(CASES, known)
    for row in record_rows:
        click.echo(json.dumps({k: row.get(k) for k in ("case", "left_out", "left_in", "halves")}))
    if record is not None:
        write(record, {"rows": record_rows})


if __name__ == "__main__":
    main()
