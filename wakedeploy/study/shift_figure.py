"""The figure and the table of study 6.

In: how all flew at each spread of the physics. Out: a line per model over the spreads.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from wakedeploy import figures
from wakedeploy.study.closed_loop import LIMITS
from wakedeploy.study.domains import MEMORYLESS
from wakedeploy.study.folder import Part
from wakedeploy.study.shift import Shifted, agreement, sentence

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = ("spread", "predictor", "training seed", "flight", "tracking_rms_m")
_MARKS = "osv^D<>p"


def lines_over_spreads(told: Sequence[Shifted]) -> "Figure":
    """Tracking error over the spread of the physics, limits as broken lines."""
    with figures.style():
        drawn, axes = figures.figure(size=(6.4, 3.6))
        at = [f"±{100 * one.spread:.0f} %" for one in told]
        for number, line in enumerate(told[0].lines):
            errors = [1e3 * one.lines[number].mean_m for one in told]
            limit = number < len(LIMITS)
            colour = (figures.MEASURED, figures.TRUE, figures.SOURCE)[number] if limit else None
            plain = line.name == MEMORYLESS
            axes.plot(
                at,
                errors,
                "--" if limit else "-",
                marker=None if limit else _MARKS[number % len(_MARKS)],
                color=figures.LIMIT if plain else colour,
                label=line.name,
                markersize=4,
            )
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("wake speed, diffusivity and separation vary by")
        axes.set_ylabel("tracking error, RMS [mm]")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return drawn


def summary(told: Sequence[Shifted]) -> tuple[list[str], list[list[str]]]:
    """Millimetres and rank of each model at each spread; the last row says how orders agree."""
    columns = ["predictor", *(f"±{100 * one.spread:.0f} % [mm]" for one in told)]
    rows = []
    for number, line in enumerate(told[0].lines):
        cells = [line.name]
        for one in told:
            value = one.lines[number].mean_m
            rank = 1 + sum(other.mean_m < value for other in one.models)
            cells.append(f"{1e3 * value:.2f}" + (f" ({rank})" if number >= len(LIMITS) else ""))
        rows.append(cells)
    rows.append(["Kendall's τ with the first", *(f"{agreement(told[0], one):.2f}" for one in told)])
    return columns, rows


def parts(told: Sequence[Shifted], chosen: str | None = None) -> list[Part]:
    """The study's one figure and table."""
    rows = [
        (one.spread, line.name, seed, flight, float(value))
        for one in told
        for line in one.lines
        for seed, flown in enumerate(line.rms_m)
        for flight, value in enumerate(flown)
    ]
    drawn = lines_over_spreads(told)
    return [Part("shift", sentence(told, chosen), COLUMNS, rows, drawn, summary(told))]
