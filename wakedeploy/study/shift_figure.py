"""The figure and the table of study 6.

In: how all flew at each spread of the physics. Out: a line per model over the spreads, and where
each stands in the nominal physics.
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


def lines_over_spreads(nominal: Shifted, told: Sequence[Shifted]) -> "Figure":
    """Tracking error over the spread of the physics, limits as broken lines.

    On the left, unconnected since trained on other flights, the nominal physics.
    """
    with figures.style():
        drawn, axes = figures.figure(size=(6.4, 3.6))
        at = [f"±{100 * one.spread:.0f} %" for one in told]
        for number, line in enumerate(told[0].lines):
            errors = [1e3 * one.lines[number].mean_m for one in told]
            limit = number < len(LIMITS)
            colour = (figures.MEASURED, figures.TRUE, figures.SOURCE)[number] if limit else None
            plain = line.name == MEMORYLESS
            (drawn_line,) = axes.plot(
                range(1, 1 + len(at)),
                errors,
                "--" if limit else "-",
                marker=None if limit else _MARKS[number % len(_MARKS)],
                color=figures.LIMIT if plain else colour,
                label=line.name,
                markersize=4,
            )
            axes.plot(
                [0],
                [1e3 * nominal.lines[number].mean_m],
                marker="_" if limit else _MARKS[number % len(_MARKS)],
                color=drawn_line.get_color(),
                markersize=10 if limit else 4,
            )
        axes.set_xticks(range(1 + len(at)), ["nominal", *at])
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("wake speed, diffusivity and separation vary by")
        axes.set_ylabel("tracking error, RMS [mm]")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return drawn


def summary(nominal: Shifted, told: Sequence[Shifted]) -> tuple[list[str], list[list[str]]]:
    """Millimetres and rank of each model at each spread; the last row says how orders agree."""
    columns = ["predictor", "nominal [mm]", *(f"±{100 * one.spread:.0f} % [mm]" for one in told)]
    rows = []
    for number, line in enumerate(told[0].lines):
        cells = [line.name]
        for one in (nominal, *told):
            value = one.lines[number].mean_m
            rank = 1 + sum(other.mean_m < value for other in one.models)
            cells.append(f"{1e3 * value:.2f}" + (f" ({rank})" if number >= len(LIMITS) else ""))
        rows.append(cells)
    orders = [f"{agreement(told[0], one):.2f}" for one in (nominal, *told)]
    rows.append([f"Kendall's τ with ±{100 * told[0].spread:.0f} %", *orders])
    return columns, rows


def parts(nominal: Shifted, told: Sequence[Shifted], chosen: str | None = None) -> list[Part]:
    """The study's one figure and table."""
    rows = [
        (one.spread, line.name, seed, flight, float(value))
        for one in (nominal, *told)
        for line in one.lines
        for seed, flown in enumerate(line.rms_m)
        for flight, value in enumerate(flown)
    ]
    drawn, table = lines_over_spreads(nominal, told), summary(nominal, told)
    return [Part("shift", sentence(nominal, told, chosen), COLUMNS, rows, drawn, table)]
