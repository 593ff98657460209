"""How strong a hidden effect is in the data that were flown, and how well it can be forecast.

In: a case's flights and its truth. Out: fits of the base, of the truth, and of any other effect,
all begun where the truth says, which the workflow cannot do; the nats that they gain on flights
left out, and the forecast error that even the truth's fit leaves.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from benchmarks.hidden_effects.outside import OUTSIDE
from wakedeploy.core.rig import Rig
from wakedeploy.gap.evidence.fits import Fit, extended
from wakedeploy.gap.evidence.inference import fit, held_out
from wakedeploy.gap.evidence.ranking import candidate, rank
from wakedeploy.gap.systems.gantry.flight import Flight, FloatArray
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.residuals import AHEAD_S
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.naming import fitted_base
from wakedeploy.gap.systems.gantry.search.refitting import refitted

Values = Mapping[str, Mapping[str, float]]
_BLOCK_S = 2.0  # as the workflow's own intervals: errors closer than that go together


@dataclass(frozen=True, eq=False)
class Strength:
    """What the truth gains over the rig file as it is, [nats], each around its own motion.

    `model` is linear around the truth's, and `fit` is its fit there. `nats` is the gain on flights
    left out and what the calibration's priors gain besides: an effect on a calibrated constant
    shows in nothing but a constant far from its prior.
    """

    nats: float
    per_flight: tuple[float, ...]
    model: GantryModel
    fit: Fit


@dataclass(frozen=True)
class Floor:
    """The forecast error 0.25 s ahead that is left on some flights when nothing is missing.

    `rms_m` is the root mean square under the truth's fit. `excess_m2` is how much the mean square
    is larger without the effect, in the same samples, and `reach_m2` half its 90 % interval, from
    blocks of two seconds.
    """

    rms_m: float
    excess_m2: float
    reach_m2: float

    @property
    def shows(self) -> bool:
        """Whether the hidden effect is in that error at all, beyond what sampling explains."""
        return self.excess_m2 > self.reach_m2


class Measured:
    """The flights of one case under the judge's hypotheses."""

    def __init__(self, rig: Rig, flights: Sequence[Flight]) -> None:
        extra = {name: hidden.effect for name, hidden in OUTSIDE.items()}
        self._episodes = range(len(flights))
        self.model, self.base = fitted_base(GantryModel(rig, flights, extra))

    def strength(self, truth: Values, outside: Mapping[str, float] | None = None) -> Strength:
        """The gain of all hidden effects together, fitted from their true values."""
        names = (*truth, *(outside or {}))
        free = self.model.free(names)
        known = {f"{name}.{k}": v for name, values in truth.items() for k, v in values.items()}
        # The base's calibration is bent to do without the effects; with them it may be so far off
        # that every sample looks like an outlier. Loud noise and no bend find the way from there.
        fits = []
        for start in (extended(self.base, free), self.model.start(names)):
            for i, parameter in enumerate(free):
                start[i] = known.get(parameter.name, start[i])
            fits.append(fit(self.model, names, self._episodes, start))
        fitted = max(fits, key=lambda attempt: attempt.per_episode.sum() + attempt.log_prior)
        model, fitted = refitted(self.model, fitted)
        gains = held_out(self.base, fitted)
        unbent = fitted.log_prior - self.base.log_prior  # calibration that need not be bent
        nats, per_flight = float(gains.sum()) + unbent, tuple(float(g) for g in gains)
        return Strength(nats, per_flight, model, fitted)

    def gains(self, candidates: Sequence[str], given: Strength | None = None) -> dict[str, float]:
        """What each effect alone gains on top of others (of none, if none are given), [nats].

        Each is refitted around its own motion.
        """
        model, base = (given.model, given.fit) if given else (self.model, self.base)
        ranked = rank(model, base, list(candidates))
        refits = [candidate(base, c.name, refitted(model, c.fit)[1]) for c in ranked]
        return {c.name: c.gain_nats for c in refits}

    def floor(self, fitted: Fit, names: Collection[str]) -> Floor:
        """What the truth, fitted to the other flights, leaves on those with these names.

        Without other flights the fit is of the same ones, as the workflow's is then, too.
        """
        wanted = {Path(name).name for name in names}
        chosen = [i for i, f in enumerate(self.model.flights) if Path(f.name).name in wanted]
        others = [i for i in self._episodes if i not in chosen] or chosen
        model = self.model.only(chosen)
        fits = (fit(self.model, f.hypothesis, others, f.theta) for f in (fitted, self.base))
        fitted, base = (refitted(self.model, rough_fit)[1] for rough_fit in fits)
        block, remaining = _squares(model, fitted)
        _, before = _squares(model, base)
        excess = before - remaining
        means = [
            np.nanmean(e) for n in np.unique(block) if np.isfinite(e := excess[block == n]).any()
        ]
        reach = float("inf")
        if len(means) > 1:
            quantile = float(student.ppf(0.95, len(means) - 1))
            reach = quantile * float(np.std(means, ddof=1)) / len(means) ** 0.5
        return Floor(float(np.sqrt(np.nanmean(remaining))), float(np.mean(means)), reach)


def _squares(model: GantryModel, fitted: Fit) -> tuple[FloatArray, FloatArray]:
    """Squared errors [m²] of all forecasts (n,), NaN where none is known, and their blocks (n,)."""
    near = model.around_own_motion(fitted)
    blocks, squares, first = [], [], 0.0
    for episode in range(near.episodes):
        ahead = near.forecasts(fitted, episode, (AHEAD_S,))
        error = np.abs(ahead.measured_m[0] - ahead.forecast_m[0])
        error[error > RULES.stray * 1.4826 * np.nanmedian(error)] = np.nan
        squares.append(error**2)
        blocks.append(first + np.floor((ahead.at_s - ahead.at_s[0]) / _BLOCK_S))
        first = float(blocks[-1][-1]) + 1.0
    return np.concatenate(blocks), np.concatenate(squares)


def finite(value: float) -> float | None:
    """A number for JSON."""
    return float(value) if np.isfinite(value) else None
