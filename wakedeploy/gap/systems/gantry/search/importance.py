"""Does what was found matter: how much of the forecast error it removes where nothing was fitted.

Evidence and importance are two questions. A thousand readings make a force of 0.02 N certain; the
forecast may still be no better for it.

In: what was found, and the sealed flights (without any, each flight with the fit to the others).
Out: for each effect the share of the squared forecast error that it removes 0.25 s and 1 s ahead,
block by block against the same model without it; its gain in likelihood there; and the same for a
placebo, a wrong effect.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.search.artefacts import Forecast
from wakedeploy.gap.systems.gantry.effect_force import Cost, cost_of
from wakedeploy.gap.systems.gantry.findings import Tracking, Worth
from wakedeploy.gap.systems.gantry.flight import Flight, FloatArray
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.before_after import Shown, under, wrong_effects
from wakedeploy.gap.systems.gantry.search.refitting import reduced
from wakedeploy.gap.systems.gantry.search.saved_fits import Found

BLOCKS_S: Mapping[float, float] = {0.25: 2.0, 1.0: 4.0}  # horizon: length of a block


@dataclass(frozen=True)
class Removed:
    """A share of a squared forecast error, with its 90 % interval from paired blocks."""

    share: float
    low: float
    high: float

    @property
    def clearly(self) -> bool:
        """Whether the share counts and is surely above 0."""
        return self.share >= RULES.least_share and self.low > 0.0

    @property
    def as_artefact(self) -> Forecast:
        """As `name.json` holds it."""
        return Forecast(share=self.share, low=self.low, high=self.high)


@dataclass(frozen=True)
class Mattering:
    """What one effect (or an expression) is worth on flights that it was not fitted to.

    `removed` is by horizon [s]; `gain_nats` is in the sealed likelihood. `cost` is the force that
    it makes along the flights, and the tracking error of a controller that ignores it.
    `placebo_shares` is what a wrong effect removes by horizon, `placebo_nats` what it gains; None
    without one.
    """

    removed: Mapping[float, Removed]
    gain_nats: float
    cost: Cost
    placebo_shares: Mapping[float, float] | None = None
    placebo_nats: float | None = None

    @property
    def helps(self) -> bool:
        """Whether it improves forecasts, and at one horizon more than a wrong effect does."""
        placebo = self.placebo_shares or {}
        better = [r.share > max(placebo.get(h, 0.0), 0.0) for h, r in self.removed.items()]
        return self.removed[0.25].share > 0.0 and any(better)

    @property
    def speaks(self) -> bool:
        """Whether the sealed likelihood is clearly for it, and more than for a wrong effect."""
        return self.gain_nats > max(RULES.speaks_nats, self.placebo_nats or 0.0)

    @property
    def is_confirmed(self) -> bool:
        """Whether the sealed flights bear it out at all, in forecasts or in likelihood."""
        return self.helps or self.speaks

    @property
    def matters(self) -> bool:
        """Whether it removes a share that counts at a horizon, and spoils no forecast.

        The share must surely be above 0: by its own interval, or because the sealed likelihood
        speaks for it, which says more of few blocks.
        """
        spoils = any(r.high < 0.0 for r in self.removed.values())
        counts = [r for r in self.removed.values() if r.share >= RULES.least_share]
        surely = self.speaks or any(r.clearly for r in counts)
        return self.helps and not spoils and bool(counts) and surely

    @property
    def as_artefact(self) -> Worth:
        """As `name.json` holds it."""
        wrong = self.placebo_shares
        return Worth(
            matters=self.matters,
            confirmed=self.is_confirmed,
            removed={f"{h:g} s ahead": r.as_artefact for h, r in self.removed.items()},
            sealed_gain_nats=self.gain_nats,
            force_n=self.cost.force_n,
            tracking_m=Tracking(
                value=self.cost.tracking_m, low=self.cost.low_m, high=self.cost.high_m
            ),
            placebo_removed=wrong and {f"{h:g} s ahead": share for h, share in wrong.items()},
            placebo_gain_nats=math.nan if self.placebo_nats is None else self.placebo_nats,
        )


def mattering(
    found: Found,
    flights: Sequence[Flight],
    parts: Sequence[Sequence[str]],
    *,
    members: Sequence[str] = (),
    crossed: bool = False,
) -> list[Mattering]:
    """What each part is worth: names of the hypothesis that stand or fall together.

    A part is judged against all else that was found. `crossed`: no flight is sealed, and each is
    judged with the fit to the others.
    """
    begin = GantryModel(found.model.rig, flights, found.model.extra)
    judge = _Judge(found, begin, crossed)
    whole = judge.errors(found.model, found.fit)
    wrong = judge.placebo(found, members)
    worth = []
    for part in parts:
        rest = tuple(n for n in found.fit.hypothesis if n not in part)
        without = judge.without(rest)
        shares = {h: removed(without.blocks[h], whole.blocks[h]) for h in BLOCKS_S}
        gain = whole.log_density - without.log_density
        cost = cost_of(found.model, found.fit, part)
        # A wrong effect in place of all that was found is no measure of one among several.
        placebo = (None, None) if rest else judge.gained(wrong)
        worth.append(Mattering(shares, gain, cost, *placebo))
    return worth


@dataclass(frozen=True, eq=False)
class _Errors:
    """Forecast errors per block, by horizon, NaN for strays; and the log density [nats]."""

    blocks: Mapping[float, Sequence[FloatArray]]
    log_density: float


class _Judge:
    """The flights that decide, under one hypothesis after another."""

    def __init__(self, found: Found, flights: GantryModel, crossed: bool) -> None:
        self._found, self._crossed = found, crossed
        self._flights = flights.around_own_motion(found.base)
        self.base = self.errors(found.base_model, found.base)

    def errors(self, fitted_in: GantryModel, fitted: Fit) -> _Errors:
        """Errors under a fit, or of each flight under the fit to the others."""
        shown = under(self._flights, fitted_in, fitted, self._crossed)
        density = float(shown.fit.per_episode.sum())
        return _Errors({h: _blocks(shown, h) for h in BLOCKS_S}, density)

    def without(self, rest: tuple[str, ...]) -> _Errors:
        """Errors under the other parts of the fit, refitted."""
        if not rest:
            return self.base
        return self.errors(*reduced(self._found.model, self._found.fit, rest))

    def gained(self, wrong: _Errors | None) -> tuple[Mapping[float, float] | None, float | None]:
        """The share that a wrong effect removes, by horizon, and what it gains [nats]."""
        if wrong is None:
            return None, None
        shares = {h: removed(self.base.blocks[h], wrong.blocks[h]).share for h in BLOCKS_S}
        return shares, wrong.log_density - self.base.log_density

    def placebo(self, found: Found, members: Sequence[str]) -> _Errors | None:
        """Errors under the best wrong effect, as the search fitted it; None without one."""
        wrong = wrong_effects(found.tried, found.fit.hypothesis, members)
        return self.errors(found.base_model, wrong[0].fit) if wrong else None


def _blocks(shown: Shown, horizon_s: float) -> list[FloatArray]:
    """Forecast errors [m] in blocks of time, all flights one after another."""
    blocks = []
    for episode, fitted in enumerate(shown.by_flight):
        ahead = shown.model.forecasts(fitted, episode, (horizon_s,))
        error = ahead.measured_m[0] - ahead.forecast_m[0]
        number = np.floor((ahead.at_s - ahead.at_s[0]) / BLOCKS_S[horizon_s])
        blocks += [error[number == n] for n in np.unique(number)]
    return blocks


def removed(before: Sequence[FloatArray], after: Sequence[FloatArray]) -> Removed:
    """The share of the squared error that is removed; both have blocks of the same samples."""
    known = np.isfinite(np.concatenate(list(before))) & np.isfinite(np.concatenate(list(after)))
    if not known.any():
        return Removed(0.0, -np.inf, np.inf)
    old, new = (np.concatenate(list(blocks)) for blocks in (before, after))
    usual = 1.4826 * float(np.median(np.abs(old[known])))
    known &= (np.abs(np.nan_to_num(old)) < RULES.stray * usual) | (
        np.abs(np.nan_to_num(new)) < RULES.stray * usual
    )
    number = np.repeat(np.arange(len(before)), [len(b) for b in before])
    gone = np.where(known, np.nan_to_num(old) ** 2 - np.nan_to_num(new) ** 2, 0.0)
    squares = float((np.nan_to_num(old)[known] ** 2).sum())
    sums = np.bincount(number, gone, len(before))
    sums = sums[np.bincount(number, known, len(before)) > 0]
    count = len(sums)
    share = float(sums.sum()) / squares
    if count < 2:
        return Removed(share, -np.inf, np.inf)
    reach = float(student_t.ppf(0.95, count - 1) * sums.std(ddof=1) * count**0.5) / squares
    return Removed(share, share - reach, min(share + reach, 1.0))
