"""When a range sensor repeats itself, and how old its readings are then.

In: the samples' time stamps, which readings equal the one before, and how often the sensor makes a
new one. Out: for each sample how probably it repeats the last reading, and how old its reading is.

A sensor that makes a reading every `hold_s`, by its own clock, shows the clock's phase by its
repeats: a hidden Markov model whose state is the phase, run forwards and backwards. Some readings
equal the last by chance.
"""

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from wakedeploy.physics.series import compiled

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

_LEAST_CHANCE, _MOST_CHANCE = 0.001, 0.5  # nothing is impossible, nothing certain
_BINS = 24  # of the phase, at least
_BIN_S = 0.002
_TO_NEIGHBOURS = 0.8  # a sampled Gaussian narrower than this would be too narrow
_SURE = 0.995  # no repeat is more certain
_PERIODS_S = np.arange(0.01, 0.3005, 0.001)
_FINER = np.linspace(-0.001, 0.001, 21)
_JITTER_S = 0.0015  # of either clock
_WANDER_S = 0.0004  # their phase may move this far from sample to sample
_FAR_S = 0.002
_RULED_OUT_NATS = 25.0
_ALIKE_NATS = 20.0  # a flight may decide between the two by where the readings lie


class Held(NamedTuple):
    """How the samples are held, (n,) each.

    `probability` that a sample repeats the last reading, given those before it; `age_s` of its
    reading, given all samples, and the variance of that age [s²]. `is_held`: whether any is.
    """

    probability: FloatArray
    age_s: FloatArray
    age_variance_s2: FloatArray
    is_held: bool


def not_held(count: int) -> Held:
    """The pattern of a sensor whose every sample is a new reading."""
    nothing = np.zeros(count)
    return Held(nothing, nothing, nothing, is_held=False)


def chance_of_equals(resolution_m: float, noise_m: float) -> float:
    """How often two fresh readings of a still height are equal, for a step and noise [m].

    Their difference is normal with √2 times the noise; for a narrow step its density at 0 counts.
    """
    if noise_m <= 0.0:
        return _MOST_CHANCE
    share = resolution_m / (2.0 * noise_m * math.sqrt(math.pi))
    return min(max(share, _LEAST_CHANCE), _MOST_CHANCE)


def held(
    sample_s: FloatArray,
    repeated: BoolArray,
    hold_s: float,
    chance: float,
    wander_s: float = _WANDER_S,
) -> Held:
    """The pattern of samples (n,) at these times under a clock of period `hold_s` [s].

    `chance` is how often two fresh readings are equal.
    """
    if hold_s <= 0.0:
        return not_held(len(sample_s))
    bins = _bins(hold_s)
    kernel = _wander(wander_s * bins / hold_s)
    repeats, age_s = _phases(sample_s, hold_s, bins, _JITTER_S)
    probability, forward = _forward(repeats, repeated, chance, kernel)
    age, variance = _ages(repeats, age_s, forward, repeated, chance, kernel)
    return Held(np.minimum(probability, _SURE), age, variance, is_held=True)


def _evidence(
    sample_s: FloatArray, repeated: BoolArray, hold_s: float, chance: float, wander_s: float
) -> float:
    """The log likelihood [nats] of one flight's repeats (n,) under a clock of this period."""
    bins = _bins(hold_s)
    repeats, _ = _phases(sample_s, hold_s, bins, _JITTER_S)
    share, _ = _forward(repeats, repeated, chance, _wander(wander_s * bins / hold_s))
    share = np.minimum(share, _SURE)
    equal = share + (1.0 - share) * chance
    return float(np.log(np.where(repeated, equal, 1.0 - equal)).sum())


def _bins(hold_s: float) -> int:
    return max(_BINS, round(hold_s / _BIN_S))


def _wander(deviation_bins: float) -> FloatArray:
    """A symmetric kernel (2 r + 1,) of this standard deviation, to the neighbours or farther."""
    if deviation_bins < _TO_NEIGHBOURS:
        share = 0.5 * deviation_bins**2
        return np.array([share, 1.0 - 2.0 * share, share])
    reach = round(4.0 * deviation_bins)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation_bins) ** 2)
    return np.asarray(kernel / kernel.sum())


def likely_periods_s(
    samples: Sequence[tuple[FloatArray, BoolArray]], chance: float
) -> tuple[float, ...]:
    """The clock's periods [s] under which the repeats of some flights are likeliest, best first.

    `samples` are time stamps (n,) and repeats (n,) of each flight. The repeats show the period to a
    tenth of a millisecond, but their likelihood is jagged in it: no climb would find it from far
    away. A phase that may wander far makes it smooth enough for a first look at every millisecond.
    There may be a second period: samples at a steady rate repeat almost alike under a clock and its
    mirror image about half that rate (39 and 41 ms for samples every 20 ms). Periods that the first
    flight all but rules out are not looked at in the others.
    """
    return _likely_periods_s(tuple((s.tobytes(), r.tobytes()) for s, r in samples), chance)


