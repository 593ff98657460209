"""How much a quantity varies from flight to flight, and which flight is unlike the others.

In: one value per flight with its standard error. Out: the variation beyond these errors with its
interval (DerSimonian and Laird, Control. Clin. Trials 7, 1986; Viechtbauer, Stat. Med. 26, 2007),
and for each flight the probability that one so far from the others comes by chance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2
from scipy.stats import t as student_t

from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.gantry.rules import RULES

LEVEL = 0.9


@dataclass(frozen=True)
class Variation:
    """The standard deviation between flights, its 90 % interval, and the p-value of none."""

    sd: float
    low: float
    high: float
    p_value: float

    @property
    def is_sure(self) -> bool:
        """Whether the flights differ by more than their errors."""
        return self.p_value < RULES.variation_p


def variation(values: FloatArray, errors: FloatArray) -> Variation:
    """The variation of values (n,) with standard errors (n,); ValueError for fewer than three."""
    count = len(values)
    if count < 3:
        raise ValueError(f"{count} flights do not tell how much flights vary")
    weights = 1.0 / errors**2
    beyond = _scatter(values, errors, 0.0) - (count - 1)
    variance = max(beyond, 0.0) / float(weights.sum() - (weights**2).sum() / weights.sum())
    tail = 0.5 * (1.0 - LEVEL)
    low = _where(values, errors, float(chi2.isf(tail, count - 1)))
    high = _where(values, errors, float(chi2.isf(1.0 - tail, count - 1)))
    p_value = float(chi2.sf(_scatter(values, errors, 0.0), count - 1))
    return Variation(variance**0.5, low**0.5, high**0.5, p_value)


def _scatter(values: FloatArray, errors: FloatArray, variance: float) -> float:
    """The sum of squares around the weighted mean, if this were the variance between flights."""
    weights = 1.0 / (errors**2 + variance)
    mean = float(weights @ values / weights.sum())
    return float(weights @ (values - mean) ** 2)


def _where(values: FloatArray, errors: FloatArray, scatter: float) -> float:
    """The variance that gives this scatter; 0 if the scatter is less even without any."""
    if _scatter(values, errors, 0.0) <= scatter:
        return 0.0
    most = float(np.ptp(values)) ** 2 * len(values) + 1e-12
    while _scatter(values, errors, most) > scatter:
        most *= 10.0
    return float(brentq(lambda v: _scatter(values, errors, v) - scatter, 0.0, most))


@dataclass(frozen=True)
class Apart:
    """One flight against the others: how far away it is, and how often chance alone does that."""

    flight: int
    away: float
    p_value: float


def farthest(values: FloatArray, errors: FloatArray, tried: int) -> Apart:
    """The flight that is least like the others, (n,) each; `tried` comparisons are made in all.

    Each flight is left out and compared with what the others' scatter and its own error allow
    (Student, n − 2), with Bonferroni's correction for the number of comparisons.
    """
    each = [_apart(values, errors, flight, tried) for flight in range(len(values))]
    return min(each, key=lambda spread: spread.p_value)


def _apart(values: FloatArray, errors: FloatArray, flight: int, tried: int) -> Apart:
    others = np.delete(values, flight)
    count = len(others)
    # Others that by chance agree better than their errors allow are no measure.
    between = max(float(others.var(ddof=1)), float(np.mean(np.delete(errors, flight) ** 2)))
    away = float(values[flight] - others.mean())
    error = (between * (1.0 + 1.0 / count) + float(errors[flight]) ** 2) ** 0.5
    p_value = 2.0 * float(student_t.sf(abs(away) / error, count - 1))
    return Apart(flight, away, min(p_value * tried, 1.0))


def without(values: FloatArray, flights: Sequence[int]) -> FloatArray:
    """The values (n,) of all other flights."""
    return np.delete(values, list(flights))
