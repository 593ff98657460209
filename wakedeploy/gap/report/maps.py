"""Figures over coordinates: maps of the residual, and the error per place before and after.

In: maps of `find.json`, profiles of `show.json`. Out: figures; None where there is nothing to draw.
"""

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wakedeploy.core import figures
from wakedeploy.gap.search.artefacts import Map
from wakedeploy.gap.systems.gantry.artefacts import Profile
from wakedeploy.gap.wording import FloatArray, numbers, probability, scale_of, signs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIGNIFICANT = 0.05
BEFORE, AFTER = figures.LIMIT, figures.PREDICTED  # in every figure that compares the two models
_MOST_MAPS = 12
MOST_PLACES = 6  # panels of the figure before and after
_COLUMNS = 3
_WIDTH_IN = 7.5
_LONG_LABEL = 18  # characters that fit beside a panel


def strongest_maps(maps: Sequence[Map]) -> tuple[list[Map], list[Map]]:
    """At most twelve maps, exogenous and fed-back ones apart, the most significant first."""
    drawable = [m for m in maps if _bins(m) is not None]
    ordered = sorted(drawable, key=lambda m: (_q(m), -_strength(m)))
    exogenous = [m for m in ordered if m.exogenous]
    fed_back = [m for m in ordered if not m.exogenous]
    half = _MOST_MAPS // 2
    return (
        exogenous[: max(half, _MOST_MAPS - len(fed_back))],
        fed_back[: max(half, _MOST_MAPS - len(exogenous))],
    )


def draw_maps(maps: Sequence[Map]) -> "Figure | None":
    """One panel per map: the mean residual per bin with its 90 % interval."""
    if not maps:
        return None
    drawn, panels = _panels(len(maps), height_in=1.75)
    for axes, map_ in zip(panels, maps, strict=True):
        _map(axes, map_)
    return drawn


def drawable_places(places: Sequence[Profile]) -> list[Profile]:
    """Each channel over each coordinate once, those that change most first."""
    drawable = [place for place in places if _change(place) > -math.inf]
    once = {(place.channel, place.coordinate): place for place in reversed(drawable)}
    return sorted(once.values(), key=_change, reverse=True)


def draw_places(places: Sequence[Profile]) -> "Figure | None":
    """The error per bin of each coordinate, before and after; the six that change most."""
    shown = drawable_places(places)[:MOST_PLACES]
    if not shown:
        return None
    drawn, panels = _panels(len(shown), height_in=1.9)
    for axes, place in zip(panels, shown, strict=True):
        _place(axes, place)
    handles, labels = panels[0].get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside upper right", ncols=2)
    return drawn


def labelled(name: object, unit: str) -> str:
    """An axis label: `force [N]`; without brackets where there is no unit."""
    text = str(name if name is not None else "").replace("$", r"\$")
    return f"{text} [{signs(unit)}]" if unit not in ("", "1", "-") else text


def _panels(count: int, height_in: float) -> "tuple[Figure, list[Axes]]":
    columns = 2 if count == 4 else min(count, _COLUMNS)
    rows = math.ceil(count / columns)
    width = _WIDTH_IN if columns > 1 else 0.6 * _WIDTH_IN
    height_in = height_in if columns > 1 else 1.4 * height_in
    drawn, grid = figures.figure(
        rows, columns, size=(width, 0.25 + height_in * rows), squeeze=False
    )
    panels = list(grid.flat)
    for spare in panels[count:]:
        spare.remove()
    return drawn, panels[:count]


def _map(axes: "Axes", map_: Map) -> None:
    edges, mean = _bins(map_)  # type: ignore[misc]  # strongest_maps has seen to that
    low, high = (_as_long(numbers(ends), mean) for ends in (map_.low, map_.high))
    factor, unit = scale_of(np.concatenate([mean, low, high]), map_.unit)
    significant = _q(map_) <= SIGNIFICANT
    colour = figures.MEASURED if significant else figures.LIMIT
    widths = np.diff(edges)
    axes.bar(edges[:-1], factor * (high - low), widths, factor * low, align="edge", color=colour,
             alpha=0.3, linewidth=0)  # fmt: skip
    lone = _as_long(numbers(map_.blocks), mean) == 1.0
    for chosen, line in ((~lone, "-"), (lone, ":")):
        axes.hlines((factor * mean)[chosen], edges[:-1][chosen], edges[1:][chosen], color=colour,
                    linewidth=1.8, linestyle=line)  # fmt: skip
    axes.axhline(0.0, color=figures.REFERENCE, linewidth=0.7, zorder=1.5)
    weight, ink = ("bold", colour) if significant else ("normal", "#777777")
    title = probability("q", map_.q_value)
    axes.set_title(title, color=ink, fontweight=weight, fontsize=8.5)
    axes.set_xlabel(labelled(map_.coordinate, map_.coordinate_unit))
    axes.set_ylabel(_folded(labelled(_left_in(map_.channel), unit)))
    _calm(axes)


