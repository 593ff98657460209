"""What is left of commands that were killed, interrupted, out of disk, or started twice at once."""

from collections.abc import Mapping
from typing import Any

from benchmarks.results.section import Records, Section, paragraphs, table

Row = Mapping[str, Any]

_KINDS = {
    "kills": "`kill -9`",
    "requests": "Ctrl-C, SIGTERM",
    "disks": "full disk",
    "twice": "two at once",
}

RECORD = "interruptions.json"


def interrupted(records: Records) -> Section:
    """How often each command came out right, by how it was disturbed."""
    result = records.json(RECORD)
    by_command: dict[str, dict[str, Row]] = {}
    for kind in _KINDS:
        for row in result[kind]:
            by_command.setdefault(row["command"], {})[kind] = row
    lines = [
        [name, *(_right(rows.get(kind)) for kind in _KINDS), _children(rows)]
        for name, rows in by_command.items()
    ]
    return Section(
        "Killed and interrupted",
        "Commands disturbed at moments drawn by seed; half of the signals came at the n-th time "
        "that a command opened, renamed or removed a file. Given again, each has to come to what "
        "an undisturbed one comes to.",
        paragraphs(
            table(["command", *_KINDS.values(), "last process gone after"], lines),
            _all(result),
            result.get("run", ""),
        ),
        ("python -m benchmarks.interruptions --kills 200 --json docs/records/interruptions.json",),
    )


def _right(row: Row | None) -> str:
    return "–" if row is None or not row["strokes"] else f"{_rights(row)} of {row['strokes']}"


def _rights(row: Row) -> int:
    return max(0, int(row["strokes"]) - len(row["found"]))


def _children(rows: Mapping[str, Row]) -> str:
    return f"{max(row['longest_children_s'] for row in rows.values()):.1f} s"


def _all(result: Mapping[str, Any]) -> str:
    rows = [row for kind in _KINDS for row in result[kind]]
    right, tried = sum(map(_rights, rows)), sum(int(row["strokes"]) for row in rows)
    return (
        f"{right} of {tried} came out right: every file that was there was whole, no process was "
        "left, the answer was one sentence, and the same command ended well."
    )
