"""The figure, the tables and the sentence of the study of the fish's flag.

In: predictions of the test block by two models. Out: two scatters with the line of equality, below
them five seconds of the block; every point that is drawn, and the scores of all architectures.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wakedeploy.core import figures
from wakedeploy.study.claims import claims
from wakedeploy.study.colours import looks
from wakedeploy.study.domains import MEMORYLESS, Line, by_predictor, held_out, r2_over_seeds
from wakedeploy.study.fish_scatter import Shown
from wakedeploy.study.folder import Part
from wakedeploy.study.runs import choice
from wakedeploy.study.uncertainty import R2

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = ("predictor", "seed", "hyper", "time_s", "true_mm", "predicted_mm")
SCORES = ("predictor", "seed", "hyper", "rmse_mm", "r2", "r2_low", "r2_high", "validation_loss")
_EXCERPT_S = 5.0  # from the middle of the block


def draw(shown: Sequence[Shown], rate_hz: float) -> "Figure":
    """Scatters above, the excerpt below."""
    styles = looks([panel.arch for panel in shown])
    colours = [styles[panel.arch][0] for panel in shown]
    with figures.style():
        from matplotlib.figure import Figure

        drawn = Figure(figsize=(6.6, 5.6))
        axes = drawn.subplot_mosaic([["plain", "best"], ["time", "time"]], height_ratios=(2, 1))
        reach_mm = 1.05e3 * max(
            max(np.abs(panel.true_m).max(), np.abs(panel.predicted_m).max()) for panel in shown
        )
        for name, panel, colour in zip(("plain", "best"), shown, colours, strict=True):
            _scatter(axes[name], panel, colour, reach_mm)
        axes["plain"].set_ylabel("predicted tip [mm]")
        _excerpt(axes["time"], shown, colours, rate_hz)
    return drawn


def _scatter(axes: "Axes", panel: Shown, colour: str, reach_mm: float) -> None:
    axes.plot(1e3 * panel.true_m, 1e3 * panel.predicted_m, ".", color=colour, markersize=3)
    axes.axline((0.0, 0.0), slope=1.0, color=figures.REFERENCE, linewidth=0.8)
    axes.set_xlim(-reach_mm, reach_mm)
    axes.set_ylim(-reach_mm, reach_mm)
    axes.set_aspect("equal")
    axes.set_xlabel("true tip [mm]")
    axes.set_title(panel.arch + (" (no memory)" if panel.arch == MEMORYLESS else ""))
    axes.text(0.04, 0.95, f"R² {panel.r2.text}", transform=axes.transAxes, va="top", fontsize=8)


def _excerpt(axes: "Axes", shown: Sequence[Shown], colours: Sequence[str], rate_hz: float) -> None:
    samples = len(shown[0].true_m)
    length = min(samples, round(_EXCERPT_S * rate_hz))
    part = slice((samples - length) // 2, (samples - length) // 2 + length)
    time_s = np.arange(length) / rate_hz
    axes.plot(time_s, 1e3 * shown[0].true_m[part], color=figures.REFERENCE, label="truth")
    for panel, colour in zip(shown, colours, strict=True):
        axes.plot(time_s, 1e3 * panel.predicted_m[part], color=colour, label=panel.arch)
    axes.set_xlim(0.0, length / rate_hz)
    axes.set_xlabel("time in the middle of the test block [s]")
    axes.set_ylabel("tip [mm]")
    figures.legend(axes)


def sentence(shown: Sequence[Shown]) -> str:
    """What both models explain of the test block."""
    plain, best = shown
    return (
        f"Without memory {plain.arch} explains R² {plain.r2.text} of the flag tip's motion; "
        f"{best.arch}, the best memory on the validation block, {best.r2.text}; "
        f"{_apart(plain.r2, best.r2)}."
    )


def _apart(plain: R2, best: R2) -> str:
    """How the two intervals lie."""
    if plain.low is None or plain.high is None or best.low is None or best.high is None:
        return "the block is too short for intervals"
    if best.low > plain.high:
        return "its 90 % interval lies wholly above"
    if best.high < plain.low:
        return "its 90 % interval lies wholly below: memory harms"
    return "their 90 % intervals overlap"


def summary(lines: Sequence[Line]) -> tuple[list[str], list[list[str]]]:
    """One line per architecture: R² over the seeds, with the interval of its mean."""
    columns = ["predictor", "R², mean ± sd over seeds", "its mean, 90 %", "RMSE [mm]"]
    columns.append("loss on validation, mean")
    rows, losses = [], held_out(lines)
    for arch, runs in by_predictor([line for line in lines if line.seed is not None]).items():
        tips = [line.channels[0] for line in runs]
        values = [tip["r2"] for tip in tips]
        spread = f" ± {np.std(values, ddof=1):.3f}" if len(values) > 1 else ""
        rows.append(
            [
                f"{arch} (no memory)" if arch == MEMORYLESS else arch,
                f"{np.mean(values):.3f}{spread}",
                r2_over_seeds(runs, 0).text,
                f"{1e3 * np.mean([tip['rmse'] for tip in tips]):.2f}",
                f"{losses[arch]:.3f}",
            ]
        )
    return columns, rows


def parts(lines: Sequence[Line], shown: Sequence[Shown], rate_hz: float) -> list[Part]:
    """The figure with the points that it shows, then the table of all architectures."""
    points = [
        (panel.arch, panel.seed, panel.hyper, i / rate_hz, 1e3 * float(true_m), 1e3 * float(tip_m))
        for panel in shown
        for i, (true_m, tip_m) in enumerate(zip(panel.true_m, panel.predicted_m, strict=True))
    ]
    count = ["predictor", "samples"], [[panel.arch, f"{len(panel.true_m)}"] for panel in shown]
    scores = [
        (
            *(line.predictor, line.seed, line.hyper_text),
            1e3 * line.channels[0]["rmse"],
            *(line.channels[0][name] for name in ("r2", "r2_low", "r2_high")),
            line.validation,
        )
        for line in lines
        if line.seed is not None
    ]
    named = {line.predictor for line in lines}
    text = f"All architectures on the test block. {claims('fish', lines)}{choice(named)}"
    return [
        Part("fish-scatter", sentence(shown), COLUMNS, points, draw(shown, rate_hz), count),
        Part("fish-scatter-scores", text, SCORES, scores, shown=summary(lines)),
    ]
