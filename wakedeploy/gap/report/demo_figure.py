"""The demo's one picture: find, name, add, show, fly, a panel each.

In: the steps' artefacts, the tracking, two flights, what was hidden. Out: a PNG.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from wakedeploy.core import figures
from wakedeploy.gap.report.maps import AFTER, BEFORE
from wakedeploy.gap.search.artefacts import Map
from wakedeploy.gap.systems.gantry.artefacts import Find, Name, Show, Traces
from wakedeploy.gap.systems.gantry.folder import StepArtefacts
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.wording import numbers, quantity, scale_of, signs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wakedeploy.gap.systems.gantry.retraining import FlownAgain, TrackingError

FloatArray = npt.NDArray[np.float64]

_SIZE_IN = (9.6, 6.4)
_RANKED = 7
_SHOWN_S = 16.0  # of the example flights, once the source has started
_FROM_S = 2.0
_FORECAST = "height 0.25 s ahead"
_HEADLINE = "The rig file said that motors follow their command at once. In flight they do not."


@dataclass(frozen=True, eq=False)
class Flown:
    """One flight: time [s] and height error [mm], (T,) each."""

    at_s: FloatArray
    error_mm: FloatArray


def draw_story(
    steps: StepArtefacts,
    tracking: "FlownAgain",
    before: Flown,
    after: Flown,
    truth: Mapping[str, float],
    path: Path,
) -> None:
    """Draw all five panels; `truth` are the hidden values by `<effect>.<parameter>`."""
    from matplotlib.figure import Figure

    find, name, show = steps.find, steps.name, steps.show
    if find is None or name is None or show is None or show.traces is None:
        raise ValueError("the story takes all steps")
    with figures.style():
        drawn = Figure(figsize=_SIZE_IN)
        grid = drawn.add_gridspec(3, 3, height_ratios=(1.2, 1.0, 1.0), width_ratios=(1.1, 1.0, 1.0))
        _find(drawn.add_subplot(grid[0, 0]), find, show)
        _name(drawn.add_subplot(grid[0, 1]), name)
        _add(drawn.add_subplot(grid[0, 2]), name, truth)
        _show(drawn.add_subplot(grid[1, :]), show, show.traces)
        _fly(drawn.add_subplot(grid[2, :]), tracking, before, after)
        drawn.suptitle(_HEADLINE, x=0.012, ha="left", fontsize=13, fontweight="bold")
        figures.save(drawn, path)


def _find(axes: "Axes", find: Find, show: Show) -> None:
    """The place where they disagree most, and what is left there on the sealed flights."""
    found = _strongest_map(find)
    here = (found.channel, found.coordinate)
    edges, mean = numbers(found.edges), numbers(found.mean)
    low, high = numbers(found.low), numbers(found.high)
    factor, unit = scale_of(np.concatenate([low, high]), found.unit)
    axes.bar(edges[:-1], factor * (high - low), np.diff(edges), factor * low, align="edge",
             color=BEFORE, alpha=0.35, linewidth=0)  # fmt: skip
    axes.hlines(factor * mean, edges[:-1], edges[1:], color=BEFORE, lw=2.2, label="before")
    shown = [place for place in show.places if (place.channel, place.coordinate) == here]
    for rest in shown[:1]:  # two places of one map are the same picture
        ends, values = numbers(rest.edges), factor * numbers(rest.after)
        axes.hlines(values, ends[:-1], ends[1:], color=AFTER, lw=2.2, label="after")
    axes.axhline(0.0, color=figures.REFERENCE, lw=0.7)
    reach = factor * float(np.ptp(np.concatenate([low, high])))
    axes.set_ylim(factor * low.min() - 0.08 * reach, factor * high.max() + 0.08 * reach)
    axes.set_xlabel(f"{found.coordinate} [{signs(found.coordinate_unit)}]")
    axes.set_ylabel(f"measured − simulated [{unit}]")
    _titled(axes, "1  Find", found.channel)
    axes.legend(loc="best")


def _strongest_map(find: Find) -> Map:
    """The map of the place that is listed first; the first map where no place stands out."""
    for place in find.places:
        here = (place.channel, place.coordinate)
        return next(m for m in find.maps if (m.channel, m.coordinate) == here)
    return find.maps[0]


def _name(axes: "Axes", name: Name) -> None:
    """The first search through the library: what each effect explains on flights held out."""
    first = name.rounds[0]
    ranking = first.ranking[:_RANKED]
    chosen = {effect.name for effect in name.effects}
    gains = [max(each.gain_nats, 0.0) for each in ranking]
    colours = [AFTER if each.name in chosen else "#c9c9c9" for each in ranking]
    rows = np.arange(len(ranking))
    axes.barh(rows, gains, color=colours, height=0.68)
    axes.set_yticks(rows, [each.name for each in ranking], fontsize=7.5)
    axes.set_ylim(len(ranking) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.set_xlabel("gain on flights held out [nats]")
    _titled(axes, "2  Name", f"best {len(ranking)} of {len(first.ranking)}")


def _add(axes: "Axes", name: Name, truth: Mapping[str, float]) -> None:
    """The values that the corrected rig file states, beside those that were hidden."""
    rows = [
        (_motor(effect.name, parameter), size, truth.get(f"{effect.name}.{parameter}"))
        for effect in name.effects
        for parameter, size in effect.parameters.items()
        if size.unit == "s"
    ]
    for row, (_, size, hidden) in enumerate(rows):
        axes.hlines(row, 1e3 * size.low, 1e3 * size.high, color=AFTER, lw=5.0, alpha=0.4)
        axes.plot(1e3 * size.value, row, "o", color=AFTER, ms=5.5)
        if hidden is not None:
            axes.vlines(1e3 * hidden, row - 0.36, row + 0.36, color=figures.REFERENCE, lw=1.6)
    axes.plot([], [], "o", color=AFTER, label="found, 90 %")
    axes.plot([], [], "|", color=figures.REFERENCE, ms=9, mew=1.6, label="hidden")
    axes.set_yticks(range(len(rows)), [label for label, _, _ in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlim(0.0, None)
    axes.grid(False, axis="y")
    axes.set_xlabel("rotor time constant [ms]")
    axes.legend(loc="lower left", handlelength=1.0)
    _titled(axes, "3  Add", "spool lags found")


def _motor(effect: str, parameter: str) -> str:
    """`source up` for the source's lag when it spools up; other effects by their name."""
    end = parameter.removesuffix("_s")
    return f"{effect.removeprefix('spool-lag-')} {end}" if "spool-lag" in effect else effect


