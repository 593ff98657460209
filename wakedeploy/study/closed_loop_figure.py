"""The figure and the table of study 2.

In: how each way to compensate tracked. Out: bars between no compensation and the oracle, and beside
them, magnified, how far each model is from the oracle.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.core import figures
from wakedeploy.study.closed_loop import Tracked, above, recovered, sentence
from wakedeploy.study.domains import MEMORYLESS
from wakedeploy.study.folder import Part
from wakedeploy.study.runs import choice

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = ("predictor", "training seed", "hyper", "flight", "tracking_rms_m")


def bars(lines: Sequence[Tracked]) -> "Figure":
    """Tracking error of each model, every flight a point, limits as lines; the excess beside it."""
    _, oracle, _, *models = lines
    with figures.style():
        size = (7.6, 1.1 + 0.32 * max(len(models), 1))
        drawn, (error_axes, excess_axes) = figures.figure(
            1, 2, size=size, sharey=True, width_ratios=(3, 2)
        )
        _whole(error_axes, lines)
        for place, line in enumerate(models):
            apart_m, low_m, high_m = above(line, oracle)
            colour = figures.LIMIT if line.name == MEMORYLESS else figures.PREDICTED
            reach: Any = None if np.isinf(low_m) else bar(apart_m, low_m, high_m)
            excess_axes.errorbar(1e3 * apart_m, place, xerr=reach, fmt="o", color=colour,
                                 markersize=4, elinewidth=1.0, capsize=2.0)  # fmt: skip
        excess_axes.axvline(0.0, color=figures.TRUE)
        excess_axes.set_xlabel("above the oracle's error [mm]; 90 %")
        excess_axes.grid(axis="y", visible=False)
    return drawn


def _whole(axes: "Axes", lines: Sequence[Tracked]) -> None:
    nothing, oracle, constant, *models = lines
    for place, line in enumerate(models):
        plain = line.name == MEMORYLESS
        axes.barh(
            place,
            1e3 * line.mean_m,
            color=figures.LIMIT if plain else figures.PREDICTED,
            hatch="///" if plain else None,
            edgecolor="white",
            height=0.75,
        )
        points = 1e3 * line.per_flight_m
        axes.plot(points, [place] * len(points), ".", color=figures.REFERENCE, markersize=2.5)
    limits = (
        (nothing, figures.REFERENCE, "-"),
        (oracle, figures.TRUE, "-"),
        (
            constant,
            figures.REFERENCE,
            ":",
        ),
    )
    for line, colour, style in limits:
        axes.axvline(1e3 * line.mean_m, color=colour, linestyle=style, label=line.name)
    axes.set_yticks(range(len(models)), [line.name for line in models])
    axes.invert_yaxis()
    axes.set_xlim(left=0.0)
    axes.set_xlabel("tracking error, root mean square [mm]; points: flights")
    axes.grid(axis="y", visible=False)
    figures.legend(axes)


def bar(value_m: float, low_m: float, high_m: float) -> list[list[float]]:
    """An interval as matplotlib wants it, in millimetres: how far down, how far up."""
    return [[1e3 * max(value_m - low_m, 0.0)], [1e3 * max(high_m - value_m, 0.0)]]


def summary(lines: Sequence[Tracked]) -> tuple[list[str], list[list[str]]]:
    """Error in millimetres and share of the oracle's gain, intervals over flights and seeds."""
    nothing, oracle, *_ = lines
    rows = []
    for line in lines:
        share = recovered(line, nothing, oracle)
        limit = line is nothing or line is oracle
        apart_m, low_m, high_m = above(line, oracle)
        excess = f"{1e3 * apart_m:+.2f}"
        if not np.isinf(low_m):
            excess += f" [{1e3 * low_m:+.2f}, {1e3 * high_m:+.2f}]"
        rows.append([
            line.name,
            f"{1e3 * line.mean_m:.2f}",
            "–" if line is oracle else excess,
            "–" if limit or share is None else share.text,
        ])  # fmt: skip
    columns = ["predictor", "tracking RMSE [mm]", "above the oracle's [mm], 90 %"]
    return [*columns, "of the oracle's gain, 90 %"], rows


def parts(lines: Sequence[Tracked], chosen: str | None = None) -> list[Part]:
    """The study's one figure and table."""
    text = f"{sentence(lines, chosen)}{choice({line.name for line in lines})}"
    return [Part("closed-loop", text, COLUMNS, rows(lines), bars(lines), summary(lines))]


def rows(lines: Sequence[Tracked]) -> list[tuple[Any, ...]]:
    """Every flight under `COLUMNS`."""
    return [
        (line.name, seed, line.hyper[seed] if line.hyper else "", flight, float(value))
        for line in lines
        for seed, flown in enumerate(line.rms_m)
        for flight, value in enumerate(flown)
    ]
