"""The report's other figures: spectrum, ranking, confusion, replay, before and after, placebo.

In: artefacts of the steps. Out: figures; None where there is nothing to draw.
"""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.core import figures
from wakedeploy.gap.report.maps import AFTER, BEFORE, labelled
from wakedeploy.gap.report.shrinkage import closed_words, gap_channel, unchanged
from wakedeploy.gap.report.tables import ranked
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.wording import (
    FloatArray,
    entries,
    interval,
    mapping,
    number,
    numbers,
    quantity,
    scale_of,
    texts,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH_IN = 7.5
_STRAY = 6.0 * 1.4826  # medians of the error's size beyond which a reading strayed, as in `showing`
_ON_PAPER = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
_FIRST_ROUND, _LATER_ROUNDS = 30, 10  # effects shown per panel of the ranking
_DARK_BELOW_NATS = 60.0  # where the heat map's shades are dark
_MOST_NUMBERED = 12  # names in a confusion matrix whose cells still have room for numbers

Artefact = Mapping[str, Any]


def draw_spectrum(find: Artefact, show: Artefact) -> "Figure | None":
    """Spectrum and autocorrelation of the innovations, after the effect was added, too."""
    spectra = _before_after(find.get("spectrum"), show.get("spectrum"))
    whites = _before_after(find.get("white"), show.get("white"))
    if not any(len(numbers(s.get("density"))) for s, _, _ in spectra):
        return None
    drawn, (left, right) = figures.figure(1, 2, size=(_WIDTH_IN, 2.9), width_ratios=(1.25, 1.0))
    _spectrum(left, spectra, mapping(find.get("spectrum")))
    _autocorrelation(right, whites, _samples(find, "sealed" if show.get("white") else "fit"))
    return drawn


def draw_replay(find: Artefact) -> "Figure | None":
    """Error of open-loop replay per horizon, and what noise alone would give."""
    points = sorted(
        (number(p.get("horizon_s")), number(p.get("rmse_m")), number(p.get("expected_m")))
        for p in entries(find.get("replay"))
    )
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


def draw_ranking(name: Artefact) -> "Figure | None":
    """Held-out gain per effect with interval, one panel per round, and the threshold."""
    rounds = [r for r in entries(name.get("rounds")) if ranked(r)]
    if not rounds:
        return None
    rankings = [ranked(r)[: _LATER_ROUNDS if i else _FIRST_ROUND] for i, r in enumerate(rounds)]
    heights = [0.6 + 0.19 * len(ranking) for ranking in rankings]
    drawn, grid = figures.figure(
        len(rounds), size=(_WIDTH_IN, sum(heights) + 0.3), squeeze=False, height_ratios=heights
    )
    found = {str(e.get("name")) for e in entries(name.get("effects"))}
    rivals = set(texts(name.get("class")))
    for axes, round_, ranking in zip(grid[:, 0], rounds, rankings, strict=True):
        _round(axes, round_, ranking, found, rivals)
    _threshold_legend(grid[0, 0])
    gain = "gain in held-out log density over the model so far [nats]"
    if number(name.get("fitted_flights")) == 1.0:
        gain = "gain in log density over the rig as it is, less a nat per parameter [nats]"
    grid[-1, 0].set_xlabel(gain)
    return drawn


def draw_confusion(name: Artefact) -> "Figure | None":
    """Nats that the best version of a rival (column) loses if the effect of the row is true."""
    confusion = mapping(name.get("confusion"))
    names, rows = texts(confusion.get("names")), confusion.get("loss_nats")
    square = isinstance(rows, list) and len(rows) == len(names) > 1
    if not square or any(len(numbers(row)) != len(names) for row in rows or []):
        return None
    loss = np.array([numbers(row) for row in rows or []])
    np.fill_diagonal(loss, math.nan)
    if not bool(np.isfinite(loss).any()):
        return None
    side = min(_WIDTH_IN, 2.8 + 0.2 * max(len(names), 6))
    drawn, axes = figures.figure(size=(side, 0.9 * side))
    _heat_map(drawn, axes, loss, [_plain(n) for n in names])
    return drawn


def draw_gaps(show: Artefact) -> "Figure | None":
    """Per channel: the gap before and after with intervals, and the noise floor."""
    channels = [(str(n), mapping(c)) for n, c in mapping(show.get("gap")).items()]
    channels = [(n, c) for n, c in channels if not math.isnan(number(c.get("before")))]
    if not channels:
        return None
    drawn, grid = figures.figure(
        len(channels), size=(_WIDTH_IN, 1.3 * len(channels)), squeeze=False
    )
    for axes, (name, channel) in zip(grid[:, 0], channels, strict=True):
        same = unchanged(channel)
        levels = [_level(channel, "before", "as it is" if same else "before", BEFORE)]
        if not same:
            closed = closed_words(channel)
            note = {"note": f"{closed} closed" if closed else ""}
            levels.append(_level(channel, "after", "after", AFTER) | note)
        _levels(axes, levels, channel, f"rms error, {name}")
    drawn.align_ylabels(grid)
    return drawn


def draw_placebo(summary: Artefact) -> "Figure | None":
    """The gap without anything, with a wrong effect, and with the one that was found."""
    placebo = mapping(summary.get("placebo"))
    name, channel = gap_channel(summary)
    if math.isnan(number(placebo.get("after"))) or unchanged(channel):
        return None
    names = [str(e.get("name")) for e in entries(summary.get("effects"))]
    levels = [
        _level(channel or placebo, "before", "before", BEFORE),
        _level(placebo, "after", f"placebo: {placebo.get('name')}", figures.SOURCE),
        _level(channel, "after", f"found: {', '.join(names)}" if names else "after", AFTER),
    ]
    drawn, axes = figures.figure(size=(_WIDTH_IN, 1.9))
    _levels(axes, levels, channel or placebo, f"rms error, {name}" if name else "gap")
    return drawn


def draw_traces(show: Artefact) -> "Figure | None":
    """Forecasts 0.25 s ahead of one flight that was held out, before and after."""
    traces = mapping(show.get("traces"))
    time_s, measured_m = numbers(traces.get("t_s")), numbers(traces.get("measured_m"))
    before_m, after_m = numbers(traces.get("before_m")), numbers(traces.get("after_m"))
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
        usual = np.abs(error_mm) < _STRAY * float(np.nanmedian(np.abs(error_mm)))
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


def draw_retraining(show: Artefact) -> "Figure | None":
    """Error on measured data of predictors trained on the old and on the corrected simulation."""
    retrain = mapping(show.get("retrain"))
    if math.isnan(number(retrain.get("new_rmse"))):
        return None
    drawn, axes = figures.figure(size=(_WIDTH_IN, 1.45))
    levels = [
        _level(retrain, "old_rmse", "trained on the old rig", BEFORE),
        _level(retrain, "new_rmse", "trained on the corrected rig", AFTER),
    ]
    _levels(axes, levels, retrain, "prediction error on measured data, rms")
    return drawn


def _before_after(found: Any, shown: Any) -> list[tuple[Artefact, str, str]]:
    """(artefact, colour, label) of what is there: before and after, or as it was found."""
    both = mapping(shown)
    pairs = [(mapping(both.get("before")), BEFORE, "before"),
             (mapping(both.get("after")), AFTER, "after")]  # fmt: skip
    pairs = [pair for pair in pairs if pair[0]]
    return pairs or [(mapping(found), figures.MEASURED, "innovations")]


def _spectrum(axes: "Axes", spectra: Sequence[tuple[Artefact, str, str]], found: Artefact) -> None:
    from matplotlib.ticker import LogLocator

    for spectrum, colour, label in spectra:
        hz, density = numbers(spectrum.get("frequency_hz")), numbers(spectrum.get("density"))
        if len(hz) == len(density) > 0:
            drawable = (hz > 0.0) & (density > 0.0)
            axes.loglog(hz[drawable], density[drawable], color=colour, label=label)
            _band(axes, hz, spectrum if spectrum.get("low") is not None else found)
    axes.set(xlabel="frequency [Hz]", ylabel="power density (white noise = 1)")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
    if axes.lines:
        figures.legend(axes)


def _band(axes: "Axes", hz: FloatArray, spectrum: Artefact) -> None:
    """The 95 % band of white noise, one number or one per frequency; drawn once."""
    if axes.collections:
        return
    low, high = (_spread(spectrum.get(end), len(hz)) for end in ("low", "high"))
    if bool(np.isfinite(low).any()):
        axes.fill_between(hz, low, high, color=figures.SUFFERER, alpha=0.25, linewidth=0,
                          label="95 % of white noise")  # fmt: skip


def _spread(value: Any, count: int) -> FloatArray:
    many = numbers(value)
    return many if len(many) == count else np.full(count, number(value))


def _autocorrelation(
    axes: "Axes", whites: Sequence[tuple[Artefact, str, str]], samples: float
) -> None:
    from matplotlib.ticker import MaxNLocator

    for white, colour, label in whites:
        lags, values = numbers(white.get("lags")), numbers(white.get("autocorrelation"))
        if len(lags) == len(values) > 0:
            axes.plot(lags, values, "o-", color=colour, markersize=3, label=label)
    if samples > 0.0:
        half = 1.96 / math.sqrt(samples)
        axes.axhspan(-half, half, color=figures.SUFFERER, alpha=0.25, linewidth=0)
    axes.axhline(0.0, color=figures.REFERENCE, linewidth=0.7, zorder=1.5)
    axes.set(xlabel="lag [samples]", ylabel="autocorrelation of innovations")
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))


