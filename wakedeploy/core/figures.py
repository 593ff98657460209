"""The one style of the project's figures, and how a figure becomes a file.

matplotlib is imported inside the functions and draws without a screen. In: nothing, a path. Out:
styled figures, PNG files.
"""

import io
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.core.errors import UnusableInput, relief, why
from wakedeploy.core.files import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours by meaning (Okabe and Ito 2008: they stay apart for colour-blind readers and in print).
MEASURED = "#0072B2"
REFERENCE = "#222222"
PREDICTED = "#D55E00"
TRUE = "#009E73"
SOURCE = "#CC79A7"
SUFFERER = "#56B4E9"
LIMIT = "#999999"
FAULT = "#B22222"
MODE_SHADES = {
    "DISARMED": "#d9d9d9",
    "ARMED": "#efefef",
    "RUNNING": "#ffffff",
    "DEGRADED": "#ffe9c6",
    "LANDING": "#e8eef5",
    "FAILSAFE": "#f9c9c0",
}

_STYLE: Any = {  # a dictionary of matplotlib's rcParams
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#666666",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "figure.facecolor": "white",
    "figure.constrained_layout.use": True,
    "savefig.dpi": 130,
}


def style() -> AbstractContextManager[None]:
    """The style: everything about a figure, drawing and saving included, happens inside it."""
    import matplotlib as mpl

    return mpl.rc_context(_STYLE)


def figure(
    rows: int = 1, columns: int = 1, *, size: tuple[float, float], **grid: Any
) -> "tuple[Figure, Any]":
    """A figure of `size` inches with its axes, as `plt.subplots` gives them, without a screen."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=size)
    return drawn, drawn.subplots(rows, columns, **grid)


def save(drawn: "Figure", path: Path) -> None:
    """Write the figure as PNG, or as what else the path's suffix says, whole or not at all.

    Raises UnusableInput when that is not possible.
    """
    kind = path.suffix.removeprefix(".") or "png"
    try:
        with style():
            write_whole(path, lambda temporary: drawn.savefig(temporary, format=kind))
    except OSError as error:
        raise UnusableInput(
            f"{path}: the picture cannot be written ({why(error)}){relief(error)}."
        ) from error


def legend(axes: "Axes", **options: Any) -> None:
    """A legend above the axes to the right, where it hides no data."""
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncols": 6}
    axes.legend(**(place | {"borderaxespad": 0.2, "handlelength": 1.6} | options))


def legend_above(drawn: "Figure", grid: Any, columns: int) -> None:
    """One legend above all axes of a grid; what several of them show stands there once.

    It has as many columns as there is room for, and `columns` at most.
    """
    handles = {
        label: handle
        for axes in grid.flat
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    for across in range(columns, 0, -1):
        made = drawn.legend(
            list(handles.values()), list(handles), loc="outside upper center", ncols=across
        )
        if across == 1 or made.get_window_extent().width <= drawn.bbox.width:
            return
        made.remove()


def plain_log(axes: "Axes") -> None:
    """A logarithmic y axis with plain numbers (0.02, 0.5, 30), for what is drawn already."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    if high > 1e3 * low:
        axes.yaxis.set_major_locator(LogLocator())
    elif high > 8.0 * low:
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    else:
        axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")


def png_of(drawn: "Figure") -> bytes:
    """A figure as the bytes of a PNG file, in the project's style."""
    buffer = io.BytesIO()
    with style():
        drawn.savefig(buffer, format="png")
    return buffer.getvalue()


def showing_itself(drawn: "Figure") -> "Figure":
    """The figure, which a notebook now shows when it is the last value of a cell.

    matplotlib shows figures by itself only where pyplot made them.
    """
    drawn._repr_png_ = lambda: png_of(drawn)  # type: ignore[attr-defined]
    return drawn
