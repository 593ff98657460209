"""When a range sensor repeats itself, and how old its readings are then.

In: the samples' time stamps, which readings equal the one before, and how often the sensor makes a
new one. Out: for each sample how probably it repeats the last reading, and how old its reading is.

A sensor that makes a reading every `hold_s`, by a clock of its own, shows its clock's phase by what
it repeats: a hidden Markov model whose state is a reading's age, forwards and backwards. Some
readings equal the last by chance.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from wakedeploy.physics.series import compiled

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

CHANCE = 0.07  # of two fresh readings being equal: 1 mm steps in 4 mm of noise
_BINS = 24  # of the age
_SURE = 0.995  # no repeat is more certain
_PERIODS_S = np.arange(0.01, 0.1205, 0.001)
_FINER = np.linspace(-0.001, 0.001, 21)
_WANDER_S = 0.002  # by which the two clocks' phase may move from sample to sample


class Held(NamedTuple):
    """What the samples are, (n,) each.

    `probability` that one repeats the last reading, as those before it tell; `age_s` of its
    reading, as all of them tell, and that age's variance [s²].
    """

    probability: FloatArray
    age_s: FloatArray
    age_variance_s2: FloatArray


def not_held(count: int) -> Held:
    """What a sensor does whose every sample is a new reading."""
    nothing = np.zeros(count)
    return Held(nothing, nothing, nothing)


def held(sample_s: FloatArray, repeated: BoolArray, hold_s: float) -> Held:
    """The pattern of samples (n,) at these times under a clock of period `hold_s` [s]."""
    if hold_s <= 0.0:
        return not_held(len(sample_s))
    reach = 4
    wander = np.arange(-reach, reach + 1) * hold_s / _BINS / _WANDER_S
    kernel = np.exp(-0.5 * wander**2)
    kernel /= kernel.sum()
    told = _ages(np.diff(sample_s), repeated, hold_s, CHANCE, _BINS, kernel)
    return Held(np.minimum(told[0], _SURE), told[1], told[2])


def likely_period_s(
    samples: Sequence[tuple[FloatArray, BoolArray]],
) -> float:
    """The clock's period [s] that the repeats of some flights are likeliest under.

    `samples` are time stamps (n,) and repeats (n,) of each flight. What repeats shows the period
    to a tenth of a millisecond, and is jagged in it: no climb would find it from far away.
    """

    def evidence(hold_s: float) -> float:
        total = 0.0
        for sample_s, repeated in samples:
            share = held(sample_s, repeated, hold_s).probability
            equal = share + (1.0 - share) * CHANCE
            total += float(np.log(np.where(repeated, equal, 1.0 - equal)).sum())
        return total

    best = max(_PERIODS_S, key=evidence)
    return float(max(best + _FINER, key=evidence))


@compiled
def _ages(
    between_s: FloatArray,  # (n - 1,)
    repeated: BoolArray,  # (n,)
    hold_s: float,
    chance: float,
    bins: int,
    kernel: FloatArray,  # (2 r + 1,) of the phase's wandering, in bins
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Forward and backward passes over a reading's age, in `bins` of `hold_s`.

    Between samples the age grows; where it passes `hold_s`, the reading is new. A new one equals
    the last with probability `chance`. Returns per sample (n,) the probability of a repeat as told
    by those before, the mean age [s] and its variance [s²] as told by all.
    """
    n = len(repeated)
    forward, backward = np.empty((n, bins)), np.ones(bins)
    probability, age, variance = np.zeros(n), np.empty(n), np.empty(n)
    at = (np.arange(bins) + 0.5) / bins * hold_s
    forward[0] = 1.0 / bins
    for k in range(1, n):
        wandered = _wandered(forward[k - 1], kernel)
        reached = np.zeros(bins)
        for b in range(bins):
            moved = b + between_s[k - 1] / hold_s * bins
            for half in range(2):
                end = int(moved) + half
                mass = wandered[b] * (1.0 - abs(moved - end))
                if end < bins:
                    probability[k] += mass
                reached[end % bins] += mass * _flagged(end < bins, repeated[k], chance)
        forward[k] = reached / reached.sum()
    for k in range(n - 1, -1, -1):
        both = forward[k] * backward / (forward[k] @ backward)
        age[k] = both @ at
        variance[k] = both @ (at - age[k]) ** 2
        before = np.zeros(bins)
        for b in range(bins):
            moved = b + between_s[max(k - 1, 0)] / hold_s * bins
            for half in range(2):
                end = int(moved) + half
                seen = _flagged(end < bins, repeated[k], chance)
                before[b] += (1.0 - abs(moved - end)) * seen * backward[end % bins]
        backward = _wandered(before / before.sum(), kernel)
    return probability, age, variance


@compiled
def _wandered(share: FloatArray, kernel: FloatArray) -> FloatArray:
    """Shares of a circle's bins, (n,), spread by a symmetric kernel (2 r + 1,)."""
    spread = np.zeros(len(share))
    for b in range(len(share)):
        for w in range(len(kernel)):
            spread[(b + w - len(kernel) // 2) % len(share)] += share[b] * kernel[w]
    return spread


@compiled
def _flagged(repeats: bool, seen_equal: bool, chance: float) -> float:
    """How likely a reading is (or is not) equal to the last, if it is (or is not) a repeat."""
    if repeats:
        return 1.0 if seen_equal else 1e-4
    return chance if seen_equal else 1.0 - chance