@functools.lru_cache(maxsize=16)  # a search asks again for each of its models of the same flights
def _likely_periods_s(flown: tuple[tuple[bytes, bytes], ...], chance: float) -> tuple[float, ...]:
    """`likely_periods_s` of time stamps and repeats as bytes."""
    samples = [(np.frombuffer(s), np.frombuffer(r, bool)) for s, r in flown]

    def evidence(hold_s: float, wander_s: float, flights: slice = slice(None)) -> float:
        return sum(_evidence(*sample, hold_s, chance, wander_s) for sample in samples[flights])

    first = np.array([evidence(period_s, _FAR_S, slice(1)) for period_s in _PERIODS_S])
    coarse = np.full(len(first), -np.inf)
    for place in np.flatnonzero(first > first.max() - _RULED_OUT_NATS).tolist():
        coarse[place] = first[place] + evidence(_PERIODS_S[place], _FAR_S, slice(1, None))
    found = []
    for k in _highest_two(coarse):
        finer = [(evidence(period_s, _WANDER_S), period_s) for period_s in _PERIODS_S[k] + _FINER]
        found.append(max(finer))
    found.sort(reverse=True)
    return tuple(float(period_s) for nats, period_s in found if nats > found[0][0] - _ALIKE_NATS)


def _highest_two(values: FloatArray) -> list[int]:
    """The places of the two highest summits of values (n,), the highest first."""
    before, after = np.append(-np.inf, values[:-1]), np.append(values[1:], -np.inf)
    summits = np.flatnonzero((values > before) & (values >= after))
    return [int(k) for k in summits[np.argsort(-values[summits])][:2]]


@compiled
def _phases(
    sample_s: FloatArray, hold_s: float, bins: int, jitter_s: float
) -> tuple[FloatArray, FloatArray]:
    """For each sample and phase of the sensor's clock: the chance of a repeat, and the age [s]."""
    n = len(sample_s)
    repeats, age_s = np.zeros((n, bins)), np.empty((n, bins))
    for k in range(n):
        into_s = sample_s[k] % hold_s
        for b in range(bins):
            age_s[k, b] = into_s - (b + 0.5) / bins * hold_s
            if age_s[k, b] < 0.0:
                age_s[k, b] += hold_s
            if k > 0:  # made before the last sample was taken, and none since
                older = (age_s[k, b] - (sample_s[k] - sample_s[k - 1])) / jitter_s
                due = (hold_s - age_s[k, b]) / jitter_s
                repeats[k, b] = _logistic(1.7 * min(older, due))
    return repeats, age_s


@compiled
def _forward(
    repeats: FloatArray,  # (n, b) as `_phases` has them
    repeated: BoolArray,  # (n,)
    chance: float,
    kernel: FloatArray,  # (2 r + 1,) of the phase's wandering, in bins
) -> tuple[FloatArray, FloatArray]:
    """The probability of a repeat given the samples before (n,), and the phase's (n, b)."""
    n, bins = repeats.shape
    probability, forward = np.zeros(n), np.empty((n, bins))
    forward[0] = 1.0 / bins
    for k in range(1, n):
        before = _wandered(forward[k - 1], kernel)
        probability[k] = before @ repeats[k]
        forward[k] = before * _seen(repeats[k], repeated[k], chance)
        forward[k] /= forward[k].sum()
    return probability, forward


@compiled
def _ages(
    repeats: FloatArray,  # (n, b)
    age_s: FloatArray,  # (n, b)
    forward: FloatArray,  # (n, b)
    repeated: BoolArray,  # (n,)
    chance: float,
    kernel: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Each sample's mean age [s] (n,) and its variance [s²] (n,), given all samples."""
    n, bins = repeats.shape
    age, variance, backward = np.empty(n), np.empty(n), np.ones(bins)
    for k in range(n - 1, -1, -1):
        both = forward[k] * backward / (forward[k] @ backward)
        age[k] = both @ age_s[k]
        variance[k] = both @ (age_s[k] - age[k]) ** 2
        backward = _wandered(backward * _seen(repeats[k], repeated[k], chance), kernel)
        backward /= backward.sum()
    return age, variance


@compiled
def _seen(repeats: FloatArray, equal: bool, chance: float) -> FloatArray:
    """The likelihood (b,), in each phase, of a reading that equals the last one (or does not)."""
    if equal:
        return repeats + (1.0 - repeats) * chance
    return (1.0 - repeats) * (1.0 - chance) + 1e-4


@compiled
def _wandered(share: FloatArray, kernel: FloatArray) -> FloatArray:
    """Shares of a circle's bins, (n,), spread by a symmetric kernel (2 r + 1,)."""
    bins, reach = len(share), len(kernel) // 2
    spread = np.zeros(bins)
    for w in range(len(kernel)):
        shift = (w - reach) % bins
        for b in range(bins - shift):
            spread[b + shift] += share[b] * kernel[w]
        for b in range(bins - shift, bins):
            spread[b + shift - bins] += share[b] * kernel[w]
    return spread


@compiled
def _logistic(x: float) -> float:
    """1 / (1 + exp(-x)), without the exponential where it would not matter."""
    if abs(x) > 30.0:
        return 1.0 if x > 0.0 else 0.0
    return 1.0 / (1.0 + math.exp(-x))
