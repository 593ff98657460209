"""The report's other figures: spectrum, confusion, replay, before and after, placebo.

In: artefacts of the steps. Out: figures; None where there is nothing to draw.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from wakedeploy.core import figures
from wakedeploy.gap.report.maps import AFTER, BEFORE, labelled
from wakedeploy.gap.report.shrinkage import closed_words, gap_channel, unchanged
from wakedeploy.gap.search.artefacts import White
from wakedeploy.gap.systems.gantry.artefacts import Find, Replay, Show, Spectrum, Summary, Traces
from wakedeploy.gap.systems.gantry.findings import Confusion, Gap, Retraining
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.wording import FloatArray, numbers, quantity, scale_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH_IN = 7.5
_ON_PAPER = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
_DARK_BELOW_NATS = 60.0  # where the heat map's shades are dark
_MOST_NUMBERED = 12  # names in a confusion matrix whose cells still have room for numbers

Curve = TypeVar("Curve", covariant=True)


class Pair(Protocol[Curve]):
    """The same of the rig file as it is, and with what was found."""

    @property
    def before(self) -> Curve:
        """As it is."""
        ...

    @property
    def after(self) -> Curve:
        """With what was found."""
        ...


def draw_spectrum(find: Find, show: Show | None) -> "Figure | None":
    """Spectrum and autocorrelation of the innovations, after the effect was added, too."""
    spectra = _curves(find.spectrum, None if show is None else show.spectrum)
    whites = _curves(find.white, None if show is None else show.white)
    if not any(spectrum.density for spectrum, _, _ in spectra):
        return None
    drawn, (spectrum_axes, correlation_axes) = figures.figure(
        1, 2, size=(_WIDTH_IN, 2.9), width_ratios=(1.25, 1.0)
    )
    _spectrum(spectrum_axes, spectra)
    used = find.split.fit if show is None or show.white is None else find.split.sealed
    _autocorrelation(correlation_axes, whites, _samples(find, used))
    return drawn


def draw_replay(replay: Sequence[Replay]) -> "Figure | None":
    """Error of open-loop replay per horizon, and what noise alone would give."""
    points = sorted((p.horizon_s, p.rmse_m, p.expected_m) for p in replay)
    horizon, rmse, expected = np.array(points).reshape(-1, 3).T
    if not bool(np.isfinite(rmse).any()):
        return None
    drawn, axes = figures.figure(size=(0.6 * _WIDTH_IN, 2.6))
    factor, unit = scale_of(np.concatenate([rmse, expected]), "m")
    axes.plot(horizon, factor * rmse, "o-", color=figures.MEASURED, label="replayed")
    axes.plot(horizon, factor * expected, "s--", color=BEFORE, label="expected by the model")
    axes.set(xlabel="horizon [s]", ylabel=f"height error, rms [{unit}]", ylim=(0, None))
    axes.set_xlim(0, None)
    figures.legend(axes)
    return drawn


def draw_confusion(confusion: Confusion) -> "Figure | None":
    """Nats that the best version of a rival (column) loses if the effect of the row is true."""
    names, rows = confusion.names, confusion.loss_nats
    if not len(rows) == len(names) > 1 or any(len(row) != len(names) for row in rows):
        return None
    loss = np.array([numbers(row) for row in rows])
    np.fill_diagonal(loss, math.nan)
    if not bool(np.isfinite(loss).any()):
        return None
    side = min(_WIDTH_IN, 2.8 + 0.2 * max(len(names), 6))
    drawn, axes = figures.figure(size=(side, 0.9 * side))
    _heat_map(drawn, axes, loss, [_plain(n) for n in names])
    return drawn


def draw_gaps(gap: Mapping[str, Gap]) -> "Figure | None":
    """Per channel: the gap before and after with intervals, and the noise floor."""
    channels = [(n, c) for n, c in gap.items() if not math.isnan(c.before)]
    if not channels:
        return None
    drawn, grid = figures.figure(
        len(channels), size=(_WIDTH_IN, 1.3 * len(channels)), squeeze=False
    )
    for axes, (name, channel) in zip(grid[:, 0], channels, strict=True):
        same = unchanged(channel)
        levels = [_before(channel, "as it is" if same else "before")]
        if not same:
            closed = closed_words(channel)
            levels.append(replace(_after(channel), note=f"{closed} closed" if closed else ""))
        _levels(axes, levels, channel.noise_floor, channel.unit, f"rms error, {name}")
    drawn.align_ylabels(grid)
    return drawn


def draw_placebo(summary: Summary) -> "Figure | None":
    """The gap without anything, with a wrong effect, and with the one that was found."""
    placebo, (name, channel) = summary.placebo, gap_channel(summary)
    if placebo is None or channel is None or unchanged(channel) or math.isnan(placebo.after):
        return None
    names = [effect.name for effect in summary.effects]
    wrong = f"placebo: {placebo.name}"
    levels = [
        _before(channel),
        Level(placebo.after, placebo.after_interval, wrong, figures.SOURCE),
        _after(channel, f"found: {', '.join(names)}" if names else "after"),
    ]
    drawn, axes = figures.figure(size=(_WIDTH_IN, 1.9))
    _levels(axes, levels, channel.noise_floor, channel.unit, f"rms error, {name}")
    return drawn


def draw_traces(traces: Traces | None) -> "Figure | None":
    """Forecasts 0.25 s ahead of one flight that was held out, before and after."""
    if traces is None:
        return None
    time_s, measured_m = numbers(traces.t_s), numbers(traces.measured_m)
    before_m, after_m = numbers(traces.before_m), numbers(traces.after_m)
    if not len(time_s) == len(measured_m) == len(before_m) == len(after_m) > 1:
        return None
    drawn, (height, error) = figures.figure(
        2, size=(_WIDTH_IN, 4.2), sharex=True, height_ratios=(1.3, 1.0)
    )
    height.plot(time_s, measured_m, color=figures.REFERENCE, linewidth=1.4, label="measured")
    reach = 1.0
    for forecast_m, colour, label in ((before_m, BEFORE, "before"), (after_m, AFTER, "after")):
        height.plot(time_s, forecast_m, color=colour, label=f"forecast {label}")
        error_mm = 1e3 * (forecast_m - measured_m)
        usual = np.abs(error_mm) < RULES.stray * 1.4826 * float(np.nanmedian(np.abs(error_mm)))
        rms = math.sqrt(float(np.mean(error_mm[usual] ** 2))) if usual.any() else math.nan
        reach = max(reach, float(np.max(np.abs(error_mm[usual]), initial=0.0)))
        error.plot(time_s, error_mm, color=colour, label=f"{label}: {rms:.1f} mm rms")
    error.axhline(0.0, color=figures.REFERENCE, linewidth=0.7, zorder=1.5)
    height.set(ylabel="height [m]")
    error.set(ylabel="forecast − measured [mm]", xlabel="time [s]")
    error.set_ylim(-1.1 * reach, 1.1 * reach)
    error.set_xlim(float(np.nanmin(time_s)), float(np.nanmax(time_s)))
    figures.legend(height)
    figures.legend(error)
    return drawn


def draw_retraining(scores: Retraining | None) -> "Figure | None":
    """Error on measured data of predictors trained on the old and on the corrected simulation."""
    if scores is None:
        return None
    drawn, axes = figures.figure(size=(_WIDTH_IN, 1.45))
    levels = [
        Level(scores.old_rmse, scores.old_rmse_interval, "trained on the old rig", BEFORE),
        Level(scores.new_rmse, scores.new_rmse_interval, "trained on the corrected rig", AFTER),
    ]
    _levels(axes, levels, math.nan, scores.unit, "prediction error on measured data, rms")
    return drawn


def _curves(found: Curve | None, shown: Pair[Curve] | None) -> list[tuple[Curve, str, str]]:
    """With colour and label, what is there: before and after, or as it was found."""
    if shown is not None:
        return [(shown.before, BEFORE, "before"), (shown.after, AFTER, "after")]
    return [] if found is None else [(found, figures.MEASURED, "innovations")]


def _spectrum(axes: "Axes", spectra: Sequence[tuple[Spectrum, str, str]]) -> None:
    from matplotlib.ticker import LogLocator

    for spectrum, colour, label in spectra:
        hz, density = numbers(spectrum.frequency_hz), numbers(spectrum.density)
        if len(hz) == len(density) > 0:
            drawable = (hz > 0.0) & (density > 0.0)
            axes.loglog(hz[drawable], density[drawable], color=colour, label=label)
            _band(axes, hz, spectrum)
    axes.set(xlabel="frequency [Hz]", ylabel="power density (white noise = 1)")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
    if axes.lines:
        figures.legend(axes)


def _band(axes: "Axes", hz: FloatArray, spectrum: Spectrum) -> None:
    """The 95 % band of white noise; drawn once."""
    if axes.collections or math.isnan(spectrum.low + spectrum.high):
        return
    axes.fill_between(hz, spectrum.low, spectrum.high, color=figures.SUFFERER, alpha=0.25,
                      linewidth=0, label="95 % of white noise")  # fmt: skip


def _autocorrelation(axes: "Axes", whites: Sequence[tuple[White, str, str]], samples: int) -> None:
    from matplotlib.ticker import MaxNLocator

    for white, colour, label in whites:
        lags, values = np.array(white.lags), numbers(white.autocorrelation)
        if len(lags) == len(values) > 0:
            axes.plot(lags, values, "o-", color=colour, markersize=3, label=label)
    if samples:
        half = 1.96 / math.sqrt(samples)
        axes.axhspan(-half, half, color=figures.SUFFERER, alpha=0.25, linewidth=0)
    axes.axhline(0.0, color=figures.REFERENCE, linewidth=0.7, zorder=1.5)
    axes.set(xlabel="lag [samples]", ylabel="autocorrelation of innovations")
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))


def _samples(find: Find, used: Sequence[str]) -> int:
    """The samples of the flights that were used; of all flights where the split names none."""
    counts = [log.samples for log in find.logs if log.path in used]
    return sum(counts or [log.samples for log in find.logs])


def _heat_map(drawn: "Figure", axes: "Axes", loss: FloatArray, names: list[str]) -> None:
    from matplotlib.colors import LogNorm

    top = max(float(np.nanmax(loss)), 30.0)
    shades = axes.imshow(
        np.maximum(loss, 0.3), norm=LogNorm(0.3, top), cmap="viridis", aspect="auto"
    )
    axes.set_facecolor("#dddddd")
    ticks = range(len(names))
    size = 8 if len(names) <= _MOST_NUMBERED else 7
    axes.set_xticks(ticks, names, rotation=90, fontsize=size)
    axes.set_yticks(ticks, names, fontsize=size)
    axes.set(xlabel="explained by", ylabel="true effect")
    axes.grid(False)
    rows, columns = np.nonzero(loss < RULES.class_nats)
    axes.scatter(columns, rows, marker="x", color="white", s=18, linewidths=1.0)
    if len(names) <= _MOST_NUMBERED:
        _number_cells(axes, loss)
    bar = drawn.colorbar(shades, ax=axes, shrink=0.8, pad=0.02)
    bar.ax.axhline(RULES.class_nats, color="white", linewidth=1.6)
    bar.ax.yaxis.set_major_formatter("{x:g}")
    bar.set_label("log density that the rival loses [nats]")
    axes.set_title(f"× under {RULES.class_nats:g} nats: cannot be told apart", fontsize=9)


def _number_cells(axes: "Axes", loss: FloatArray) -> None:
    for row, column in np.argwhere(loss >= RULES.class_nats):
        nats = loss[row, column]
        ink = "white" if nats < _DARK_BELOW_NATS else "#222222"
        axes.text(column, row, f"{nats:.0f}", ha="center", va="center", fontsize=7, color=ink)


@dataclass(frozen=True)
class Level:
    """An error with its 90 % interval, as a bar."""

    value: float
    interval: tuple[float, float] | None
    label: str
    colour: str
    note: str = ""

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of the interval; NaN without one."""
        return self.interval or (math.nan, math.nan)


