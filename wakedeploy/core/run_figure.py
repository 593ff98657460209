"""The picture of a run: height, force, commands and timing over time, modes shaded."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from wakedeploy.core import figures
from wakedeploy.core.failsafes import in_words
from wakedeploy.core.run_summary import RunSummary
from wakedeploy.core.runlog import RunLog
from wakedeploy.core.runlog_columns import STAGES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# What a panel shows at least, so that noise at rest does not look like a flight.
_LEAST_ERROR_MM, _LEAST_FORCE_N, _LEAST_PULSE_US, _LEAST_X_M = 20.0, 0.1, 100.0, 0.02
_LEAST_TIMING_MS = 1.0
_LEAST_NAMED, _LEAST_ACROSS = 0.012, 0.06  # shares of the flight's time that a name takes


def draw_run(log: RunLog, summary: RunSummary, title: str) -> "Figure":
    """Draw a run; a panel without any data says so."""
    with figures.style():
        heights = (3.0, 1.5, 2.2, 2.2, 1.8)
        drawn, axes = figures.figure(5, size=(10.5, 11.0), sharex=True, height_ratios=heights)
        drawn.suptitle(f"{title}: {_headline(summary)}", fontweight="bold", x=0.008, ha="left")
        _height(axes[0], log)
        _error(axes[1], log)
        _force(axes[2], log)
        _commands(axes[3], log)
        _timing(axes[4], log, summary)
        for panel in axes:
            _shade_modes(panel, log)
        _mark_failsafe(axes, log, summary)
        if len(log) > 1:
            axes[-1].set_xlim(log["t_s"][0], log["t_s"][-1])
        axes[-1].set_xlabel("time [s]")
        drawn.align_ylabels(axes)
    return drawn


def _headline(summary: RunSummary) -> str:
    if summary.flying_s <= 0.0:
        flown = f"{summary.duration_s:.1f} s, never flown under control"
    else:
        rmse = f"tracking RMSE {1e3 * summary.tracking_rmse_m:.1f} mm"
        flown = f"{summary.flying_s:.1f} s under control, {rmse}, {summary.overruns} overruns"
    if summary.failsafe_s != summary.failsafe_s:
        return flown
    return f"{flown}\nFailsafe at {summary.failsafe_s:.2f} s: {_cause(summary)}"


def _cause(summary: RunSummary) -> str:
    return in_words(summary.failsafe_cause) or "no cause recorded"


def _height(axes: "Axes", log: RunLog) -> None:
    axes.set_title("Height")
    seen = log["range_repeats"] == 0 if log.has("range_repeats") else np.full(len(log), True)
    axes.plot(
        log["t_s"][seen], log["range_m"][seen], ".", color="#b5cde0", markersize=2.5, label="range"
    )
    _line(axes, log, "z_est_m", figures.MEASURED, "estimate")
    _line(axes, log, "z_ref_m", figures.REFERENCE, "reference", linestyle="--", linewidth=1.0)
    axes.set_ylabel("z [m]")
    highest = max([*_known(log, "z_ref_m"), *_known(log, "z_est_m"), 0.1])
    axes.set_ylim(-0.05, 1.2 * float(highest))  # outliers of the range may lie beyond
    _finish(axes)


def _error(axes: "Axes", log: RunLog) -> None:
    axes.set_title("Tracking error while flying")
    for name, colour, label in (
        ("z_est_m", figures.MEASURED, "estimate − reference"),
        ("true_z_m", figures.TRUE, "true − reference"),
    ):
        if log.has(name) and log.has("z_ref_m") and log.flying.any():
            error_mm = np.where(log.flying, 1e3 * (log[name] - log["z_ref_m"]), np.nan)
            axes.plot(log["t_s"], error_mm, color=colour, label=label)
    axes.set_ylabel("error [mm]")
    _finish(axes, _LEAST_ERROR_MM, "not recorded" if log.flying.any() else "never flown")
    axes.axhline(0.0, color=figures.REFERENCE, linewidth=0.6, zorder=1.5)


def _force(axes: "Axes", log: RunLog) -> None:
    axes.set_title("Wake force on the sufferer")
    _line(axes, log, "true_wake_force_n", figures.TRUE, "true")
    lead_s = _lead(log)
    label = f"predicted, shown at t + {1e3 * lead_s:.0f} ms" if lead_s else "predicted"
    if log.has("force_pred_n"):
        axes.plot(log["t_s"] + lead_s, log["force_pred_n"], color=figures.PREDICTED, label=label)
    if log.has("feedforward_n") and np.nanmax(np.abs(log["feedforward_n"])) > 0.0:
        axes.plot(
            log["t_s"] + lead_s,
            -log["feedforward_n"],
            color=figures.REFERENCE,  # often on the predicted line, and still to be seen
            linewidth=1.2,
            linestyle=":",
            label="compensated",
        )
    axes.set_ylabel("F [N]")
    _finish(axes, _LEAST_FORCE_N)


def _commands(axes: "Axes", log: RunLog) -> None:
    axes.set_title("Commands (thin: as applied) and carriage")
    for motor, colour in (("source", figures.SOURCE), ("sufferer", figures.SUFFERER)):
        _line(axes, log, f"{motor}_cmd_us", colour, motor)
        _line(axes, log, f"{motor}_applied_us", figures.REFERENCE, None, linewidth=0.4, alpha=0.7)
    axes.set_ylabel("pulse [µs]")
    handles = axes.get_legend_handles_labels()[0]
    if log.has("x_m"):
        beside = axes.twinx()
        beside.grid(False)
        beside.spines["right"].set_visible(True)
        _line(beside, log, "x_m", figures.TRUE, "carriage x", linewidth=0.8)
        beside.set_ylabel("x [m]")
        _at_least(beside, _LEAST_X_M)
        handles = [*handles, *beside.get_legend_handles_labels()[0]]
    _finish(axes, _LEAST_PULSE_US, handles=handles)


def _timing(axes: "Axes", log: RunLog, summary: RunSummary) -> None:
    computing_s = np.sum([log[stage] for stage in STAGES], axis=0)
    is_simulated = log.metadata.get("simulated") == "true"
    missing = "not measured in simulated time" if is_simulated else "not recorded"
    is_timed = bool(np.isfinite(computing_s).any())
    untimed = f"Round trip (computing: {missing})"
    axes.set_title("Round trip, and computing per tick" if is_timed else untimed)
    for values, colour, label, spread in (
        (log["round_trip_s"], figures.MEASURED, "round trip", summary.round_trip_s),
        (computing_s, figures.PREDICTED, "computing", summary.computing_s),
    ):
        if np.isfinite(values).any():
            shown = f"{label}, p99 {1e3 * spread.p99:.2f} ms"
            axes.plot(log["t_s"], 1e3 * values, ".", markersize=2.0, color=colour, label=shown)
    if axes.lines:
        period_ms = 1e3 / log.rate_hz
        axes.axhline(period_ms, color=figures.LIMIT, linestyle="--", label="period")
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, _LEAST_TIMING_MS), max(high, 1.4 * period_ms))
        figures.plain_log(axes)
    axes.set_ylabel("[ms]")
    _finish(axes)


def _line(
    axes: "Axes", log: RunLog, name: str, colour: str, label: str | None, **style: Any
) -> None:
    if log.has(name):
        axes.plot(log["t_s"], log[name], color=colour, label=label, **style)


def _finish(axes: "Axes", least: float = 0.0, empty: str = "not recorded", **legend: Any) -> None:
    """A legend and an axis of a `least` span; without any data the words for that."""
    if axes.lines:
        figures.legend(axes, **legend)
        _at_least(axes, least)
        return
    axes.set_yticks([])
    axes.text(0.5, 0.5, empty, transform=axes.transAxes, ha="center", va="center")


def _at_least(axes: "Axes", span: float) -> None:
    """Widen the axis about its middle where it spans less."""
    low, high = axes.get_ylim()
    if high - low < span:
        middle = 0.5 * (low + high)
        axes.set_ylim(middle - 0.5 * span, middle + 0.5 * span)


def _mark_failsafe(panels: "Sequence[Axes]", log: RunLog, summary: RunSummary) -> None:
    """A line through all panels where the failsafe began; above, beside it, why."""
    at_s = summary.failsafe_s
    if at_s != at_s:
        return
    for panel in panels:
        panel.axvline(at_s, color=figures.FAULT, linewidth=1.2, zorder=4)
    late = at_s - log["t_s"][0] > 0.5 * (log["t_s"][-1] - log["t_s"][0])
    panels[0].annotate(
        f"{at_s:.2f} s: {_cause(summary)}",
        (at_s, 0.05),
        xycoords=panels[0].get_xaxis_transform(),
        xytext=(-5 if late else 5, 0),
        textcoords="offset points",
        ha="right" if late else "left",
        color=figures.FAULT,
        fontsize=8.5,
        bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1.5},
        zorder=5,
    )


def _shade_modes(axes: "Axes", log: RunLog) -> None:
    """Shade every stretch of one mode, and name it where there is room, upright if it is narrow."""
    if not len(log):
        return
    changes = np.flatnonzero(log["mode"][1:] != log["mode"][:-1]) + 1
    ends = [*log["t_s"][changes], log["t_s"][-1]]
    starts = [log["t_s"][0], *log["t_s"][changes]]
    for start, end, at in zip(starts, ends, [0, *changes], strict=True):
        mode = log["mode"][at]
        axes.axvspan(start, end, color=figures.MODE_SHADES[mode], zorder=0, linewidth=0)
        share = (end - start) / (log["t_s"][-1] - log["t_s"][0]) if end > start else 0.0
        named = share > _LEAST_NAMED
        if named and axes.get_subplotspec().is_first_row():  # type: ignore[union-attr]
            axes.text(
                0.5 * (start + end),
                0.985,
                mode,
                transform=axes.get_xaxis_transform(),
                ha="center",
                va="top",
                rotation=0 if share > _LEAST_ACROSS else 90,
                fontsize=7,
                color="#777777",
            )


def _lead(log: RunLog) -> float:
    try:
        return float(log.metadata.get("lead_s") or log.metadata.get("lead_oracle_s") or 0.0)
    except ValueError:
        return 0.0


def _known(log: RunLog, name: str) -> npt.NDArray[np.float64]:
    values = log[name]
    return np.asarray(values[np.isfinite(values)])
