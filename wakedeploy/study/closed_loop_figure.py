"""The figure and the table of study 2.

In: how each way to compensate tracked. Out: bars between no compensation and the oracle.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from wakedeploy import figures
from wakedeploy.study.closed_loop import Tracked, recovered, sentence
from wakedeploy.study.domains import MEMORYLESS
from wakedeploy.study.folder import Part

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = ("predictor", "training seed", "flight", "tracking_rms_m")


def bars(lines: Sequence[Tracked]) -> "Figure":
    """Tracking error of each model, every flight a point, limits as lines."""
    nothing, oracle, constant, *models = lines
    with figures.style():
        drawn, axes = figures.figure(size=(5.4, 0.9 + 0.32 * max(len(models), 1)))
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
        limits = (nothing, figures.MEASURED), (oracle, figures.TRUE), (constant, figures.SOURCE)
        for line, colour in limits:
            axes.axvline(1e3 * line.mean_m, color=colour, label=line.name)
        axes.set_yticks(range(len(models)), [line.name for line in models])
        axes.invert_yaxis()
        axes.set_xlim(left=0.0)
        axes.set_xlabel("tracking error, root mean square [mm]; points: flights")
        axes.grid(axis="y", visible=False)
        figures.legend(axes)
    return drawn


def summary(lines: Sequence[Tracked]) -> tuple[list[str], list[list[str]]]:
    """Error in millimetres and share of the oracle's gain, with intervals over the flights."""
    nothing, oracle, *_ = lines
    rows = []
    for line in lines:
        share = recovered(line, nothing, oracle)
        told = f"{100 * share.share:.0f} % [{100 * share.low:.0f}, {100 * share.high:.0f}]"
        limit = line is nothing or line is oracle
        rows.append([line.name, f"{1e3 * line.mean_m:.2f}", "–" if limit else told])
    return ["predictor", "tracking RMSE [mm]", "of the oracle's gain, 90 %"], rows


def parts(lines: Sequence[Tracked], chosen: str | None = None) -> list[Part]:
    """The study's one figure and table."""
    rows = [
        (line.name, seed, flight, float(value))
        for line in lines
        for seed, flown in enumerate(line.rms_m)
        for flight, value in enumerate(flown)
    ]
    told = sentence(lines, chosen)
    return [Part("closed-loop", told, COLUMNS, rows, bars(lines), summary(lines))]
