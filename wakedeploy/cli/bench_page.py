"""What `bench latency` measured as a page: whether each package is in time, and by how much.

In: rows and the budget. Out: one HTML file.
"""

import math
import platform
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.core import pages
from wakedeploy.core.files import write_text_whole

if TYPE_CHECKING:
    from runtime.bench import BenchRow

_WIDTH, _LEFT, _RIGHT, _ROW = 720, 150, 705, 26
_MARKS = (("p50_ms", "median"), ("p99_ms", "p99"), ("p999_ms", "p99.9"), ("max_ms", "longest"))


def write_bench_page(
    path: Path, rows: "Sequence[BenchRow]", budget_ms: float, files: Sequence[Path]
) -> None:
    """Write the page; `files` are the packages as they were asked for, none for the eight.

    Raises UnusableInput where it cannot be written.
    """
    parts = {
        "title": "Is it fast enough?",
        "subtitle": _subtitle(rows),
        "answers": _answers(rows, budget_ms),
        "tile_pairs": _tiles(rows, budget_ms),
        "why": _why(rows, budget_ms),
        "next": _commands(rows, budget_ms, files),
        "bars": _Bars(rows, budget_ms),
        "totals": _totals(rows, budget_ms),
        "stages": _stages(rows),
    }
    write_text_whole(path, pages.page("wakedeploy.cli", "bench.html", **parts))


def _worst(row: "BenchRow") -> float:
    """What is judged [ms]."""
    return row.max_ms if row.is_preliminary else row.p999_ms


def _subtitle(rows: "Sequence[BenchRow]") -> str:
    priority = "with" if all(row.realtime for row in rows) else "without"
    return (
        f"Measured on {platform.machine()}, Python {platform.python_version()}, {priority} "
        f"real-time priority, {rows[0].ticks:,} ticks each at 32 Hz; the virtual gantry is at the "
        "other end."
    )


def _answers(rows: "Sequence[BenchRow]", budget_ms: float) -> list[str]:
    """The verdict, what it means, and how far to trust it."""
    missed = [row for row in rows if not row.within(budget_ms)]
    slowest = max(rows, key=_worst)
    measure = "its longest tick" if slowest.is_preliminary else "999 of 1,000 ticks"
    took = f"{slowest.arch}, the slowest, took {_worst(slowest):.2f} ms ({measure})"
    if missed:
        names = ", ".join(row.arch for row in missed)
        sentences = [
            f"No: {names} took longer than the {budget_ms:.2f} ms that there are.",
            f"{took}.",
        ]
    else:
        share = 100.0 * _worst(slowest) / budget_ms
        sentences = [f"Yes: {took}, {share:.0f} % of the {budget_ms:.2f} ms that there are."]
    sentences.append(
        "A tick begins with the measurement and ends when the command has been written."
    )
    if any(row.is_preliminary for row in rows):
        sentences.append("That is preliminary: for a p99.9 there have to be 3,000 ticks and more.")
    return sentences


def _tiles(rows: "Sequence[BenchRow]", budget_ms: float) -> list[tuple[str, str]]:
    slowest = max(rows, key=_worst)
    return [
        ("budget of a tick", f"{budget_ms:.2f} ms"),
        (f"slowest: {slowest.arch}", f"{_worst(slowest):.2f} ms"),
        ("ticks too late for their time", str(sum(row.overruns for row in rows))),
        ("largest memory in flight", f"{max(row.rss_mb for row in rows):.0f} MB"),
    ]


def _why(rows: "Sequence[BenchRow]", budget_ms: float) -> str:
    if any(not row.within(budget_ms) for row in rows):
        return (
            "What to do next: see what disturbs this computer, end what else runs, measure again."
        )
    if any(row.is_preliminary for row in rows):
        return "What to do next: measure long enough for a verdict."
    return "What to do next: measure with the other cores at work, then fly."


def _commands(rows: "Sequence[BenchRow]", budget_ms: float, files: Sequence[Path]) -> list[str]:
    names = " ".join(shlex.quote(str(path)) for path in files)
    measure = f"wakedeploy bench latency {names}".rstrip()
    if any(not row.within(budget_ms) for row in rows):
        return ["wakedeploy doctor", measure]
    if any(row.is_preliminary for row in rows):
        return [measure]
    fly = f"wakedeploy run-gantry --package {shlex.quote(str(files[0]))} --virtual" if files else ""
    return [f"{measure} --busy", *([fly] if fly else [])]


@dataclass(frozen=True)
class _Bars:
    """A row for each package: from its median to its longest tick, over a logarithmic axis."""

    rows: "Sequence[BenchRow]"
    budget_ms: float

    width, x_left, x_right = _WIDTH, _LEFT, _RIGHT

    @property
    def height(self) -> int:
        return _ROW * (len(self.rows) + 2)

    @property
    def _range(self) -> tuple[float, float]:
        low = min(row.p50_ms for row in self.rows)
        return 0.8 * low, 1.25 * max(self.budget_ms, *(row.max_ms for row in self.rows))

    def at(self, value_ms: float) -> float:
        """Where a time lies across."""
        low, high = self._range
        share = math.log(max(value_ms, low) / low) / math.log(high / low)
        return round(self.x_left + share * (self.x_right - self.x_left), 1)

    @property
    def ticks(self) -> list[tuple[float, str]]:
        low, high = self._range
        times = [m * 10.0**d for d in range(-3, 5) for m in (1, 2, 5)]
        return [(self.at(t), f"{t:g}") for t in times if low <= t <= high]

    @property
    def shown(self) -> list[dict[str, Any]]:
        """Name, height, ends and marks of each row."""
        return [
            {
                "name": row.arch,
                "y": _ROW * (number + 1),
                "from": self.at(row.p50_ms),
                "to": self.at(row.max_ms),
                "marks": [
                    (self.at(getattr(row, key)), f"{row.arch}, {word}: {getattr(row, key):.2f} ms")
                    for key, word in _MARKS
                    if not (row.is_preliminary and key == "p999_ms")
                ],
            }
            for number, row in enumerate(self.rows)
        ]


def _totals(rows: "Sequence[BenchRow]", budget_ms: float) -> pages.Table:
    columns = ["", "in time", "median ms", "p99 ms", "p99.9 ms", "longest ms", "CPU %"]
    columns += ["MB", "first call ms", "overruns"]
    cells = [
        [
            row.arch,
            "yes" if row.within(budget_ms) else "no",
            f"{row.p50_ms:.2f}",
            f"{row.p99_ms:.2f}",
            "–" if row.is_preliminary else f"{row.p999_ms:.2f}",
            f"{row.max_ms:.2f}",
            f"{row.cpu_percent:.1f}",
            f"{row.rss_mb:.0f}",
            f"{row.first_call_ms:.1f}",
            str(row.overruns),
        ]
        for row in rows
    ]
    return pages.Table(columns, cells)


def _stages(rows: "Sequence[BenchRow]") -> pages.Table:
    cells = [
        [
            row.arch,
            stage.removeprefix("t_").removesuffix("_s"),
            f"{spread['p50']:.3f}",
            f"{spread['p99']:.3f}",
            f"{spread['max']:.3f}",
        ]
        for row in rows
        for stage, spread in row.stages_ms.items()
    ]
    return pages.Table(["", "stage", "median ms", "p99 ms", "longest ms"], cells)
