"""How often an effect will be detected and named: outcomes of `name` drawn without flying.

In: an `Evidence` and a threshold. Out: shares of data sets, by the size of the effect and by the
number of flights. The draws repeat how `name` decides: every effect is fitted, gains count on
episodes left out, the best must cross the threshold, and all within 3 nats of it share its class.
Flights that are sealed to show the gap do not take part in naming.
"""

from dataclasses import dataclass

import numpy as np

from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.evidence.separation import Evidence, fitted_shares
from wakedeploy.gap.rules import RULES, sealed_count

DRAWS = 400
SMALLEST, LARGEST, SIZES = 0.03, 30.0, 31  # multiples of the size that was evaluated
MOST_FLIGHTS = 512.0
_FLIGHTS = 2.0 ** np.arange(1.0, np.log2(MOST_FLIGHTS) + 0.25, 0.5)


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Shares of data sets, arrays (G,): the effect found, named alone, or at least in the class."""

    detected: FloatArray
    named: FloatArray
    in_class: FloatArray


@dataclass(frozen=True, eq=False)
class Draws:
    """One amount of data with its noise drawn: `pulls` (n, c) of noise on every direction."""

    evidence: Evidence
    information: FloatArray
    pulls: FloatArray
    cost_nats: FloatArray  # (C,) what a fit seems to gain on its own data and loses on others
    near_nats: float  # rivals this close share the class
    enough: bool  # whether there are enough episodes for a name

    @classmethod
    def of(
        cls, evidence: Evidence, copies: float = 1.0, count: int = DRAWS, share: float = 1.0
    ) -> "Draws":
        """Draw `count` data sets of `copies` times the episodes, of which a `share` is fitted."""
        information = evidence.information(share * copies)
        value, vector = np.linalg.eigh(information)
        root = vector * np.sqrt(np.maximum(value, 0.0))
        noise = np.random.default_rng(0).standard_normal((count, len(value)))
        episodes = max(2.0, share * copies * len(evidence.gram))
        free = np.array([len(evidence.of(name)) for name in evidence.names])
        cost = free * (1.0 + 0.5 / (episodes - 1.0))  # of the fit, and of leaving each episode out
        enough = round(share * copies * len(evidence.gram)) >= RULES.fewest_flights
        return cls(evidence, information, noise @ root.T, cost, RULES.class_nats * share, enough)

    def gains(self, truth: FloatArray) -> FloatArray:
        """Held-out gain of every effect (n, C) when `truth` (c,) is what is missing [nats]."""
        pulls = self.pulls + self.information @ truth
        gains = []
        for name in self.evidence.names:
            places = self.evidence.of(name)
            block = self.information[np.ix_(places, places)]
            share = fitted_shares(block, pulls[:, places], self.evidence, places)
            bent = np.einsum("nk,kl,nl->n", share, block, share)
            gains.append(np.einsum("nk,nk->n", share, pulls[:, places]) - 0.5 * bent)
        return np.asarray(np.stack(gains, axis=1) - self.cost_nats)

    def outcomes(self, name: str, factors: FloatArray, threshold_nats: float) -> Outcomes:
        """The outcomes of an effect at these multiples of its evaluated size, (G,)."""
        index = self.evidence.names.index(name)
        counted = np.zeros((3, len(factors)))
        for g, factor in enumerate(factors):
            gains = self.gains(factor * self.evidence.whole[index])
            best = gains.max(axis=1)
            found = best > threshold_nats
            near = gains > best[:, None] - self.near_nats
            counted[0, g] = found.mean()
            alone = found & near[:, index] & (near.sum(axis=1) == 1)
            counted[1, g] = alone.mean() if self.enough else 0.0
            counted[2, g] = (found & near[:, index]).mean()
        return Outcomes(*counted)


def fitted_share(flights: float) -> float:
    """The share of `flights` flights that `close` fits to; the rest is sealed."""
    return 1.0 - sealed_count(round(flights)) / max(round(flights), 1)


def null_quantile(evidence: Evidence) -> float:
    """The gain that the best effect exceeds once in 20 times when nothing is missing.

    It uses the same Gaussian draws; `name`'s simulated threshold also contains what is not linear.
    """
    draws = Draws.of(evidence, count=4 * DRAWS)
    gains = draws.gains(np.zeros(len(evidence.columns)))
    return float(np.quantile(gains.max(axis=1), 0.95))


def smallest_sizes(draws: Draws, name: str, threshold_nats: float) -> tuple[float, float]:
    """The multiples of the evaluated size at which an effect is surely detected, and surely named.

    Infinite if even the largest size tried is not.
    """
    largest = min(LARGEST, draws.evidence.columns[draws.evidence.of(name)[0]].high)
    factors = np.geomspace(SMALLEST, largest, SIZES)
    outcomes = draws.outcomes(name, factors, threshold_nats)
    return _crossing(factors, outcomes.detected), _crossing(factors, outcomes.named)


def flights_needed(evidence: Evidence, name: str, threshold_nats: float) -> float:
    """How many flights surely name the effect at its evaluated size; infinite if none do."""
    named = [
        Draws.of(evidence, n / len(evidence.gram), DRAWS // 2, fitted_share(n))
        .outcomes(name, np.ones(1), threshold_nats)
        .named[0]
        for n in _FLIGHTS
    ]
    return _crossing(_FLIGHTS, np.array(named))


def _crossing(x: FloatArray, share: FloatArray) -> float:
    """Where a share that rises with x reaches `sure_share` for good, interpolated in log x."""
    below = np.flatnonzero(share < RULES.sure_share)
    if not below.size:
        return float(x[0])
    last = int(below[-1])
    if last + 1 == len(x):
        return float("inf")
    part = (RULES.sure_share - share[last]) / (share[last + 1] - share[last])
    return float(np.exp(np.log(x[last]) + part * np.log(x[last + 1] / x[last])))
