"""A system and its recordings, as the search sees them: whatever a user or a domain provides.

A `Comparison` is a `Model` (parameters, likelihood) that also says what its channels and
coordinates are, which episodes are sealed, and what it predicts wrongly on them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from wakedeploy.gap.evidence.fits import Fit, FloatArray, Free, Hypothesis, Model
from wakedeploy.gap.search.artefacts import Leftover, Measured, Quantity
from wakedeploy.gap.search.places import Axes, Residuals

T = TypeVar("T")

_CORRELATIONS = 5.0  # times the noise's time constant: how long a block of residuals is


def searched_on(model: "Comparison") -> "Comparison":
    """The part of the recordings that a search looks at; the model itself if it names none."""
    return model.thinned()


def asked_far_ahead(model: "Comparison") -> "Comparison | None":
    """The model asked to predict far ahead instead of the next reading; None if it cannot be."""
    return model.far_ahead()


def theta_from(model: "Comparison", hypothesis: tuple[str, ...], *fits: Fit) -> FloatArray:
    """Parameters (p,) from the last of the fits that has each; neutral where none has."""
    known = {name: value for f in fits for name, value in zip(f.names, f.theta, strict=True)}
    return np.array([known.get(f.name, f.neutral) for f in model.free(hypothesis)])


def is_far_ahead(model: "Comparison") -> bool:
    """Whether a model predicts far ahead, so that a disturbance shows in many innovations."""
    return not model.is_pushed


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
        """The system's name."""
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

    # What only some models know; `ComparisonDefaults` has the answers of the others.
    is_pushed: bool

    def thinned(self) -> "Comparison":
        """The part of the recordings that a search looks at."""
        ...

    def far_ahead(self) -> "Comparison | None":
        """The same, asked to predict far ahead instead of the next reading; None if it cannot."""
        ...

    def log_of(self, episode: int) -> int:
        """Which log an episode was cut from."""
        ...

    def held(self, episodes: Sequence[int]) -> list[list[FloatArray]]:
        """Errors of forecasts without a model: for each such forecast a list of (c, m)."""
        ...

    def crossed_disagreements(
        self, fitted: Fit, thetas: FloatArray, sets: Sequence[int]
    ) -> list[FloatArray]:
        """The errors of a fit's episodes, each under the parameters (K, p) of its set."""
        ...

    def groups(self, names: Sequence[str]) -> list[list[str]]:
        """Effects in groups that one run can judge together."""
        ...

    def ports_alike(self, name: str) -> Sequence[str]:
        """The same kind of effect at other ports of the same role and unit."""
        ...

    def simpler_effects(self, name: str) -> Sequence[str]:
        """Effects at the same port that this one only elaborates."""
        ...

    def is_friction_law(self, name: str) -> bool:
        """Whether an effect is a finer law of the friction that a simpler one is."""
        ...

    def held_by_friction(self, hypothesis: Hypothesis) -> Sequence[str]:
        """Constant effects that a dry friction of a hypothesis may hold."""
        ...

    def unknown_constants(self) -> dict[str, Quantity]:
        """Constants that are not fitted, as the recordings say nothing of them; what is stated."""
        ...

    def inputs_answered(self, fitted: Fit, name: str) -> float:
        """What inputs do with an effect, as fitted, as a share of what they do without."""
        ...

    def leftovers(self, fitted: Fit) -> tuple[Leftover, ...]:
        """What still acts and nothing explains."""
        ...

    def late_inputs(self, base: Fit, found: Fit) -> dict[str, float]:
        """Inputs that come later than the outputs that they drive, and by how much [s].

        An input is left out if its outputs lead only while what was found is missing.
        """
        ...

    def late_by_a_row(self, found: Fit) -> list[str]:
        """Delays that may come from how rows were logged."""
        ...

    def shifted_inputs(self, found: Fit) -> dict[str, Measured]:
        """By how much inputs surely act later than their stamps [s], where no delay says so."""
        ...

    def curved_inputs(self, named: Sequence[str]) -> list[str]:
        """Inputs that act by a curve, where what was named may stand for a lag behind it."""
        ...

    def clock_s(self, fitted: Fit, parameter: str) -> float:
        """The part of a delay that its input's clock took [s], by the delay's full name; else 0."""
        ...


class ComparisonDefaults:
    """The answers of a comparison that knows nothing but its response and its noise."""

    is_pushed = True

    def thinned(self: T) -> T:
        """All recordings."""
        return self

    def far_ahead(self) -> Comparison | None:
        """It has one way to predict."""
        return None

    def values(self: Comparison, hypothesis: Hypothesis, theta: FloatArray) -> dict[str, float]:
        """Parameters by name."""
        names = (f.name for f in self.free(hypothesis))
        return dict(zip(names, map(float, theta), strict=True))

    def log_of(self, episode: int) -> int:
        """Each episode is a log."""
        return episode

    def held(self, episodes: Sequence[int]) -> list[list[FloatArray]]:
        """There is no forecast without a model."""
        return []

    def crossed_disagreements(
        self: Comparison, fitted: Fit, thetas: FloatArray, sets: Sequence[int]
    ) -> list[FloatArray]:
        """One episode after another."""
        return [
            self.disagreements(replace(fitted, theta=thetas[k]), [episode])[0]
            for episode, k in zip(fitted.episodes, sets, strict=True)
        ]

    def groups(self, names: Sequence[str]) -> list[list[str]]:
        """Each by itself."""
        return [[name] for name in names]

    def ports_alike(self, name: str) -> Sequence[str]:
        """There are no ports."""
        return ()

    def simpler_effects(self, name: str) -> Sequence[str]:
        """No effect elaborates another."""
        return ()

    def is_friction_law(self, name: str) -> bool:
        """No effect is."""
        return False

    def held_by_friction(self, hypothesis: Hypothesis) -> Sequence[str]:
        """No effect holds another."""
        return ()

    def unknown_constants(self) -> dict[str, Quantity]:
        """Each is known."""
        return {}

    def inputs_answered(self, fitted: Fit, name: str) -> float:
        """No effect says that it changes that."""
        return 1.0

    def leftovers(self, fitted: Fit) -> tuple[Leftover, ...]:
        """What acts beside the effects is noise."""
        return ()

    def late_inputs(self, base: Fit, found: Fit) -> dict[str, float]:
        """Inputs have no clock of their own."""
        return {}

    def late_by_a_row(self, found: Fit) -> list[str]:
        """Rows are as they were measured."""
        return []

    def shifted_inputs(self, found: Fit) -> dict[str, Measured]:
        """Inputs have no clock of their own."""
        return {}

    def curved_inputs(self, named: Sequence[str]) -> list[str]:
        """Effects act where a domain says."""
        return []

    def clock_s(self, fitted: Fit, parameter: str) -> float:
        """Inputs have no clock of their own."""
        return 0.0


def residual_series(
    model: Comparison, fitted: Fit, episodes: Sequence[int]
) -> tuple[dict[str, list[Residuals]], Axes]:
    """Residuals of every channel in some episodes, and the axes that they are over."""
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
    return [float(each) for each in np.sqrt(mean_squares(parts))]


def mean_squares(rows: FloatArray) -> FloatArray:
    """The mean square (c,) of each row (c, m), as far as it is known; NaN where nothing is."""
    with np.errstate(all="ignore"):  # a state that runs away leaves nothing, or too much
        return np.asarray(np.nansum(rows**2, axis=1) / np.sum(~np.isnan(rows), axis=1))
