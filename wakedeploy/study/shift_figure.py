"""The figure and the table of study 6.

In: how all flew at each spread of the physics. Out: a line per model over the spreads, and where
each stands in the nominal physics.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wakedeploy.core import figures
from wakedeploy.study.closed_loop import LIMITS, above
from wakedeploy.study.closed_loop_figure import bar
from wakedeploy.study.closed_loop_figure import rows as flown
from wakedeploy.study.colours import looks
from wakedeploy.study.domains import MEMORYLESS
from wakedeploy.study.folder import Part
from wakedeploy.study.runs import choice
from wakedeploy.study.shift import Shifted, agreement, sentence

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = ("spread", "predictor", "training seed", "hyper", "flight", "tracking_rms_m")
_LINEAR_MM = 0.1  # below it, the axis of the excess is linear
_WIDTH = 0.6  # over which the models stand side by side at each spread


def lines_over_spreads(nominal: Shifted, spreads: Sequence[Shifted]) -> "Figure":
    """Tracking error over the spread of the physics, and how far it is above the oracle's.

    On the left of each, trained on other flights, the nominal physics.
    """
    every = [nominal, *spreads]
    with figures.style():
        drawn, (error_axes, excess_axes) = figures.figure(1, 2, size=(8.6, 3.6))
        _limits(error_axes, every)
        styles = looks([line.name for line in spreads[0].models])
        offsets = np.linspace(-0.5, 0.5, max(len(styles), 2)) * _WIDTH
        for number, ((name, (colour, marker)), offset) in enumerate(
            zip(styles.items(), offsets, strict=False)
        ):
            models = [at_spread.models[number] for at_spread in every]
            look = {"color": colour, "marker": marker, "markersize": 4}
            label = f"{name} (no memory)" if name == MEMORYLESS else name
            errors_mm = [1e3 * line.mean_m for line in models]
            at = np.arange(len(models)) + offset
            error_axes.plot(at, errors_mm, linestyle="none", **look, label=label)
            for place, (at_spread, line) in enumerate(zip(every, models, strict=True)):
                apart_m, low_m, high_m = above(line, at_spread.lines[1])
                reach = None if np.isinf(low_m) else bar(apart_m, low_m, high_m)
                excess_axes.errorbar(at[place], 1e3 * apart_m, yerr=reach, elinewidth=0.9, **look)
        excess_axes.axhline(0.0, color=figures.TRUE, linestyle="--")
        excess_axes.set_yscale("symlog", linthresh=_LINEAR_MM)
        excess_axes.set_ylabel("above the oracle's error [mm]; bars: 90 %")
        error_axes.set_ylabel("tracking error, RMS [mm]")
        error_axes.set_ylim(bottom=0.0)
        for axes in (error_axes, excess_axes):
            axes.set_xticks(
                range(len(every)), ["nominal", *(at_spread.text for at_spread in spreads)]
            )
            axes.grid(axis="x", visible=False)
            axes.set_xlabel("wake speed, diffusivity and separation vary by")
        drawn.legend(*error_axes.get_legend_handles_labels(), loc="outside right center")
    return drawn


def _limits(axes: "Axes", every: Sequence[Shifted]) -> None:
    """A short line for each limit at each spread."""
    styles = ((figures.REFERENCE, "-"), (figures.TRUE, "-"), (figures.REFERENCE, ":"))
    for number, (colour, style) in zip(range(len(LIMITS)), styles, strict=True):
        errors_mm = [1e3 * at_spread.lines[number].mean_m for at_spread in every]
        places = np.arange(len(every))
        axes.hlines(errors_mm, places - 0.45, places + 0.45, color=colour, linestyle=style,
                    label=LIMITS[number])  # fmt: skip


def summary(nominal: Shifted, spreads: Sequence[Shifted]) -> tuple[list[str], list[list[str]]]:
    """Millimetres and rank of each model at each spread; the last row says how orders agree."""
    columns = [
        "predictor",
        "nominal [mm]",
        *(f"{at_spread.text} [mm]" for at_spread in spreads),
    ]
    rows = []
    for number, line in enumerate(spreads[0].lines):
        cells = [line.name]
        for at_spread in (nominal, *spreads):
            value = at_spread.lines[number].mean_m
            rank = 1 + sum(other.mean_m < value for other in at_spread.models)
            cells.append(f"{1e3 * value:.2f}" + (f" ({rank})" if number >= len(LIMITS) else ""))
        rows.append(cells)
    orders = [agreement(spreads[0], at_spread).text for at_spread in (nominal, *spreads)]
    rows.append([f"Kendall's τ with {spreads[0].text} [90 %]", *orders])
    return columns, rows


def parts(nominal: Shifted, spreads: Sequence[Shifted], chosen: str | None = None) -> list[Part]:
    """The study's one figure and table."""
    rows = [
        (at_spread.spread, *row)
        for at_spread in (nominal, *spreads)
        for row in flown(at_spread.lines)
    ]
    drawn, table = lines_over_spreads(nominal, spreads), summary(nominal, spreads)
    said = f"{sentence(nominal, spreads, chosen)}{choice({line.name for line in nominal.lines})}"
    return [Part("shift", said, COLUMNS, rows, drawn, table)]
