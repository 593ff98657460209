"""A study's pictures: how it went, what mattered, and accuracy against cost.

In: rows of trials. Out: matplotlib figures; `write_figures` makes PNG and PDF of each.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from trainers.tuning.report import BEHIND, FAILED, FINISHED, OVER_BUDGET, Row, best_of, front_of
from wakedeploy import figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ERROR = "validation error (1 = predicting the mean)"


def write_figures(
    folder: Path, title: str, rows: Sequence[Row], shares: Mapping[str, float], timed: bool
) -> list[Path]:
    """Write `history`, `importances` and, of a timed study, `pareto`, as PNG and PDF each."""
    if best_of(rows) is None:
        return []
    drawn = {"history": history(title, rows)}
    if shares:
        drawn["importances"] = importance(title, shares, rows)
    if timed:
        drawn["pareto"] = pareto(title, rows)
    paths = [folder / f"{name}.{kind}" for name in drawn for kind in ("png", "pdf")]
    for path in paths:
        figures.save(drawn[path.stem], path)
    return paths


def history(title: str, rows: Sequence[Row]) -> "Figure":
    """Each trial's error, the best so far as a line, the reference as another."""
    with figures.style():
        drawn, axes = figures.figure(size=(7.4, 3.4))
        ended = [row for row in rows if row.state == FINISHED and row.error is not None]
        numbers, errors = [r.number for r in ended], [r.error or 0.0 for r in ended]
        axes.plot(numbers, errors, "o", ms=3.5, color=figures.SUFFERER, label="a trial")
        least = [min(errors[: i + 1]) for i in range(len(errors))]
        axes.step(numbers, least, where="post", color=figures.PREDICTED, label="best so far")
        for reference in (row for row in ended if row.reference):
            axes.axhline(reference.error, ls="--", color=figures.LIMIT, label="the paper's shape")
        for state, mark in ((OVER_BUDGET, "|"), (FAILED, "x")):
            at = [row.number for row in rows if row.state == state]
            if at:
                place = axes.get_xaxis_transform()
                axes.plot(at, [0.02] * len(at), mark, color=figures.REFERENCE, ms=5,
                          transform=place, label=state)  # fmt: skip
        if min(errors) > 0:
            axes.set_yscale("log")
            for numbers_on in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
                numbers_on(lambda value, _: f"{value:g}")
        axes.set(xlabel="trial", ylabel=_ERROR, title=title)
        _legend(axes)
    return drawn


def importance(title: str, shares: Mapping[str, float], rows: Sequence[Row]) -> "Figure":
    """One bar for each dimension, the most decisive above."""
    with figures.style():
        names = list(shares)
        drawn, axes = figures.figure(size=(6.4, 0.8 + 0.32 * len(names)))
        axes.barh(names[::-1], [shares[name] for name in names][::-1], color=figures.MEASURED)
        ended = [row for row in rows if row.state in (FINISHED, BEHIND)]
        aim = (
            "coming to the front" if any(row.step_us is not None for row in ended) else "the error"
        )
        over = f"PED-ANOVA over {len(ended)} trials"
        axes.set(xlabel=f"importance for {aim} ({over})", title=title)
        axes.set_xlim(left=0)
    return drawn


def pareto(title: str, rows: Sequence[Row]) -> "Figure":
    """Error against the step's p99; the front is joined, and its trials bear their numbers."""
    with figures.style():
        drawn, axes = figures.figure(size=(7.4, 4.2))
        ended = [row for row in rows if row.state == FINISHED]
        axes.scatter(
            [r.step_us or 0.0 for r in ended], [r.error or 0.0 for r in ended],
            s=14, color=figures.SUFFERER, label="a trial",
        )  # fmt: skip
        front = front_of(rows)
        cost, error = [r.step_us or 0.0 for r in front], [r.error or 0.0 for r in front]
        axes.plot(cost, error, "o-", ms=5, color=figures.PREDICTED, label="none is better in both")
        for row in front:
            axes.annotate(
                f"{row.number}", (row.step_us or 0.0, row.error or 0.0), xytext=(4, 4),
                textcoords="offset points", fontsize=8,
            )  # fmt: skip
        for row in (row for row in ended if row.reference):
            axes.plot(row.step_us, row.error, "s", ms=8, mfc="none", color=figures.REFERENCE,
                      label="the paper's shape")  # fmt: skip
        axes.set(xlabel="p99 of one step [µs]", ylabel=_ERROR, title=title)
        axes.set_xlim(left=0)
        _legend(axes)
    return drawn


def _legend(axes: "Axes") -> None:
    """Beside the axes, where it hides no trial."""
    figures.legend(axes, loc="upper left", bbox_to_anchor=(1.01, 1.0), ncols=1)