def _place(axes: "Axes", place: Profile) -> None:
    edges, before, after = (numbers(each) for each in (place.edges, place.before, place.after))
    factor, unit = scale_of(np.concatenate([before, after]), place.unit)
    for values, reaches, colour, label in (
        (before, place.before_reach, BEFORE, "before"),
        (after, place.after_reach, AFTER, "after"),
    ):
        axes.stairs(factor * values, edges, baseline=None, color=colour, linewidth=1.8, label=label)
        reach = factor * _as_long(numbers(reaches), values)
        axes.bar(edges[:-1], 2.0 * reach, np.diff(edges), factor * values - reach, align="edge",
                 color=colour, alpha=0.25, linewidth=0)  # fmt: skip
    axes.axhline(0.0, color=figures.REFERENCE, linewidth=0.7, zorder=1.5)
    axes.set_xlabel(labelled(place.coordinate, place.coordinate_unit))
    axes.set_ylabel(_folded(labelled(_left_in(place.channel), unit)))
    _calm(axes)


def _left_in(channel: str) -> str:
    """What a map's axis shows. A log's column is the signal; its map, what the model leaves of it.

    The gantry's channels are residuals by their own names, in words.
    """
    return f"residual of {channel}" if "_" in channel else channel


def _bins(map_: Map) -> tuple[FloatArray, FloatArray] | None:
    """Edges (n+1,) and means (n,) of a map; None if they do not belong together."""
    edges, mean = numbers(map_.edges), numbers(map_.mean)
    fits = len(edges) == len(mean) + 1 and bool(np.isfinite(edges).all())
    return (edges, mean) if fits and bool(np.isfinite(mean).any()) else None


def _strength(map_: Map) -> float:
    """The largest mean in units of its own half interval."""
    mean = numbers(map_.mean)
    low, high = (_as_long(numbers(ends), mean) for ends in (map_.low, map_.high))
    ratio = np.abs(mean) / np.maximum((high - low) / 2, 1e-12)
    return float(np.nanmax(ratio)) if bool(np.isfinite(ratio).any()) else 0.0


def _change(place: Profile) -> float:
    """The largest fall of the error in any bin, as a share; −inf if it cannot be drawn."""
    edges, before, after = (numbers(each) for each in (place.edges, place.before, place.after))
    if not len(edges) - 1 == len(before) == len(after) > 0 or not bool(np.isfinite(edges).all()):
        return -math.inf
    change = (np.abs(before) - np.abs(after)) / np.maximum(np.abs(before), 1e-12)
    return float(np.nanmax(change)) if bool(np.isfinite(change).any()) else -math.inf


def _q(map_: Map) -> float:
    return 1.0 if math.isnan(map_.q_value) else map_.q_value


def _as_long(values: FloatArray, like: FloatArray) -> FloatArray:
    return values if len(values) == len(like) else np.full(len(like), math.nan)


def _folded(label: str) -> str:
    """A long label on two lines, broken near its middle, a number kept with its unit."""
    breaks = [m.start() for m in re.finditer(r"(?<!\d) ", label)]
    if len(label) <= _LONG_LABEL or not breaks:
        return label
    at = min(breaks, key=lambda each: abs(each - len(label) / 2))
    return f"{label[:at]}\n{label[at + 1 :]}"


def _calm(axes: "Axes") -> None:
    axes.use_sticky_edges = False
    axes.locator_params(axis="x", nbins=5)
    axes.locator_params(axis="y", nbins=4)
    axes.tick_params(labelsize=8)
