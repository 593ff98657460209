"""A study's pictures: how it went, what mattered, and accuracy against cost.

In: rows of trials. Out: matplotlib figures; `write_figures` makes PNG and PDF of each.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from trainers.tuning.plan import COSTS
from trainers.tuning.report import (
    BEHIND,
    FAILED,
    FINISHED,
    IMPOSSIBLE,
    LOST,
    OVER_BUDGET,
    RUNNING,
    Row,
    best_of,
    front_of,
)
from trainers.tuning.study import INTERRUPTED
from wakedeploy.core import figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ERROR = "validation error (1 = predicting the mean)"
# Of trials without any error.
_MARKS = {
    OVER_BUDGET: "|",
    IMPOSSIBLE: "_",
    FAILED: "x",
    LOST: "X",
    INTERRUPTED: "1",
    RUNNING: ">",
}


def write_figures(
    folder: Path, title: str, rows: Sequence[Row], shares: Mapping[str, float], cost: str | None
) -> list[Path]:
    """Write `history`, `importances` and, where steps have a cost, `pareto`, as PNG and PDF."""
    if best_of(rows) is None:
        return []
    drawn = {"history": history(title, rows)}
    if shares:
        drawn["importances"] = importance(title, shares, rows)
    if cost is not None:
        drawn["pareto"] = pareto(title, rows, COSTS[cost])
    paths = [folder / f"{name}.{kind}" for name in drawn for kind in ("png", "pdf")]
    for path in paths:
        figures.save(drawn[path.stem], path)
    return paths


def history(title: str, rows: Sequence[Row]) -> "Figure":
    """Every trial by what became of it, the best error so far, and the reference as a line.

    A pruned trial stands at the error after its last epoch; one without any error at the bottom.
    """
    with figures.style():
        drawn, axes = figures.figure(size=(8.2, 3.6))
        ended = [row for row in rows if row.state == FINISHED and row.error is not None]
        stopped = [row for row in rows if row.state == BEHIND and row.last_error is not None]
        _errors(axes, ended, stopped)
        _best_so_far(axes, ended, rows)
        for reference in (row for row in ended if row.reference):
            axes.axhline(reference.error, ls="--", color=figures.LIMIT, label="the paper's shape")
        without = [row for row in rows if row not in ended and row not in stopped]
        axes.margins(y=0.12 if without else 0.06)
        if all(_drawn_at(row) > 0 for row in [*ended, *stopped]):
            figures.plain_log(axes)
        _without_error(axes, without)
        _trial_axis(axes, rows)
        axes.set(xlabel="trial", ylabel=_ERROR, title=title)
        _legend(axes)
    return drawn


def _drawn_at(row: Row) -> float:
    return (row.error if row.error is not None else row.last_error) or 0.0


def _errors(axes: "Axes", ended: Sequence[Row], stopped: Sequence[Row]) -> None:
    for group, trials, face in ((ended, FINISHED, figures.SUFFERER), (stopped, BEHIND, "none")):
        if group:
            axes.plot(
                [row.number for row in group], [_drawn_at(row) for row in group], "o",
                ms=4, color=figures.SUFFERER, mfc=face, label=_counted(trials, group),
            )  # fmt: skip


def _best_so_far(axes: "Axes", ended: Sequence[Row], rows: Sequence[Row]) -> None:
    """To the last trial, which need not be a finished one."""
    errors = [_drawn_at(row) for row in ended]
    least = [min(errors[: i + 1]) for i in range(len(errors))]
    numbers = [*(row.number for row in ended), rows[-1].number]
    axes.step(
        numbers, [*least, least[-1]], where="post", color=figures.PREDICTED, label="best so far"
    )


def _without_error(axes: "Axes", rows: Sequence[Row]) -> None:
    """Marks at the bottom, one kind for each state."""
    place = axes.get_xaxis_transform()
    for state, mark in _MARKS.items():
        group = [row for row in rows if row.state == state]
        if group:
            axes.plot([row.number for row in group], [0.03] * len(group), mark, ms=5,
                      color=figures.FAULT if state in (FAILED, LOST) else figures.REFERENCE,
                      transform=place, clip_on=False, label=_counted(state, group))  # fmt: skip


def _counted(state: str, group: Sequence[Row]) -> str:
    return f"{state} ({len(group)})"


def _trial_axis(axes: "Axes", rows: Sequence[Row]) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(
        MaxNLocator("auto", integer=True, min_n_ticks=1, steps=[1, 2, 5, 10])
    )
    last = max(row.number for row in rows)
    margin = max(0.6, 0.02 * last)
    axes.set_xlim(-margin, last + margin)


def importance(title: str, shares: Mapping[str, float], rows: Sequence[Row]) -> "Figure":
    """One bar for each dimension, the most decisive above."""
    with figures.style():
        names = list(shares)
        drawn, axes = figures.figure(size=(6.4, 0.8 + 0.32 * len(names)))
        axes.barh(names[::-1], [shares[name] for name in names][::-1], color=figures.MEASURED)
        ended = [row for row in rows if row.state in (FINISHED, BEHIND)]
        aim = "coming to the front" if any(row.cost is not None for row in ended) else "the error"
        over = f"PED-ANOVA over {len(ended)} trials"
        axes.set(xlabel=f"importance for {aim} ({over})", title=title)
        axes.set_xlim(left=0)
    return drawn


def pareto(title: str, rows: Sequence[Row], cost_label: str) -> "Figure":
    """Error against what a step costs; the front is joined, and its trials bear their numbers."""
    with figures.style():
        drawn, axes = figures.figure(size=(7.4, 4.2))
        ended = [row for row in rows if row.state == FINISHED]
        axes.scatter(
            [r.cost or 0.0 for r in ended], [r.error or 0.0 for r in ended],
            s=14, color=figures.SUFFERER, label="a trial",
        )  # fmt: skip
        front = front_of(rows)
        cost, error = [r.cost or 0.0 for r in front], [r.error or 0.0 for r in front]
        axes.plot(cost, error, "o-", ms=5, color=figures.PREDICTED, label="none is better in both")
        for row in front:
            axes.annotate(
                f"{row.number}", (row.cost or 0.0, row.error or 0.0), xytext=(4, 4),
                textcoords="offset points", fontsize=8,
            )  # fmt: skip
        for row in (row for row in ended if row.reference):
            axes.plot(row.cost, row.error, "s", ms=8, mfc="none", color=figures.REFERENCE,
                      label="the paper's shape")  # fmt: skip
        axes.set(xlabel=cost_label, ylabel=_ERROR, title=title)
        axes.set_xlim(left=0)
        _legend(axes)
    return drawn


def _legend(axes: "Axes") -> None:
    """Beside the axes, where it hides no trial."""
    figures.legend(axes, loc="upper left", bbox_to_anchor=(1.01, 1.0), ncols=1)
