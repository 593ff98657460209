"""Figures that only a system's report has: an episode, autocorrelation, delay over frequency.

In: parts of a `Result`. Out: figures; None where there is nothing to draw.
"""

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.core import figures
from wakedeploy.gap.report.maps import AFTER, BEFORE, labelled
from wakedeploy.gap.search.artefacts import DelayProfile, PhaseDelay, Trace, WhitePair
from wakedeploy.gap.wording import FloatArray, numbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH_IN = 7.5
_HOLE = 3.0  # times the usual step
# A good model's line lies where the measured one does: both are to be seen.
_ON_TOP: dict[str, Any] = {"linewidth": 0.8, "linestyle": (0, (4, 2)), "zorder": 3}


def draw_trace(trace: Trace) -> "Figure | None":
    """Measured, and as the baseline and the corrected model have it, one panel per channel."""
    time_s = numbers(trace.time_s)
    if not len(time_s) or not trace.channels:
        return None
    drawn, grid = figures.figure(
        len(trace.channels),
        size=(_WIDTH_IN, 0.5 + 1.9 * len(trace.channels)),
        sharex=True,
        squeeze=False,
    )
    for axes, (name, course) in zip(grid[:, 0], trace.channels.items(), strict=True):
        for values, colour, label, style in (
            (course.measured, figures.REFERENCE, "measured", _ON_TOP),
            (course.before, BEFORE, "baseline", {}),
            (course.after, AFTER, "with what was found", {}),
        ):
            at_s, shown = _line(time_s, numbers(values))
            axes.plot(at_s, shown, color=colour, label=label, **style)
        axes.set_ylabel(labelled(name, course.unit))
    _legend(drawn, grid[0, 0])
    grid[-1, 0].set_xlabel(f"time in {episode_words(trace.episode)} [s]")
    return drawn


def episode_words(name: str) -> str:
    """An episode as a person reads it; a log is cut into numbered blocks."""
    block = re.fullmatch(r"(.+) (\d+)/(\d+)", name)
    return f"block {block[2]} of {block[3]} of {block[1]}" if block else name


def draw_autocorrelation(white: WhitePair, channels: Sequence[str]) -> "Figure | None":
    """The autocorrelation of the whitened innovations before and after, a panel per channel."""
    both = ((white.before, BEFORE, "baseline"), (white.after, AFTER, "with what was found"))
    if not channels or not all(len(innovations.rows) == len(channels) for innovations, *_ in both):
        return None
    drawn, grid = figures.figure(
        1, len(channels), size=(_WIDTH_IN, 2.4), sharey=True, squeeze=False
    )
    for row, (axes, channel) in enumerate(zip(grid[0], channels, strict=True)):
        for innovations, colour, label in both:
            axes.plot(
                innovations.lags,
                innovations.rows[row],
                "o-",
                color=colour,
                markersize=3,
                label=label,
            )
        half = 1.96 / math.sqrt(max(white.before.samples, 1))
        axes.axhspan(-half, half, color=figures.SUFFERER, alpha=0.25, linewidth=0)
        axes.axhline(0.0, color=figures.REFERENCE, linewidth=0.7, zorder=1.5)
        axes.set(xlabel="lag [samples]", title=channel)
    grid[0, 0].set_ylabel("autocorrelation")
    _legend(drawn, grid[0, 0])
    return drawn


def draw_delay_profile(profile: DelayProfile | None) -> "Figure | None":
    """Nats below the best delay, the best and the best elsewhere marked."""
    if profile is None:
        return None
    delay_s, nats = numbers(profile.delay_s), numbers(profile.nats)
    curve = _curve(delay_s, nats, 2.8)
    if curve is None:
        return None
    drawn, axes = curve
    best = int(np.argmax(nats))
    inner = np.arange(1, len(nats) - 1)
    summits = [int(k) for k in inner if nats[k] > nats[k - 1] and nats[k] > nats[k + 1]]
    for k in {best, *summits}:
        axes.annotate(f"{delay_s[k]:.3f} s", (delay_s[k], nats[k]), (4, 4),
                      textcoords="offset points", fontsize=8)  # fmt: skip
    axes.margins(y=0.12)
    axes.set(xlabel="transport delay [s]", ylabel="log likelihood [nats below the best]")
    return drawn


def draw_phase_delay(phase: PhaseDelay | None) -> "Figure | None":
    """Delay over frequency."""
    if phase is None:
        return None
    curve = _curve(numbers(phase.frequency_hz), numbers(phase.delay_s), 2.4)
    if curve is None:
        return None
    drawn, axes = curve
    axes.set(xlabel="frequency [Hz]", ylabel="phase delay [s]", ylim=(0.0, None))
    return drawn


def _curve(x: FloatArray, y: FloatArray, height_in: float) -> "tuple[Figure, Axes] | None":
    """One measured curve with its points; None if there are not enough of them."""
    if not len(x) == len(y) > 1:
        return None
    drawn, axes = figures.figure(size=(0.7 * _WIDTH_IN, height_in))
    axes.plot(x, y, "o-", color=figures.MEASURED, markersize=3)
    return drawn, axes


def _line(time_s: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What is drawn of a course: from reading to reading, also of a sensor that gives few.

    It breaks where none came for long: a line would claim what was not measured.
    """
    known = np.flatnonzero(np.isfinite(values))
    at_s, shown = time_s[known], values[known]
    if len(known) < 2:
        return at_s, shown
    steps_s = np.diff(at_s)
    breaks = 1 + np.flatnonzero(steps_s > _HOLE * np.median(steps_s))
    return np.insert(at_s, breaks, at_s[breaks]), np.insert(shown, breaks, np.nan)


def _legend(drawn: "Figure", axes: "Axes") -> None:
    """One for all panels, above them."""
    handles, labels = axes.get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside upper right", ncols=len(labels))
