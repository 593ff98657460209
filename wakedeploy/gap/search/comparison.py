"""A system and its recordings, as the search sees them: whatever a user or a domain provides.

A `Comparison` is a `Model` (parameters, likelihood) that also says what its channels and
coordinates are, which episodes are sealed, and what it predicts wrongly on them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wakedeploy.gap.evidence.fits import Fit, FloatArray, Free, Hypothesis, Model
from wakedeploy.gap.search.places import Axes, Residuals

_CORRELATIONS = 5.0  # times the noise's time constant: how long a block of residuals is


def searched_on(model: "Comparison") -> "Comparison":
    """The part of the recordings that a search looks at; the model itself, if it knows none."""
    thinned = getattr(model, "thinned", None)
    part: Comparison = model if thinned is None else thinned()
    return part


def asked_far_ahead(model: "Comparison") -> "Comparison | None":
    """The model asked to predict far ahead rather than the next reading, if it can be."""
    view: Callable[[], Comparison | None] | None = getattr(model, "far_ahead", None)
    return None if view is None else view()


def theta_from(model: "Comparison", hypothesis: tuple[str, ...], *fits: Fit) -> FloatArray:
    """Parameters (p,) as fits have them, the last of those that do; neutral where none does."""
    known = {name: value for f in fits for name, value in zip(f.names, f.theta, strict=True)}
    return np.array([known.get(f.name, f.neutral) for f in model.free(hypothesis)])


def is_far_ahead(model: "Comparison") -> bool:
    """Whether a model predicts far ahead, so that a disturbance shows in many innovations."""
    return not getattr(model, "is_pushed", True)


@dataclass(frozen=True, eq=False)
class Record:
    """What was measured in one episode: times (n,) [s] and channels (c, n)."""

    name: str
    time_s: FloatArray
    measured: FloatArray


class Comparison(Model, Protocol):
    """What is compared: channels, coordinates, effects, likelihood, prediction."""

    @property
    def name(self) -> str:
        """Of the system."""
        ...

    @property
    def channels(self) -> Sequence[tuple[str, str]]:
        """Names and units of what is measured."""
        ...

    @property
    def effects(self) -> Mapping[str, tuple[Free, ...]]:
        """The effects that the model may lack, with their parameters."""
        ...

    @property
    def records(self) -> Sequence[Record]:
        """The episodes."""
        ...

    @property
    def horizon(self) -> int:
        """Samples over which errors are alike."""
        ...

    def sealed(self) -> tuple[int, ...]:
        """The episodes to which nothing is fitted."""
        ...

    def values(self, hypothesis: Hypothesis, theta: FloatArray) -> dict[str, float]:
        """Parameters by name."""
        ...

    def disagreement(self, values: Mapping[str, float], episode: int) -> FloatArray:
        """Measured less predicted (c, n), 0 where nothing is predicted."""
        ...

    def disagreements(self, fitted: Fit, episodes: Sequence[int]) -> list[FloatArray]:
        """The errors that count, (c, m) for each episode, NaN where nothing is predicted."""
        ...

    def coordinates(self, episode: int) -> dict[str, tuple[str, FloatArray]]:
        """Where a sample lies: unit and values (n,) by name."""
        ...

    def noise_time_s(self, fitted: Fit, channel: int) -> float:
        """How long a channel's noise stays the same [s]."""
        ...


def residual_series(
    model: Comparison, fitted: Fit, episodes: Sequence[int]
) -> tuple[dict[str, list[Residuals]], Axes]:
    """Residuals of every channel in some episodes, and what they are over."""
    values = model.values(fitted.hypothesis, fitted.theta)
    residuals = [model.disagreement(values, e) for e in episodes]
    where = [model.coordinates(e) for e in episodes]
    series = {
        name: [
            Residuals(
                name, model.records[e].time_s, residual[c], {k: v for k, (_, v) in at.items()}
            )
            for e, residual, at in zip(episodes, residuals, where, strict=True)
        ]
        for c, (name, _) in enumerate(model.channels)
    }
    blocks = {
        name: _CORRELATIONS * model.noise_time_s(fitted, c)
        for c, (name, _) in enumerate(model.channels)
    }
    coordinates = {name: (unit, False) for name, (unit, _) in where[0].items()}
    return series, Axes(dict(model.channels), coordinates, blocks)


def errors(model: Comparison, fitted: Fit, episodes: Sequence[int]) -> list[float]:
    """Root mean square of measured less predicted, by channel."""
    parts = np.concatenate(model.disagreements(fitted, episodes), axis=1)
    return [float(np.sqrt(np.nanmean(row**2))) for row in parts]
