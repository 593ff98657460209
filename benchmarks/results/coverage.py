"""How often the intervals of single effects held the truth."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.hidden_effects.table import wilson
from benchmarks.results.section import Records, Section, paragraphs, percent, table

Row = Mapping[str, Any]

RECORD = "coverage.json"


def held(records: Records) -> Section:
    """Coverage by effect, and by plant."""
    record = records.json(RECORD)
    rows = record["rows"]
    common = [row for row in rows if row["effect"] in record["common"]]
    lines = [_line("the ten commonest together", common)]
    lines += [_line(name, _of(rows, name)) for name in (*record["common"], *record["hard"])]
    each = len(_of(rows, record["common"][0]))
    return Section(
        "Coverage of single effects",
        f"{each} cases of each effect in the two plants of the benchmark, at random strengths and "
        "signs. Each is fitted as the workflow fits it, from the rig file; each of its parameters "
        "counts. A 90 % interval should hold the truth in nine cases of ten. The last effects "
        f"({', '.join(record['hard'])}) are the hardest to size. "
        "Brackets: Wilson's 95 % intervals.",
        paragraphs(
            table(["effect", "held the truth", "", "first plant", "second plant"], lines),
            _missed(rows),
        ),
        ("python -m benchmarks.hidden_effects.coverage --out build/coverage --record",),
    )


def _line(name: str, rows: Sequence[Row]) -> list[str]:
    return [name, *_share(rows), *(_share(_in(rows, p))[1] for p in ("first", "second"))]


def _share(rows: Sequence[Row]) -> tuple[str, str]:
    flags = [p["held"] for row in rows for p in row["parameters"].values()]
    low, high = wilson(sum(flags), len(flags))
    share = f"{percent(sum(flags) / len(flags), 0)} [{100 * low:.0f}, {100 * high:.0f}]"
    return share, f"{sum(flags)} of {len(flags)}"


def _missed(rows: Sequence[Row]) -> str:
    """What was missed, each with its interval."""
    missed = [
        f"- {row['effect']} ({row['plant']} plant), {name}: {p['value']:.3g} "
        f"[{p['low']:.3g}, {p['high']:.3g}] {p['unit']}, truth {p['truth']:.3g}"
        for row in rows
        for name, p in row["parameters"].items()
        if not p["held"]
    ]
    return "\n".join(["Missed:", "", *missed]) if missed else ""


def _of(rows: Sequence[Row], effect: str) -> list[Row]:
    return [row for row in rows if row["effect"] == effect]


def _in(rows: Sequence[Row], plant: str) -> list[Row]:
    return [row for row in rows if row["plant"] == plant]
