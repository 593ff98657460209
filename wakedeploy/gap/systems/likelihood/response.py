"""A response to known inputs, seen through coloured noise: the `Model` behind every other domain.

The noise of a channel is an Ornstein–Uhlenbeck process plus white noise. If an episode has levels
that nobody knows, they have a wide prior. The Cholesky factor of the noise's covariance
turns residuals into one-step innovations exactly, at any sampling times (Rasmussen and Williams,
Gaussian Processes for Machine Learning, 2006, algorithm 2.1), and outliers are weighted down.
"""

import abc
import copy
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.linalg import solve_triangular

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.fits import Fit, FloatArray, Free, Hypothesis, Score
from wakedeploy.gap.search.comparison import ComparisonDefaults, Record

Values = Mapping[str, float]

_SEALED_EVERY = 4
_OUTLIERS = 0.02  # share of samples
_NO_NOISE = -40.0  # logarithm of a standard deviation that is nothing
_OUTLIER_SPREAD = 6.0  # their standard deviation over that of the others


class ResponseModel(ComparisonDefaults, abc.ABC):
    """A domain: `records`, the `effects` by name, and the response that a hypothesis predicts.

    `channels` are names and units; each has noise parameters of its own, started from
    `noise_start` (sd of the coloured part, its time constant [s], sd of the white part).
    """

    name: str
    channels: tuple[tuple[str, str], ...]
    noise_start: tuple[tuple[float, float, float], ...]
    effects: Mapping[str, tuple[Free, ...]]
    records: Sequence[Record]
    noise_is_white = False

    @property
    def episodes(self) -> int:
        """How many episodes there are."""
        return len(self.records)

    def nuisances(self) -> tuple[Free, ...]:
        """What every hypothesis fits besides the noise."""
        return ()

    @abc.abstractmethod
    def response(self, values: Values, episode: int) -> FloatArray:
        """The channels (c, n) without noise; effects that are not in `values` do not act."""

    def levels(self, values: Values, episode: int) -> FloatArray | None:
        """Unknown levels of the episode as columns (n, k), scaled by their prior; None for none."""
        return None

    def residual(self, values: Values, episode: int) -> FloatArray:
        """What is shown as the error: the disagreement (c, m) where models can differ."""
        return self.disagreement(values, episode)

    def disagreement(self, values: Values, episode: int) -> FloatArray:
        """Measured less predicted (c, n)."""
        return self.records[episode].measured - self.response(values, episode)

    def disagreements(self, fitted: Fit, episodes: Sequence[int]) -> list[FloatArray]:
        """What is shown as the error (c, m) of each episode."""
        values = self.values(fitted.hypothesis, fitted.theta)
        return [self.residual(values, e) for e in episodes]

    @property
    def horizon(self) -> int:
        """A sixth of an episode: each sealed one is judged in three parts."""
        return max(min(len(r.time_s) for r in self.records) // 6, 1)

    def sealed(self) -> tuple[int, ...]:
        """Every fourth episode: recordings are in order of vehicle and manoeuvre."""
        return tuple(range(_SEALED_EVERY - 1, self.episodes, _SEALED_EVERY))

    def coordinates(self, episode: int) -> dict[str, tuple[str, FloatArray]]:
        """Where a sample lies: unit and values (n,) by name, for finding places."""
        time_s = self.records[episode].time_s
        return {"time": ("s", time_s - time_s[0])}

    def free(self, hypothesis: Hypothesis) -> tuple[Free, ...]:
        """Noise, nuisances, and the parameters of the named effects."""
        parameters = tuple(f for effect in hypothesis for f in self.effects[effect])
        return (*self._noise(), *self.nuisances(), *parameters)

    def score(self, hypothesis: Hypothesis, theta: FloatArray, episode: int) -> Score:
        """Innovations of every channel, one channel after another."""
        values = self.values(hypothesis, theta)
        record = self.records[episode]
        residual = record.measured - self.response(values, episode)
        levels = self.levels(values, episode)
        parts = []
        for channel in range(len(self.channels)):
            factor = self._factor(values, episode, channel, levels)
            parts.append(scored(residual[channel], factor))
        n = len(record.time_s)
        channels = tuple(slice(c * n, (c + 1) * n) for c in range(len(parts)))
        density, innovation, variance, weight = (
            np.concatenate(column) for column in zip(*parts, strict=True)
        )
        return Score(density, innovation, variance, weight, channels)

    def unweighted(self) -> "ResponseModel":
        """The same episodes with white noise alone: a fit of them is a least-squares fit."""
        twin = copy.copy(self)
        twin.noise_is_white = True
        return twin

    def noise_time_s(self, fitted: Fit, channel: int) -> float:
        """How long a channel's noise stays the same [s]."""
        return float(np.exp(fitted.value(f"noise.{channel}.time")))

    def _factor(
        self, values: Values, episode: int, channel: int, levels: FloatArray | None
    ) -> FloatArray:
        coloured, decay, white = (
            values[f"noise.{channel}.{part}"] for part in ("coloured", "time", "white")
        )
        noise = (_NO_NOISE if self.noise_is_white else coloured, decay, white)
        time_s = self.records[episode].time_s
        if levels is None:
            return _cached_factor(noise, (time_s - time_s[0]).tobytes())
        return np.asarray(np.linalg.cholesky(covariance(noise, time_s) + levels @ levels.T))

    def _noise(self) -> tuple[Free, ...]:
        """Logarithms of the noise parameters, in their unit: they move by orders of magnitude."""
        return tuple(
            Free(f"noise.{c}.{part}", unit, float(np.log(start)), 2.0, *bounds, 0.01)
            for c, ((_, channel_unit), starts) in enumerate(
                zip(self.channels, self.noise_start, strict=True)
            )
            for part, unit, start, bounds in zip(
                ("coloured", "time", "white"),
                (channel_unit, "s", channel_unit),
                starts,
                ((-25.0, 25.0), (-6.0, 5.0), (-25.0, 25.0)),
                strict=True,
            )
        )


def covariance(noise: tuple[float, ...], time_s: FloatArray) -> FloatArray:
    """Covariance (n, n) of coloured and white noise, given ln of sd, time constant and white sd."""
    coloured, decay_s, white = np.exp(noise)
    apart_s = np.abs(time_s[:, None] - time_s[None, :])
    matrix = coloured**2 * np.exp(-apart_s / decay_s)
    matrix[np.diag_indices(len(time_s))] += white**2 + 1e-9 * coloured**2
    return np.asarray(matrix)


def scored(
    residual: FloatArray, factor: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Log densities, innovations, variances, inlier probabilities (n,) of a residual (n,)."""
    scale = np.diag(factor)
    white = solve_triangular(factor, residual, lower=True, check_finite=False)
    inlier = np.log1p(-_OUTLIERS) - 0.5 * white**2
    outlier = np.log(_OUTLIERS / _OUTLIER_SPREAD) - 0.5 * (white / _OUTLIER_SPREAD) ** 2
    both = np.logaddexp(inlier, outlier)
    log_density = both - np.log(scale) - 0.5 * np.log(2.0 * np.pi)
    return log_density, white * scale, scale**2, np.exp(inlier - both)


@functools.lru_cache(maxsize=512)
def _cached_factor(noise: tuple[float, ...], time_bytes: bytes) -> FloatArray:
    """The factor, shared by episodes that were sampled alike."""
    return np.asarray(np.linalg.cholesky(covariance(noise, np.frombuffer(time_bytes))))


def required(path: Path | None, domain: str) -> Path:
    """The path; raises UnusableInput for None."""
    if path is None:
        raise UnusableInput(
            f"{domain}: no path given; give the folder of its recordings, or set WAKEDEPLOY_DATA."
        )
    return path
