"""Results of other ways to mend a model, on the recordings and splits of `real_systems`."""

from collections.abc import Mapping
from typing import Any

from benchmarks.results.real_systems import RECORD as ANSWERS
from benchmarks.results.section import Records, Section, paragraphs, table

RECORD = "system-comparison.json"
_WAYS = ("stated", "plain", "pysindy", "network")
_COMMAND = f"python -m benchmarks.real_systems.comparison --json docs/records/{RECORD}"
Row = Mapping[str, Any]


def compared(records: Records) -> Section:
    """Held-out errors of every way, beside what was named."""
    record = records.json(RECORD)
    answers = {row["case"]: row["answers"]["out"] for row in records.json(ANSWERS)["rows"]}
    head = ["recording", "output", "unit", "as stated", "plain fit", "PySINDy", "network",
            "with what was named", "named"]  # fmt: skip
    lines = [line for row in record["rows"] for line in _lines(row, answers.get(row["case"], {}))]
    return Section(
        "Beside what people use today",
        "The same recordings and the same sealed blocks, by a least-squares fit, PySINDy and a "
        "small network.",
        paragraphs(
            f"Of {len(answers)} recordings, {len(record['rows'])} were measured. Root mean "
            "square of measured less forecast on sealed blocks. *Plain fit*: the "
            "textbook system's constants by least squares of its forecasts. *PySINDy* "
            f"{record['pysindy']}: sparse polynomials of states and inputs for what the system "
            "leaves of its rates. *Network*: two layers of 32 for the same; it names nothing. The "
            "best of a row is bold. *With what was named* is from the record above. A dash is a "
            "forecast that ran off, or a missing answer.",
            table(head, lines),
        ),
        (_COMMAND,),
    )


def _lines(row: Row, answer: Row) -> list[list[str]]:
    if "refused" in row:
        return [[row["case"], "refused", *["–"] * 7]]
    named = ", ".join(effect["name"] for effect in answer.get("effects", ())) or "nothing"
    return [
        [row["case"], output, errors["unit"],
         *_numbers([*(errors[way] for way in _WAYS), _found(answer, output)]), named]
        for output, errors in row["errors"].items()
    ]  # fmt: skip


def _found(answer: Row, output: str) -> float | None:
    errors = answer.get("errors", {}).get(output, {})
    return None if errors.get("found") is None else float(errors["found"])


def _numbers(values: list[float | None]) -> list[str]:
    """With the least in bold."""
    there = [v for v in values if v is not None]
    least = min(there) if there else None
    shown = ["–" if v is None else f"{v:.4g}" for v in values]
    return [f"**{s}**" if v is not None and v == least else s
            for s, v in zip(shown, values, strict=True)]  # fmt: skip
