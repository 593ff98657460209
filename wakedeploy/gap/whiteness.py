"""Whether what a fit leaves over is white noise.

In: a fit. Out: the autocorrelation of its whitened innovations and a portmanteau statistic, pooled
over the flights (Ljung and Box 1978), and their spectrum.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.signal import periodogram
from scipy.stats import chi2

from wakedeploy.gap.inference import Fit, Score

FloatArray = npt.NDArray[np.float64]

LAGS = 16  # half a second of samples
_BANDS = 48
_TAIL = 3  # pseudo-samples that a score may end with: two rests, repeats


@dataclass(frozen=True, eq=False)
class Whiteness:
    """Autocorrelation (LAGS,) at lags 1…, the statistic over them and its nominal p value."""

    autocorrelation: FloatArray
    statistic: float
    p_value: float

    def as_json(self, limit: float) -> dict[str, Any]:
        """As the artefacts hold it; `limit` is what noise hardly ever exceeds."""
        return {
            "p_value": self.p_value,
            "statistic": self.statistic,
            "limit": limit,
            "passes": bool(self.statistic <= limit),
            "lags": list(range(1, LAGS + 1)),
            "autocorrelation": self.autocorrelation.tolist(),
        }


def whiteness(fitted: Fit) -> Whiteness:
    """Of the innovations that a fit leaves, all flights together."""
    white = [samples(score) for score in fitted.slopes.scores]
    products = np.array([[float(w[k:] @ w[: len(w) - k]) for k in range(LAGS + 1)] for w in white])
    total = products.sum(0)
    correlation = total[1:] / total[0]
    count = sum(len(w) for w in white)
    statistic = count * float((correlation**2).sum())
    return Whiteness(correlation, statistic, float(chi2.sf(statistic, LAGS)))


def samples(score: Score) -> FloatArray:
    """Whitened innovations of a flight's own samples, in order of time."""
    return score.white[:-_TAIL]


def spectrum(white: Sequence[FloatArray], rate_hz: float) -> dict[str, Any]:
    """Power density of whitened innovations over frequency, in bands, 1 for white noise.

    `low` and `high` bound 95 % of the bands of white noise.
    """
    frequency = np.linspace(0.0, 0.5 * rate_hz, _BANDS + 1)
    power, count = np.zeros(_BANDS), np.zeros(_BANDS)
    for w in white:
        f, p = periodogram(w - w.mean(), rate_hz)
        band = np.clip(np.digitize(f[1:], frequency) - 1, 0, _BANDS - 1)
        power += np.bincount(band, p[1:] * 0.5 * rate_hz, _BANDS)
        count += np.bincount(band, minlength=_BANDS)
    freedom = 2.0 * float(np.median(np.maximum(count, 1.0)))
    return {
        "frequency_hz": (0.5 * (frequency[1:] + frequency[:-1])).tolist(),
        "density": (power / np.maximum(count, 1.0)).tolist(),
        "low": float(chi2.ppf(0.025, freedom) / freedom),
        "high": float(chi2.ppf(0.975, freedom) / freedom),
    }