def _samples(find: Artefact, use: str) -> float:
    """Of the flights fitted or sealed, of all where the split does not say."""
    logs = entries(find.get("logs"))
    names = texts(mapping(find.get("split")).get(use))
    counts = [number(log.get("samples")) for log in logs if str(log.get("path")) in names]
    counts = counts or [number(log.get("samples")) for log in logs]
    return float(np.nansum(counts)) if counts else 0.0


def _threshold_legend(axes: "Axes") -> None:
    if axes.get_legend_handles_labels()[0]:
        figures.legend(axes, bbox_to_anchor=(1.0, 0.0), frameon=True, edgecolor="none")


def _round(
    axes: "Axes",
    round_: Artefact,
    ranking: Sequence[Artefact],
    found: set[str],
    rivals: set[str],
) -> None:
    """One round: a dot and an interval per effect, the best at the top.

    A class's members count from the round in which the best one passed the threshold.
    """
    threshold = number(round_.get("threshold_nats"))
    gains = np.array([number(each.get("gain_nats")) for each in ranking])
    ends = np.array([interval(each.get("interval")) for each in ranking])
    passes = gains >= threshold
    any_passes = bool(passes.any())
    chosen = [
        (ok and str(c.get("name")) in found) or (any_passes and str(c.get("name")) in rivals)
        for ok, c in zip(passes, ranking, strict=True)
    ]
    colours = np.where(chosen, AFTER, np.where(passes, figures.MEASURED, figures.LIMIT))
    rows = np.arange(len(ranking))
    axes.hlines(rows, ends[:, 0], ends[:, 1], colors=list(colours), linewidth=2.2, alpha=0.45)
    axes.scatter(gains, rows, c=list(colours), s=np.where(chosen, 26, 13), clip_on=False, zorder=3)
    names = [_plain(c.get("name")) for c in ranking]
    axes.set_yticks(range(len(ranking)), names, fontsize=8)
    axes.set_ylim(len(ranking) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.axvline(0.0, color=figures.REFERENCE, linewidth=0.7, zorder=1.5)
    _gain_axis(axes, ranking, threshold)
    axes.set_title(_round_title(round_, len(ranking)))


def _gain_axis(axes: "Axes", ranking: Sequence[Artefact], threshold: float) -> None:
    """Linear near zero, logarithmic beyond the threshold, where one effect outgrows the rest."""
    linear = max(threshold, 5.0) if not math.isnan(threshold) else 10.0
    ends = [number(c.get("gain_nats")) for c in ranking] + [
        end for c in ranking for end in interval(c.get("interval"))
    ]
    if float(np.nanmax(np.abs(ends), initial=0.0)) > 8.0 * linear:
        axes.set_xscale("symlog", linthresh=2.0 * linear, linscale=1.0)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlim(right=1.5 * float(np.nanmax(ends)))
    if not math.isnan(threshold):
        axes.axvline(threshold, color=figures.REFERENCE, linestyle="--", linewidth=1.0,
                     label=f"threshold, {threshold:.1f} nats")  # fmt: skip


def _round_title(round_: Artefact, shown: int) -> str:
    given = [_plain(name) for name in texts(round_.get("given"))]
    title = f"On top of {', '.join(given)}" if given else "On top of the model as it is"
    total = len(entries(round_.get("ranking")))
    return title if shown == total else f"{title} (best {shown} of {total})"


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


def _level(source: Artefact, key: str, label: str, colour: str) -> dict[str, Any]:
    return {"value": number(source.get(key)), "ends": interval(source.get(f"{key}_interval")),
            "label": label, "colour": colour, "note": ""}  # fmt: skip


def _levels(
    axes: "Axes", levels: Sequence[Mapping[str, Any]], channel: Artefact, name: str
) -> None:
    """Errors one below the other, from zero, each with interval; the noise floor as a line."""
    levels = [level for level in levels if not math.isnan(level["value"])]
    floor = number(channel.get("noise_floor"))
    every = [floor, *(v for level in levels for v in (level["value"], *level["ends"]))]
    factor, unit = scale_of(every, str(channel.get("unit") or ""))
    for row, level in enumerate(levels):
        axes.barh(row, factor * level["value"], height=0.55, color=level["colour"], alpha=0.55)
        low, high = (factor * end for end in level["ends"])
        axes.plot([low, high], [row, row], color=level["colour"], linewidth=2.4)
        end = np.nanmax([factor * level["value"], high])
        text = "  ".join([quantity(factor * level["value"], ""), level["note"]])
        axes.annotate(text, (end, row), (5, 0), textcoords="offset points", va="center",
                      fontsize=8, zorder=4, bbox=_ON_PAPER)  # fmt: skip
    if not math.isnan(floor):
        axes.axvline(factor * floor, color=figures.REFERENCE, linestyle="--", linewidth=1.0)
        axes.text(factor * floor, 1.0, "noise floor", transform=axes.get_xaxis_transform(),
                  ha="center", va="bottom", fontsize=8)  # fmt: skip
    axes.set_yticks(range(len(levels)), [_plain(level["label"]) for level in levels])
    axes.set_ylim(len(levels) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.set_xlim(0, 1.18 * factor * float(np.nanmax(every)))
    axes.set_xlabel(labelled(name, unit))


def _plain(text: object) -> str:
    """A name that matplotlib does not read as mathematics."""
    return str(text).replace("$", r"\$")
