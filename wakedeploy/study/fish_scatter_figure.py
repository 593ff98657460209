"""The figure, the table and the sentence of the study of the fish's flag.

In: predictions of the test block by two models. Out: two scatters with the line of equality, and
below them five seconds of the block.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wakedeploy import figures
from wakedeploy.study.domains import MEMORYLESS, Line, by_predictor, held_out
from wakedeploy.study.fish_scatter import Shown
from wakedeploy.study.folder import Part
from wakedeploy.study.uncertainty import R2

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = ("predictor", "seed", "rmse_mm", "r2", "r2_low", "r2_high", "validation_loss")
_EXCERPT_S = 5.0  # from the middle of the block


def draw(shown: Sequence[Shown], rate_hz: float) -> "Figure":
    """Scatters above, the excerpt below."""
    colours = (figures.LIMIT, figures.PREDICTED)
    with figures.style():
        from matplotlib.figure import Figure

        drawn = Figure(figsize=(6.6, 5.6))
        axes = drawn.subplot_mosaic([["plain", "best"], ["time", "time"]], height_ratios=(2, 1))
        reach_mm = 1.05e3 * max(
            max(np.abs(one.true_m).max(), np.abs(one.predicted_m).max()) for one in shown
        )
        for name, one, colour in zip(("plain", "best"), shown, colours, strict=True):
            _scatter(axes[name], one, colour, reach_mm)
        axes["plain"].set_ylabel("predicted tip [mm]")
        _excerpt(axes["time"], shown, colours, rate_hz)
    return drawn


def _scatter(axes: "Axes", one: Shown, colour: str, reach_mm: float) -> None:
    axes.plot(1e3 * one.true_m, 1e3 * one.predicted_m, ".", color=colour, markersize=3)
    axes.axline((0.0, 0.0), slope=1.0, color=figures.REFERENCE, linewidth=0.8)
    axes.set_xlim(-reach_mm, reach_mm)
    axes.set_ylim(-reach_mm, reach_mm)
    axes.set_aspect("equal")
    axes.set_xlabel("true tip [mm]")
    axes.set_title(one.arch + (" (no memory)" if one.arch == MEMORYLESS else ""))
    axes.text(0.04, 0.95, f"R² {one.r2.text}", transform=axes.transAxes, va="top", fontsize=8)


def _excerpt(axes: "Axes", shown: Sequence[Shown], colours: Sequence[str], rate_hz: float) -> None:
    samples = len(shown[0].true_m)
    length = min(samples, round(_EXCERPT_S * rate_hz))
    part = slice((samples - length) // 2, (samples - length) // 2 + length)
    time_s = np.arange(length) / rate_hz
    axes.plot(time_s, 1e3 * shown[0].true_m[part], color=figures.REFERENCE, label="truth")
    for one, colour in zip(shown, colours, strict=True):
        axes.plot(time_s, 1e3 * one.predicted_m[part], color=colour, label=one.arch)
    axes.set_xlim(0.0, length / rate_hz)
    axes.set_xlabel("time in the middle of the test block [s]")
    axes.set_ylabel("tip [mm]")
    figures.legend(axes)


def sentence(shown: Sequence[Shown]) -> str:
    """What both models explain of the test block."""
    plain, best = shown
    apart = plain.r2.high is not None and best.r2.low is not None and plain.r2.high < best.r2.low
    return (
        f"Without memory {plain.arch} explains R² {plain.r2.text} of the flag tip's motion; "
        f"{best.arch}, the best memory on the validation block, {best.r2.text}; their 90 % "
        f"intervals {'lie apart' if apart else 'overlap or are unknown'}."
    )


def summary(lines: Sequence[Line]) -> tuple[list[str], list[list[str]]]:
    """One line per architecture: R² over the seeds, and of the first with its interval."""
    columns = ["predictor", "R², mean ± sd over seeds", "R², first seed, 90 %", "RMSE [mm]"]
    columns.append("loss on validation, mean")
    rows, losses = [], held_out(lines)
    for arch, own in by_predictor([line for line in lines if line.seed is not None]).items():
        tips = [line.channels[0] for line in own]
        values = [tip["r2"] for tip in tips]
        spread = f" ± {np.std(values, ddof=1):.3f}" if len(values) > 1 else ""
        first = R2(tips[0]["r2"], tips[0]["r2_low"], tips[0]["r2_high"])
        rows.append(
            [
                f"{arch} (no memory)" if arch == MEMORYLESS else arch,
                f"{np.mean(values):.3f}{spread}",
                first.text,
                f"{1e3 * np.mean([tip['rmse'] for tip in tips]):.2f}",
                f"{losses[arch]:.3f}",
            ]
        )
    return columns, rows


def parts(lines: Sequence[Line], shown: Sequence[Shown], rate_hz: float) -> list[Part]:
    """The figure with the table of all architectures, and the predictions that were drawn."""
    rows = [
        (
            line.predictor,
            line.seed,
            1e3 * line.channels[0]["rmse"],
            *(line.channels[0][name] for name in ("r2", "r2_low", "r2_high")),
            line.validation,
        )
        for line in lines
        if line.seed is not None
    ]
    return [
        Part(
            "fish-scatter",
            sentence(shown),
            COLUMNS,
            rows,
            draw(shown, rate_hz),
            summary(lines),
        )
    ]
