"""What a run predicts, as a figure: its test episode in which the forces change most.

In: a run's configuration, its predictor, and a set. Out: a matplotlib figure. Predicting takes
nothing from torch's random numbers.
"""

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from trainers.model import Predictor
from trainers.training.predict import predict
from trainers.training.runs import RunConfig
from trainers.training.tape import lay_tape
from trainers.training.targets import shift_ahead
from wakedeploy.core import figures
from wakedeploy.core.episodes import Episode, EpisodeSet
from wakedeploy.core.manifest import Quantity, Scores

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN_SAMPLES = 1_000  # of an episode; more are a block of ink

Floats = npt.NDArray[np.float64]


def draw_prediction(
    title: str,
    config: RunConfig,
    predictor: Predictor,
    data: EpisodeSet,
    test: Scores | None = None,
) -> "Figure":
    """The liveliest test episode: each force as it was and as predicted, and the difference.

    `test` are the errors over the whole split; they stand beside those of what is shown.
    """
    shown = _shown(config, predictor, data)
    ahead = f"predicted {config.lead_s:g} s ahead" if config.lead_s else "no lead"
    with figures.style():
        count = len(config.force)
        drawn, axes = figures.figure(
            2 * count, size=(9.6, 0.9 + 3.3 * count), sharex=True, squeeze=False,
            height_ratios=[2, 1] * count,
        )  # fmt: skip
        drawn.suptitle(f"{title}: test episode {shown.episode}, {ahead}",
                       fontweight="bold", x=0.008, ha="left")  # fmt: skip
        for at, channel in enumerate(config.force):
            _forces(axes[2 * at, 0], shown, at, channel, test)
            _residual(axes[2 * at + 1, 0], shown, at, channel)
        axes[-1, 0].set_xlabel("time of the force, in the episode [s]")
        axes[-1, 0].set_xlim(shown.time_s[0], shown.time_s[-1] + 1.0 / data.rate_hz)
        drawn.align_ylabels(axes[:, 0])
    return drawn


@dataclass(frozen=True, eq=False)
class _Shown:
    """Scored samples of an episode: times (M,), forces (M, o) as they were and as predicted."""

    episode: str
    time_s: Floats
    true: Floats
    predicted: Floats


def _shown(config: RunConfig, predictor: Predictor, data: EpisodeSet) -> _Shown:
    episode, part = _liveliest(data, config.lead_s, config.warm_up_steps)
    only = dataclasses.replace(data, episodes=(episode,), split={episode.name: "test"})
    tape = lay_tape(only, "test", config.lead_s, config.warm_up_steps)
    forces = (tape.force, predict(predictor, tape))
    true, predicted = (force[tape.scored].double().numpy()[part] for force in forces)
    first = config.warm_up_steps + part.start
    time_s = (first + np.arange(len(true))) / data.rate_hz + config.lead_s
    return _Shown(episode.name, time_s, true, predicted)


def title_of(config: RunConfig) -> str:
    """What a run is called in its pictures."""
    return f"{config.arch} s{config.seed} on {config.domain}"


def _liveliest(data: EpisodeSet, lead_s: float, warm_up: int) -> tuple[Episode, slice]:
    """The test episode, and the part of its scored samples, over which the forces change most.

    The same for every run on a set with one lead and warm-up, so that their pictures compare.
    """
    episodes = data.part("test")
    scored = [shift_ahead(e.force, lead_s, data.rate_hz)[warm_up:].astype(float) for e in episodes]
    every = np.concatenate(scored)  # (N, o)
    spread = np.where(every.std(0) > 0.0, every.std(0), 1.0)  # (o,)
    stretches = [
        (*_stretch((forces - every.mean(0)) / spread), episode)
        for forces, episode in zip(scored, episodes, strict=True)
        if len(forces)
    ]
    _, part, episode = max(stretches, key=lambda stretch: stretch[0])
    return episode, part


def _stretch(forces: Floats) -> tuple[float, slice]:
    """How much forces (M, o) change over the samples shown, and which those are."""
    count = min(len(forces), _SHOWN_SAMPLES)
    sums, squares = (
        np.concatenate([np.zeros((1, forces.shape[1])), values.cumsum(0)])
        for values in (forces, forces**2)
    )  # (M + 1, o)
    moved = squares[count:] - squares[:-count] - (sums[count:] - sums[:-count]) ** 2 / count
    changes = moved.sum(1)  # (M + 1 − count,)
    start = int(changes.argmax())
    return float(changes[start]), slice(start, start + count)


def _forces(axes: "Axes", shown: _Shown, at: int, channel: Quantity, test: Scores | None) -> None:
    axes.plot(shown.time_s, shown.true[:, at], color=figures.TRUE, label="true")
    axes.plot(shown.time_s, shown.predicted[:, at], color=figures.PREDICTED, label="predicted")
    axes.set(title=_error_title(shown, at, channel, test), ylabel=f"[{channel.unit}]")
    figures.legend(axes)


def _residual(axes: "Axes", shown: _Shown, at: int, channel: Quantity) -> None:
    axes.axhline(0.0, color=figures.REFERENCE, linewidth=0.6)
    error = shown.predicted[:, at] - shown.true[:, at]
    axes.plot(shown.time_s, error, color=figures.MEASURED)
    axes.set_ylabel(f"predicted − true [{channel.unit}]", fontsize=7)


def _error_title(shown: _Shown, at: int, channel: Quantity, test: Scores | None) -> str:
    """The error over what is shown and, where it is known, over the whole split."""
    rmse = float(np.sqrt(np.mean((shown.predicted[:, at] - shown.true[:, at]) ** 2)))
    here = f"{channel.name}: RMSE {rmse:.3g} {channel.unit} here"
    if test is None:
        return here
    r2 = test.r2[channel.name]
    label = f"{here}, {test.rmse[channel.name]:.3g} {channel.unit} over all test episodes"
    return label if r2 is None else f"{label} (R² {r2:.3f})"
