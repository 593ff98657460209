"""Results of the gap workflow on small plants of which it is known what the model lacks."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.results.section import Records, Section, paragraphs, table

RECORD = "known-plants.json"
Row = Mapping[str, Any]
_JUDGED = ("right", "class", "partly", "wrong", "unknown", "none")


def counted(records: Records) -> Section:
    """How often the answer is right, and every one that is not."""
    record = records.json(RECORD)
    counts: Mapping[str, Mapping[str, int]] = record["counts"]
    rows: Sequence[Row] = record["rows"]
    head = ["", *_JUDGED]
    lines = [
        [what, *(str(found.get(judged, 0)) for judged in _JUDGED)] for what, found in counts.items()
    ]
    return Section(
        "Plants whose missing effect is known",
        f"The gap workflow on {len(rows)} recordings of six simulated plants, under drives of "
        "several kinds, with noise in force, a coloured sensor in half of them, and constants a "
        "few percent off.",
        paragraphs(
            table(head, lines),
            _JUDGEMENTS,
            table(
                ["plant, drive, what is hidden, sensor", "judged", "named", "strongest alone"],
                [_line(row) for row in rows if row["judged"] not in ("right", "none")],
            ),
        ),
        ("python -m benchmarks.known_plants --json docs/records/known-plants.json",),
    )


_JUDGEMENTS = (
    "*Right* names what is hidden and nothing else, *class* leaves it among rivals, *partly* names "
    "something else beside it. Where nothing is hidden, *none* is right. Answers that are neither "
    "right nor none:"
)


def _line(row: Row) -> list[str]:
    rivals = [name for name in row["class"] if name not in row["named"]]
    told = ", ".join(row["named"]) + f" (or {', '.join(rivals)})" * bool(rivals)
    first = row["leading"][0] if row["leading"] else None
    gain = f"{first['name']}, {first['gain_nats']:.0f} nats: {first['judged']}" if first else "–"
    return [row["case"], row["judged"], told or "–", gain]
