"""Where a baseline and the measurement disagree: whitened innovations against coordinates.

In: a fitted `ResponseModel`. Out: places with their size and a q value. Signs of whole blocks,
longer than the noise's correlation, are permuted within the hypothesis that nothing is there
(Nichols and Holmes, Human Brain Mapping 15, 2002); Benjamini and Hochberg's rule over all bins.
"""

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from wakedeploy.gap.evidence.inference import Fit, FloatArray
from wakedeploy.gap.search.places import q_values
from wakedeploy.gap.systems.response import ResponseModel

BINS = 6
FLIPS = 999
LAGS = 10
SIGNIFICANT = 0.05
_FEWEST = 12  # samples of a bin
_CORRELATIONS = 5.0  # times the noise's time constant: how long a block is


@dataclass(frozen=True)
class Place:
    """One range of a coordinate; `residual` is the mean disagreement there."""

    channel: str
    coordinate: str
    coordinate_unit: str
    low: float
    high: float
    residual: float
    unit: str
    q_value: float


def find_places(model: ResponseModel, fitted: Fit, seed: int = 0) -> list[Place]:
    """Places where the mean residual is not zero, most certain and largest first."""
    found = []
    for channel, (name, unit) in enumerate(model.channels):
        residuals, white = _rows(model, fitted, channel)
        block = _blocks(model, fitted, channel)
        residual, innovation = np.concatenate(residuals), np.concatenate(white)
        for coordinate, (coordinate_unit, at) in _joined(model, fitted).items():
            for low, high, inside in ranges(at):
                p_value = _p_value(innovation[inside], block[inside], seed)
                size = float(residual[inside].mean())
                place = Place(name, coordinate, coordinate_unit, low, high, size, unit, p_value)
                found.append(place)
    return _controlled(found)


def whiteness(model: ResponseModel, fitted: Fit) -> dict[str, Any]:
    """The test of Box and Pierce (J. Am. Stat. Assoc. 65, 1970), channel by channel."""
    statistic, freedom = 0.0, 0
    correlations = []
    for channel in range(len(model.channels)):
        _, white = _rows(model, fitted, channel)
        total = sum(float(w @ w) for w in white)
        count = sum(len(w) for w in white)
        row = [sum(float(w[k:] @ w[:-k]) for w in white) / total for k in range(1, LAGS + 1)]
        statistic += count * sum(r * r for r in row)
        freedom += LAGS
        correlations.append(row)
    p_value = float(chi2.sf(statistic, freedom))
    return {
        "p_value": p_value,
        "statistic": statistic,
        "passes": p_value > SIGNIFICANT,
        "samples": count,
        "lags": list(range(1, LAGS + 1)),
        "autocorrelation": correlations,
    }


def ranges(at: FloatArray) -> list[tuple[float, float, FloatArray]]:
    """Up to six ranges with as many samples each: lowest, highest and which samples."""
    edges = np.unique(np.quantile(at, np.linspace(0.0, 1.0, BINS + 1)))
    result = []
    for low, high in itertools.pairwise(edges):
        inside = (at >= low) & ((at < high) | (high == edges[-1]))
        if inside.sum() >= _FEWEST:
            result.append((float(low), float(high), inside))
    return result


def _rows(
    model: ResponseModel, fitted: Fit, channel: int
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Raw residuals and whitened innovations of a channel, one array per episode."""
    values = model.values(fitted.hypothesis, fitted.theta)
    residuals, white = [], []
    for episode, score in zip(fitted.episodes, fitted.slopes.scores, strict=True):
        record = model.records[episode]
        n = len(record.time_s)
        residuals.append(model.disagreement(values, episode)[channel])
        white.append(score.white[channel * n : (channel + 1) * n])
    return residuals, white


def _joined(model: ResponseModel, fitted: Fit) -> dict[str, tuple[str, FloatArray]]:
    each = [model.coordinates(e) for e in fitted.episodes]
    return {
        name: (unit, np.concatenate([c[name][1] for c in each]))
        for name, (unit, _) in each[0].items()
    }


def _blocks(model: ResponseModel, fitted: Fit, channel: int) -> FloatArray:
    """The number of each sample's block: several correlation times long, within one episode."""
    length_s = _CORRELATIONS * model.noise_time_s(fitted, channel)
    numbers, first = [], 0.0
    for episode in fitted.episodes:
        time_s = model.records[episode].time_s
        own = np.floor((time_s - time_s[0]) / length_s)
        numbers.append(first + own)
        first += own[-1] + 1.0
    return np.concatenate(numbers)


def _p_value(white: FloatArray, block: FloatArray, seed: int) -> float:
    """How often the sum is as large when each block has a random sign."""
    _, place = np.unique(block, return_inverse=True)
    sums = np.bincount(place, weights=white)
    signs = np.random.default_rng(seed).choice((-1.0, 1.0), (FLIPS, len(sums)))
    beaten = np.abs(signs @ sums) >= abs(sums.sum())
    return float((1 + beaten.sum()) / (1 + FLIPS))


def _controlled(places: list[Place]) -> list[Place]:
    """Those that survive false-discovery control, with q in place of p."""
    kept = [
        replace(place, q_value=q)
        for place, q in zip(places, q_values([p.q_value for p in places]), strict=True)
        if q < SIGNIFICANT
    ]
    return sorted(kept, key=lambda p: (p.q_value, -abs(p.residual)))
