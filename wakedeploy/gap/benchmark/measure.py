"""How strong a hidden effect is in the data that were flown: nats gained on flights left out.

In: a case's flights and its truth. Out: fits of the base, of the truth, and of any other effect,
all begun where the truth says, which the workflow cannot do.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wakedeploy.gap.benchmark.outside import OUTSIDE
from wakedeploy.gap.flight import Flight
from wakedeploy.gap.gantry import GantryModel
from wakedeploy.gap.inference import Fit, extended, fit, held_out
from wakedeploy.gap.ranking import rank
from wakedeploy.rig import Rig

Values = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class Strength:
    """What the truth gains over the rig file as it is, [nats], and its fit.

    `nats` is the gain on flights left out and what the calibration's priors gain besides: an effect
    on a calibrated constant shows in nothing but a constant far from its prior.
    """

    nats: float
    per_flight: tuple[float, ...]
    fit: Fit


class Measured:
    """The flights of one case under the judge's hypotheses."""

    def __init__(self, rig: Rig, flights: Sequence[Flight]) -> None:
        extra = {name: one.effect for name, one in OUTSIDE.items()}
        self._episodes = range(len(flights))
        model = GantryModel(rig, flights, extra)
        first = fit(model, (), self._episodes, model.start(()))
        self.model = model.relinearised(first)
        self.base = fit(self.model, (), self._episodes, first.theta)
        self._reference = held_out(self.model, self.base)

    def strength(self, truth: Values, outside: Mapping[str, float] | None = None) -> Strength:
        """The gain of all hidden effects together, fitted from their true values."""
        names = (*truth, *(outside or {}))
        free = self.model.free(names)
        known = {f"{name}.{k}": v for name, values in truth.items() for k, v in values.items()}
        start = extended(self.base, free)
        for i, one in enumerate(free):
            start[i] = known.get(one.name, start[i])
        fitted = fit(self.model, names, self._episodes, start)
        gains = held_out(self.model, fitted) - self._reference
        unbent = fitted.log_prior - self.base.log_prior  # calibration that need not be bent
        return Strength(float(gains.sum()) + unbent, tuple(float(g) for g in gains), fitted)

    def gains(self, candidates: Sequence[str], given: Fit | None = None) -> dict[str, float]:
        """What each effect alone gains on top of a fit (of the base, if none is given), [nats]."""
        ranked = rank(self.model, given or self.base, list(candidates))
        return {c.name: c.gain_nats for c in ranked}


def finite(value: float) -> float | None:
    """A number for JSON."""
    return float(value) if np.isfinite(value) else None