def _before(channel: Gap, label: str = "before") -> Level:
    return Level(channel.before, channel.before_interval, label, BEFORE)


def _after(channel: Gap, label: str = "after") -> Level:
    return Level(channel.after, channel.after_interval, label, AFTER)


def _levels(axes: "Axes", levels: Sequence[Level], floor: float, unit: str, name: str) -> None:
    """Errors one below the other, from zero, each with interval; the noise floor as a line."""
    levels = [level for level in levels if not math.isnan(level.value)]
    every = [floor, *(v for level in levels for v in (level.value, *level.ends))]
    factor, shown = scale_of(every, unit)
    for row, level in enumerate(levels):
        axes.barh(row, factor * level.value, height=0.55, color=level.colour, alpha=0.55)
        low, high = (factor * end for end in level.ends)
        axes.plot([low, high], [row, row], color=level.colour, linewidth=2.4)
        end = np.nanmax([factor * level.value, high])
        text = "  ".join([quantity(factor * level.value, ""), level.note])
        axes.annotate(text, (end, row), (5, 0), textcoords="offset points", va="center",
                      fontsize=8, zorder=4, bbox=_ON_PAPER)  # fmt: skip
    if not math.isnan(floor):
        axes.axvline(factor * floor, color=figures.REFERENCE, linestyle="--", linewidth=1.0)
        axes.text(factor * floor, 1.0, "noise floor", transform=axes.get_xaxis_transform(),
                  ha="center", va="bottom", fontsize=8)  # fmt: skip
    axes.set_yticks(range(len(levels)), [_plain(level.label) for level in levels])
    axes.set_ylim(len(levels) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.set_xlim(0, 1.18 * factor * float(np.nanmax(every)))
    axes.set_xlabel(labelled(name, shown))


def _plain(text: object) -> str:
    """A name that matplotlib does not read as mathematics."""
    return str(text).replace("$", r"\$")
