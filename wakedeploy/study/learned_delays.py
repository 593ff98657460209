"""Points of learned delays in a figure; some may have run far out of the window.

In: axes whose limits are set. Out: points with error bars; those beyond sit at the edge.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MARGIN = 0.03  # of the axes' height: a marker there is still whole


def points(
    axes: "Axes",
    across: Sequence[float],
    delay_s: Sequence[float],
    spread_s: Sequence[float],
    *,
    rotation: float = 0.0,
    **look: Any,
) -> None:
    """Delays (n,) with their spreads (n,); those beyond the axes are written beside their markers.

    `rotation` is that of these words in degrees, where neighbours would run into each other.
    """
    from matplotlib.patheffects import withStroke

    bottom_s, top_s = axes.get_ylim()
    margin_s = _MARGIN * (top_s - bottom_s)
    low_s, high_s = bottom_s + margin_s, top_s - margin_s
    shown = [min(max(value, low_s), high_s) for value in delay_s]
    inside = [low_s <= value <= high_s for value in delay_s]
    bars = [spread if drawn else 0.0 for spread, drawn in zip(spread_s, inside, strict=True)]
    axes.errorbar(across, shown, yerr=bars, elinewidth=0.8, **look)
    beyond: dict[tuple[float, float], list[str]] = {}
    for place, value, at, drawn in zip(across, delay_s, shown, inside, strict=True):
        if not drawn:
            beyond.setdefault((place, at), []).append(f"{value:.2f} s")
    for (place, at), words in beyond.items():  # markers at one place: a line each, towards inside
        axes.annotate(
            "\n".join(words),
            (place, at),
            (0, 5 if at == low_s else -5),
            textcoords="offset points",
            fontsize=6.5,
            ha="center",
            va="bottom" if at == low_s else "top",
            linespacing=1.0,
            rotation=rotation,
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
            zorder=5,
        )
    axes.set_ylim(bottom_s, top_s)
