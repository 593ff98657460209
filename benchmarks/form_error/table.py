"""The dose curve: answers against the misfit of the steady force.

In: judged rows. Out: a table by dose, with Wilson's intervals.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.hidden_effects.table import wilson

Row = Mapping[str, Any]


def curve(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """One line per dose."""
    return [_line(dose, [r for r in rows if r["dose"] == dose]) for dose in _doses(rows)]


def _doses(rows: Sequence[Row]) -> list[float]:
    return sorted({r["dose"] for r in rows})


def _line(dose: float, rows: Sequence[Row]) -> dict[str, Any]:
    plain = [r for r in rows if not r["hidden"]]
    hidden = [r for r in rows if r["matters"]]
    little = [r for r in rows if r["hidden"] and not r["matters"]]
    return {
        "dose": dose,
        "misfit_mn": 1e3 * max((r["misfit_n"] for r in rows), default=0.0),
        "false_alarms": _share(plain, "false alarm"),
        "right": _share(hidden, "right"),
        "useless": _share(hidden, "useless"),
        "too_small": _share(little, "right"),
        "added_worse": sum(bool(r["added_worse"]) for r in rows),
        "most_seconds": max((r["seconds"] for r in rows), default=0.0),
    }


def _share(rows: Sequence[Row], answer: str) -> dict[str, Any]:
    count = sum(r["answer"] == answer for r in rows)
    low, high = wilson(count, len(rows)) if rows else (0.0, 1.0)
    return {"count": count, "of": len(rows), "low": low, "high": high}


def curve_text(lines: Sequence[Mapping[str, Any]]) -> str:
    """The curve as text."""
    head = f"{'misfit':>8} {'largest':>8} {'false alarms':>13} {'right':>10} {'useless':>10}"
    head += f" {'too small':>10} worse"
    return "\n".join([head, *(_text(line) for line in lines)])


def _text(line: Mapping[str, Any]) -> str:
    keys = ("false_alarms", "right", "useless", "too_small")
    shares = [f"{line[k]['count']}/{line[k]['of']}" for k in keys]
    return (
        f"{100 * line['dose']:7.1f}% {line['misfit_mn']:5.0f} mN {shares[0]:>13} {shares[1]:>10} "
        f"{shares[2]:>10} {shares[3]:>10} {line['added_worse']:5d}"
    )
