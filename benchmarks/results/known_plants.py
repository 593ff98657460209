"""Results of the gap workflow on small plants of which it is known what the model lacks."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.results.section import Records, Section, paragraphs, table

RECORD = "known-plants.json"
Row = Mapping[str, Any]
_JUDGED = ("right", "class", "partly", "wrong", "unknown", "none")


def counted(records: Records) -> Section:
    """How often the answer is right, and every one that is not."""
    rows: Sequence[Row] = records.json(RECORD)["rows"]
    head = ["", *_JUDGED]
    hidden = [row for row in rows if not _is_empty(row)]
    lines = [_counts("an effect hidden", [r for r in hidden if not _is_outside(r)])]
    lines.append(_counts("a law hidden that no effect has", [r for r in hidden if _is_outside(r)]))
    lines.append(_counts("nothing hidden", [r for r in rows if _is_empty(r)]))
    return Section(
        "Plants whose missing effect is known",
        f"The gap workflow on {len(rows)} recordings of simulated plants, with noise in force and "
        "constants a few percent off. Six plants are small and driven in several ways, half of "
        "them seen by a coloured sensor. Seven have more sensors, and a controller of their own: a "
        "pole on a cart, a ship, a car, a copter's roll, an oven, a diver and an arm.",
        paragraphs(
            table(head, lines),
            "Of these, under a controller of their own:",
            table(head, _of_controlled(rows)),
            _JUDGEMENTS,
            table(
                ["plant, drive, what is hidden, sensor", "judged", "named", "strongest alone"],
                [_line(row) for row in rows if _judged(row) != "right" and not _is_empty(row)],
            ),
        ),
        ("python -m benchmarks.known_plants --json docs/records/known-plants.json",),
    )


_JUDGEMENTS = (
    "*Right* names what is hidden and nothing else, *class* leaves it among at most three rivals, "
    "*partly* names something else beside it, or a class of others. Where nothing is hidden, "
    "*none* is right; where a law is that no effect has (a magnet beside the rail, a shaft that "
    "shakes, a plate that shines), *unknown*. A servo "
    "that is linear does not tell a lag of its sensor from one of its command: the first counts "
    "as wrong here where the second is named. All answers with an effect hidden that are not right:"
)


def _of_controlled(rows: Sequence[Row]) -> list[list[str]]:
    mine = [row for row in rows if ", controlled, " in row["case"]]
    hidden = [row for row in mine if not _is_empty(row) and not _is_outside(row)]
    nothing = [row for row in mine if _is_empty(row)]
    return [_counts("an effect hidden", hidden), _counts("nothing hidden", nothing)]


def _is_empty(row: Row) -> bool:
    """Whether nothing was hidden."""
    return ", nothing, " in row["case"]


def _is_outside(row: Row) -> bool:
    """Whether no effect of the library is what was hidden."""
    return any(f", {law}, " in row["case"] for law in ("magnet", "shaking", "radiation"))


def _judged(row: Row) -> str:
    """A class of more than three is an answer of "unknown"."""
    is_right = row["judged"] == "right"
    return "unknown" if row["verdict"] == "unknown" and not is_right else str(row["judged"])


def _counts(what: str, rows: Sequence[Row]) -> list[str]:
    found = [_judged(row) for row in rows]
    return [what, *(str(found.count(judged)) for judged in _JUDGED)]


def _line(row: Row) -> list[str]:
    rivals = [name for name in row["class"] if name not in row["named"]]
    names = ", ".join(row["named"]) + f" (or {', '.join(rivals)})" * bool(rivals)
    first = row["leading"][0] if row["leading"] else None
    gain = f"{first['name']}, {first['gain_nats']:.0f} nats: {first['judged']}" if first else "–"
    return [row["case"], _judged(row), names or "–", gain]