def _show(axes: "Axes", show: Show, traces: Traces) -> None:
    """Errors of forecasts a quarter of a second ahead, on a flight that nothing was fitted to."""
    gap = show.gap[_FORECAST]
    at_s, measured_m = numbers(traces.t_s), numbers(traces.measured_m)
    for when, forecast_m, rms, colour in (
        ("before", traces.before_m, gap.before, BEFORE),
        ("after", traces.after_m, gap.after, AFTER),
    ):
        error_mm = _without_strays(1e3 * (numbers(forecast_m) - measured_m))
        label = f"{when}: {quantity(rms, gap.unit)} rms"
        axes.plot(at_s, error_mm, color=colour, lw=1.3, label=label)
    floor = quantity(gap.noise_floor, gap.unit)
    axes.plot([], [], " ", label=f"noise alone: {floor}")
    axes.axhline(0.0, color=figures.REFERENCE, lw=0.7)
    axes.set_xlim(at_s[0], at_s[-1])
    axes.set_ylabel("forecast −\nmeasured [mm]")
    axes.set_xlabel("time in a flight that was held out [s]", labelpad=1.0)
    _titled(axes, "4  Show", "forecasts 0.25 s ahead")
    figures.legend(axes)


def _without_strays(error_mm: FloatArray) -> FloatArray:
    """Readings that strayed left out, as they are where the gap is measured."""
    usual = 1.4826 * float(np.nanmedian(np.abs(error_mm)))
    return np.where(np.abs(error_mm) < RULES.stray * usual, error_mm, np.nan)


def _fly(axes: "Axes", tracking: "FlownAgain", before: Flown, after: Flown) -> None:
    """The same flight on the gantry that still lags, with either rig file and predictor."""
    rows = tracking.feedforward
    for flown, key, error, colour in (
        (before, "before", rows.before, BEFORE),
        (after, "after", rows.after, AFTER),
    ):
        seen = (flown.at_s >= _FROM_S) & (flown.at_s < _FROM_S + _SHOWN_S)
        label = f"{key}: {_millimetres(error)} rms"
        axes.plot(flown.at_s[seen] - _FROM_S, flown.error_mm[seen], color=colour, lw=1.5,
                  label=label)  # fmt: skip
    alone = _millimetres(tracking.pid.after)
    axes.plot([], [], " ", label=f"without predictor: {alone}")
    axes.axhline(0.0, color=figures.REFERENCE, lw=0.7)
    axes.set_xlim(0.0, _SHOWN_S)
    axes.set_ylabel("altitude\nerror [mm]")
    axes.set_xlabel("time in a flight [s]", labelpad=1.0)
    _titled(axes, "5  Fly", "with a predictor trained on that rig file")
    figures.legend(axes)


def _titled(axes: "Axes", step: str, what: str) -> None:
    axes.set_title("")
    axes.set_title(f"{step}: {what}", loc="left", fontsize=9.5)


def _millimetres(error: "TrackingError") -> str:
    return quantity(1e-3 * error.rmse, "m") if error.rmse is not None else "a failsafe"
