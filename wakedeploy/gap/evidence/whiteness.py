"""Whether what a fit leaves over is white noise.

In: a fit. Out: the autocorrelation of its whitened innovations and a portmanteau statistic, pooled
over the flights (Box and Pierce, J. Am. Stat. Assoc. 65, 1970), and their spectrum.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.signal import periodogram
from scipy.stats import chi2

from wakedeploy.gap.evidence.fits import Fit, Score
from wakedeploy.gap.rules import RULES

FloatArray = npt.NDArray[np.float64]

LAGS = 16  # half a second of samples
REFERENCE_SAMPLES = 3200  # limits are stated for five flights of 20 s at 32 Hz
_BANDS = 48


@dataclass(frozen=True, eq=False)
class Whiteness:
    """Autocorrelation of each channel (C, LAGS) at lags 1…, the statistic, its nominal p value.

    `samples` is how many innovations of the last channel they come from, `counts` of each.
    """

    by_channel: FloatArray
    statistic: float
    p_value: float
    samples: int
    counts: tuple[int, ...] = ()

    @property
    def autocorrelation(self) -> FloatArray:
        """The mean over the channels (LAGS,)."""
        return np.asarray(self.by_channel.mean(0))

    @property
    def freedom(self) -> int:
        """The mean of the statistic for white noise."""
        return self.by_channel.size

    @property
    def at_reference(self) -> float:
        """The statistic to be expected with REFERENCE_SAMPLES samples."""
        excess = (self.statistic - self.freedom) * REFERENCE_SAMPLES / self.samples
        return self.freedom + excess

    def limit(self, of_reference: float | None = None) -> float:
        """The largest statistic that still passes; `of_reference` is that for REFERENCE_SAMPLES.

        The statistic of white noise does not depend on the number of samples; what a model always
        leaves (friction's fine structure, say) grows with it. Without `of_reference` the limit is
        that of white noise.
        """
        of_white_noise = float(chi2.ppf(RULES.white_quantile, self.freedom))
        if of_reference is None:
            return of_white_noise
        excess = (of_reference - self.freedom) * self.samples / REFERENCE_SAMPLES
        return max(self.freedom + excess, of_white_noise)

    def passes(self, of_reference: float | None = None) -> bool:
        """Whether the innovations are as white as the reference's, or as white noise."""
        return self.statistic <= self.limit(of_reference)

    def as_json(self, of_reference: float | None = None) -> dict[str, Any]:
        """As the artefacts hold it, with the limit for this number of samples."""
        content: dict[str, Any] = {
            "p_value": self.p_value,
            "statistic": self.statistic,
            "limit": self.limit(of_reference),
            "passes": self.passes(of_reference),
            "lags": list(range(1, LAGS + 1)),
            "autocorrelation": self.autocorrelation.tolist(),
        }
        if len(self.by_channel) > 1:
            content["by_channel"] = self.by_channel.tolist()
            content["counts"] = list(self.counts)
        return content | {"samples": self.samples}


def whiteness(fitted: Fit) -> Whiteness:
    """The whiteness of the innovations that a fit leaves: per channel, all episodes together.

    A sample that was not measured or not looked at is left out; the lags pass over it.
    """
    scores = [_seen(score) for score in fitted.slopes.scores]
    rows, counts, statistic = [], [], 0.0
    for white in zip(*scores, strict=True):  # one channel in every episode
        products = np.array(
            [[float(w[k:] @ w[: max(len(w) - k, 0)]) for k in range(LAGS + 1)] for w in white]
        )
        total = products.sum(0)
        rows.append(total[1:] / total[0])
        counts.append(sum(len(w) for w in white))
        statistic += counts[-1] * float((rows[-1] ** 2).sum())
    freedom = LAGS * len(rows)
    return Whiteness(
        np.array(rows), statistic, float(chi2.sf(statistic, freedom)), counts[-1], tuple(counts)
    )


def _seen(score: Score) -> list[FloatArray]:
    """The samples that have an innovation, channel by channel."""
    seen = score.log_density != 0.0
    return [white[seen[c]] for white, c in zip(samples(score), score.channels, strict=True)]


def samples(score: Score) -> list[FloatArray]:
    """Whitened innovations of an episode's own samples, channel by channel, in order of time."""
    return [score.white[channel] for channel in score.channels]


def spectrum(white: Sequence[FloatArray], rate_hz: float) -> dict[str, Any]:
    """Power density of whitened innovations by frequency band; 1 for white noise.

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
