"""How a fit went: errors over epochs, or over the strengths of a solved readout's ridge.

In: losses as `metrics.json` keeps them. Out: a matplotlib figure. Errors are roots of losses, so 1
is what predicting the mean would cost.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from trainers.training.runs import RidgeErrors
from wakedeploy.core import figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ERROR = "error (1 = predicting the mean)"
_FEW = 30  # epochs
_WIDE = 2.0  # from this ratio of largest to smallest error the axis is logarithmic
_COLOURS = (figures.PREDICTED, figures.MEASURED, figures.TRUE, figures.SOURCE, figures.SUFFERER)

Losses = Sequence[float | None]


def draw_curves(
    title: str, validation: Losses, training: Losses, ridge: RidgeErrors | None = None
) -> "Figure | None":
    """Training and validation error, the best marked; None for a single point, which is no curve.

    `validation` and `training` are losses after each epoch, the latter of the last ones alone where
    there are fewer. A solved readout has no epochs: its `ridge` is drawn.
    """
    if ridge is not None:
        return _over_strengths(title, ridge)
    return _over_epochs(title, validation, training) if training or len(validation) > 1 else None


def _over_epochs(title: str, validation: Losses, training: Losses) -> "Figure":
    from matplotlib.ticker import MaxNLocator

    with figures.style():
        drawn, axes = figures.figure(size=(7.4, 3.8))
        epochs = range(1, len(validation) + 1)
        learned, held_out = _errors(training), _errors(validation)
        dots = "." if len(epochs) <= _FEW else ""  # a single epoch is no line
        if training:
            axes.plot(epochs[len(validation) - len(training) :], learned, marker=dots,
                      color=figures.MEASURED, label="training, while each epoch ran")  # fmt: skip
        axes.plot(epochs, held_out, marker=dots, color=figures.PREDICTED,
                  label="validation, after it")  # fmt: skip
        best = min(epochs, key=lambda epoch: held_out[epoch - 1])
        _mark(axes, best, held_out[best - 1], figures.PREDICTED)
        axes.axvline(best, color=figures.LIMIT, linestyle=":", zorder=1)
        axes.xaxis.set_major_locator(MaxNLocator("auto", integer=True, min_n_ticks=1))
        axes.set_xlim(0.5, len(epochs) + 0.5)
        label = f"best validation error {held_out[best - 1]:.4g} in epoch {best}"
        axes.set(xlabel="epoch", ylabel=_ERROR, title=f"{title}\n{label}")
        _scale(axes, [*learned, *held_out])
        figures.legend(axes)
    return drawn


def _over_strengths(title: str, ridge: RidgeErrors) -> "Figure":
    with figures.style():
        drawn, axes = figures.figure(size=(8.6, 3.8))
        errors: list[float] = []
        for at, (name, losses) in enumerate(ridge.validation.items()):
            colour = _COLOURS[at % len(_COLOURS)]
            learned, held_out = _errors(ridge.training[name]), _errors(losses)
            axes.plot(ridge.strengths, learned, color=colour, linestyle="--", linewidth=0.8,
                      label=f"{name}, training")  # fmt: skip
            axes.plot(ridge.strengths, held_out, color=colour, label=f"{name}, validation")
            best = _least(held_out)
            if best is not None:
                _mark(axes, ridge.strengths[best], held_out[best], colour)
            errors += [*learned, *held_out]
        axes.set_xscale("log")
        label = "solved, without epochs: the circle is the strength taken"
        axes.set(ylabel=_ERROR, title=f"{title}\n{label}")
        axes.set_xlabel("strength of the ridge, as a share of the activations' mean variance")
        _scale(axes, errors)
        figures.legend(axes, loc="upper left", bbox_to_anchor=(1.01, 1.0), ncols=1)
    return drawn


def _errors(losses: Losses) -> list[float]:
    """Roots of losses; NaN, which leaves a gap, for one that is not known."""
    return [math.nan if loss is None else math.sqrt(max(loss, 0.0)) for loss in losses]


def _least(errors: Sequence[float]) -> int | None:
    known = [at for at, error in enumerate(errors) if error == error]
    return min(known, key=lambda at: errors[at], default=None)


def _mark(axes: "Axes", x: float, y: float, colour: str) -> None:
    axes.plot([x], [y], "o", ms=7, mfc="none", color=colour, label="_best")


def _scale(axes: "Axes", errors: Sequence[float]) -> None:
    known = [error for error in errors if math.isfinite(error)]
    if known and min(known) > 0.0 and max(known) > _WIDE * min(known):
        figures.plain_log(axes)
