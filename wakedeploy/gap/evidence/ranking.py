"""Effects compared: what each gains on episodes it was not fitted to.

In: a model and a fit of the base hypothesis. Out: candidates ranked by held-out gain.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student_t

from wakedeploy.gap.evidence.ascent import slopes_at
from wakedeploy.gap.evidence.fits import (
    Fit,
    FloatArray,
    Free,
    Hypothesis,
    Model,
    Slopes,
    own_parameters,
    own_places,
)
from wakedeploy.gap.evidence.inference import fit, held_out
from wakedeploy.gap.evidence.starts import (
    APART,
    GLANCED_AT,
    Scans,
    relations,
    starts_of,
    unbent_sizes,
)
from wakedeploy.gap.progress import StepsDone, uncounted

_CONTENDERS_NATS = 12.0  # candidates this close to the best are fitted to the end
_MOST_CONTENDERS = 4
BENT_NATS = -12.0  # a base whose priors pay more has bent its constants; chance alone takes about 8
_BENT_SD = 2.0
_SIZES_RELEASED = 3  # sizes of an effect of several summits, climbed with unbent constants
_FEW_STARTS = 2
_MOST_OTHERS = 2
_BETTERED_NATS = 0.5
LEDGE_NATS = 3.0  # a base better by less is no other
_MOST_RESETTLED = 3
_ROUGH_SIZES = 10  # a rough fit costs as much as this many scanned sizes
_ROUGH_SHARE = 0.75  # of a ranking's time, before any effect is climbed again
_WORTH_NATS = 4.0  # of a jagged effect's rough fit; below, no summit of it is climbed to the end
_SUMMIT_NATS = 6.0  # a summit this far behind the highest, roughly, may yet be higher
_MOST_SUMMITS = 3
_SIZES_APIECE = 3  # scanned sizes on one summit


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect on top of a base, and what it gains on episodes that it was not fitted to."""

    name: str
    fit: Fit
    gains: FloatArray  # (E,) nats, held out
    prior_gain: float = 0.0  # nats that bending the calibration no longer costs
    fitted_gain: float = np.inf  # nats on the episodes of the fit, priors included
    looked_nats: float = 0.0  # what the best of its summits gains by chance

    @property
    def gain_nats(self) -> float:
        """The sum over the episodes, and what the priors say.

        A calibration is a measurement, too: a base that explains the flights only with constants
        far from their calibrated values pays for it. So does an effect that was looked for at
        hundreds of sizes, each of which fits by chance as well as one parameter may.
        """
        return float(self.gains.sum()) + self.prior_gain - self.looked_nats

    def gain_interval(self) -> tuple[float, float]:
        """Student's 90 % interval of the sum, from the spread between episodes."""
        count = len(self.gains)
        if count < 2:
            return -np.inf, np.inf
        reach = float(student_t.ppf(0.95, count - 1))
        reach *= float(self.gains.std(ddof=1)) * count**0.5
        return self.gain_nats - reach, self.gain_nats + reach


def rank(
    model: Model,
    base: Fit,
    candidates: Sequence[str],
    *,
    least_nats: float = 0.0,
    steps: StepsDone = uncounted,
    scans: Scans | None = None,
    known: Sequence[Candidate] = (),
    released: bool = True,
) -> list[Candidate]:
    """Each candidate on top of `base`, best held-out gain first.

    All are fitted with the base's slopes for what they share; those near the best are then fitted
    to the end, if they gain at least `least_nats` on the episodes that they are fitted to.
    `steps` take about the same time each, but are not one per effect. `scans` keeps the sizes that
    were looked at, for another ranking on nearly the same base. `known` are an earlier ranking's
    candidates; the better fits of both are kept, those climbed from the calibration included. Such
    climbs are made only with `released`.
    """
    scans = {} if scans is None else scans
    costs = [_cost(model, base, name) for name in candidates]
    total = round(sum(costs) / _ROUGH_SHARE)
    rough = []
    for i, name in enumerate(candidates):
        rough.append(_rough(model, base, name, scans))
        steps(sum(costs[: i + 1]), total)
    before = {c.name: c.fit for c in known}
    if before:
        pairs = zip(rough, candidates, strict=True)
        rough = [max(f, before.get(n, f), key=_objective) for f, n in pairs]
    elif released and base.calibration_log_prior < BENT_NATS:
        remaining = functools.partial(_advanced, steps, sum(costs), total)
        rough = _from_calibration(model, base, candidates, rough, remaining)
    best = max((f.objective for f in rough), default=0.0)
    least = max(best - _CONTENDERS_NATS, base.objective + least_nats)
    order = sorted(range(len(rough)), key=lambda i: -rough[i].objective)
    near = [i for i in order if rough[i].objective > least][:_MOST_CONTENDERS]
    for i in near:
        rough[i] = fit(model, rough[i].hypothesis, base.episodes, rough[i].theta)
    ranked = [candidate(base, n, fitted) for n, fitted in zip(candidates, rough, strict=True)]
    return sorted(ranked, key=lambda c: -c.gain_nats)


def rank_fairly(
    model: Model,
    base: Fit,
    candidates: Sequence[str],
    *,
    least_nats: float = 0.0,
    steps: StepsDone = uncounted,
    scans: Scans | None = None,
) -> tuple[Fit, list[Candidate]]:
    """`rank`, on a base that is no worse than the best candidate is without its effect.

    A climb may end short of the best base; then every effect seems to gain what any new climb
    gains.
    """
    scans, ranked = {} if scans is None else scans, list[Candidate]()
    for _ in range(_MOST_RESETTLED):
        ranked = rank(
            *(model, base, candidates),
            least_nats=least_nats,
            steps=steps,
            scans=scans,
            known=ranked,
        )
        if ranked[0].fitted_gain < _BETTERED_NATS:
            break
        known = dict(zip(ranked[0].fit.names, ranked[0].fit.theta, strict=True))
        start = np.array([known.get(n, v) for n, v in zip(base.names, base.theta, strict=True)])
        again = fit(model, base.hypothesis, base.episodes, start)
        again = replace(again, summits=base.summits)  # its interval still spans them
        bettered, base = again.objective - base.objective, max(base, again, key=_objective)
        if bettered < LEDGE_NATS:  # no other valley, from which others would climb elsewhere
            break
    return base, sorted(
        (candidate(base, c.name, c.fit) for c in ranked), key=lambda c: -c.gain_nats
    )


def candidate(base: Fit, name: str, fitted: Fit, model: Model | None = None) -> Candidate:
    """What a fit with an effect gains over a base; each is around the motion of its own fit.

    `model` is asked about losses that are implausible.
    """
    unbent, gained = fitted.log_prior - base.log_prior, fitted.objective - base.objective
    return Candidate(
        name, fitted, held_out(base, fitted, model), unbent, gained, _looked(fitted, name)
    )


def _looked(fitted: Fit, name: str) -> float:
    """The logarithm of how many summits were scanned for an effect's parameters [nats]."""
    parameters = own_parameters(fitted.free, name)
    return sum(math.log(max(len(f.scanned) / _SIZES_APIECE, 1.0)) for f in parameters)


def _cost(model: Model, base: Fit, name: str) -> int:
    """About how long a candidate's rough fit takes, in scanned sizes."""
    parameters = own_parameters(model.free((*base.hypothesis, name)), name)
    return _ROUGH_SIZES + sum(len(f.scanned) for f in parameters)


def _advanced(steps: StepsDone, before: int, total: int, done: int, of: int) -> None:
    """Report steps of the last part as steps of the whole."""
    steps(before + (total - before) * done // of, total)


def _objective(fitted: Fit) -> float:
    return fitted.objective


def _rough(model: Model, base: Fit, name: str, scans: Scans) -> Fit:
    """The candidate fitted from several starts, mostly with the base's slopes for the rest."""
    hypothesis = (*base.hypothesis, name)
    free = model.free(hypothesis)
    places = own_places(free, name)
    if not places:
        raise ValueError(f"{name!r} has no parameters")
    fits, least = list[Fit](), -np.inf
    for theta in starts_of(model, base, hypothesis, free, places, scans):
        slopes = _carried_over(model, base, hypothesis, free, theta, places)
        fits.append(fit(model, hypothesis, base.episodes, theta, slopes, places, least))
        least = max(f.objective for f in fits) - _SUMMIT_NATS
    best = max(fits, key=_objective)
    if any(free[i].scanned for i in places) and best.objective > base.objective + _WORTH_NATS:
        best = max((best, *_climbed(model, fits, places)), key=_objective)
    return best


def _climbed(model: Model, fits: Sequence[Fit], places: Sequence[int]) -> list[Fit]:
    """The highest of several summits, each climbed to the end with everything free.

    The base's slopes are too rough to choose between the summits of a jagged effect.
    """
    most = max(f.objective for f in fits)
    summits: list[Fit] = []
    for climbed in sorted(fits, key=_objective, reverse=True):
        is_new = not any(
            np.allclose(climbed.theta[places], s.theta[places], rtol=APART) for s in summits
        )
        if is_new and climbed.objective > most - _SUMMIT_NATS and len(summits) < _MOST_SUMMITS:
            summits.append(climbed)
    return [fit(model, f.hypothesis, f.episodes, f.theta) for f in summits]


def bent_quantities(base: Fit) -> set[str]:
    """The calibrated constants that a fit moved far from their calibration."""
    return {
        f.quantity
        for f, value in zip(base.free, base.theta, strict=True)
        if f.quantity and abs(value - f.neutral) > _BENT_SD * f.prior_sd
    }


def _from_calibration(
    model: Model, base: Fit, candidates: Sequence[str], rough: list[Fit], steps: StepsDone
) -> list[Fit]:
    """The fits, or better ones for candidates that move a constant which the base has bent.

    A base that has bent its constants to explain a missing effect is a valley of its own, and a
    climb from there may never leave it. These climbs start with all constants at their calibration
    and with louder noise, from the likeliest of the effect's sizes; a likelihood may have several
    summits, as that of a latency has one for each servo frame. The constants may also have been
    bent for effects that such candidates are confused with: these are climbed, too, and so are a
    few others that explain most without bending anything.
    """
    bent = bent_quantities(base)
    owners = {n for n, fitted in zip(candidates, rough, strict=True) if bent & _moves(fitted, n)}
    known = relations(model)
    related = {r for n in owners if n in known for r in known[n].confused_with}
    sizes = [
        unbent_sizes(model, base, fitted.hypothesis, n)
        for n, fitted in zip(candidates, rough, strict=True)
    ]
    order = sorted(range(len(sizes)), key=lambda i: -sizes[i][0][0])
    chosen = [i for i in order if candidates[i] in owners | related]
    others = [i for i in order if i not in chosen][:_MOST_OTHERS]
    fits = list(rough)
    climbed = [*chosen, *others]
    for done, i in enumerate(climbed, 1):
        for _, theta in sizes[i][: _summits(fits[i], candidates[i])]:
            best = max(fits, key=_objective)
            glanced = max(_glanced(fits[i]), _glanced(best) - _CONTENDERS_NATS)
            some = base.episodes[:GLANCED_AT]
            near = fit(model, fits[i].hypothesis, some, theta, least=glanced)
            if near.objective < glanced:  # although it was fitted to these flights alone
                continue
            least = max(fits[i].objective, best.objective - _CONTENDERS_NATS)
            again = fit(model, near.hypothesis, base.episodes, near.theta, least=least)
            fits[i] = max(fits[i], again, key=_objective)
        steps(done, len(climbed))
    return fits


def _glanced(fitted: Fit) -> float:
    """What the objective is of the first flights alone, at which a first look is taken."""
    return float(fitted.per_episode[:GLANCED_AT].sum()) + fitted.log_prior


def _summits(fitted: Fit, name: str) -> int:
    """How many sizes an effect is climbed from; one that states many starts has many summits."""
    starts = max(len(f.starts) for f in own_parameters(fitted.free, name))
    return 1 if starts <= _FEW_STARTS else _SIZES_RELEASED


def _moves(fitted: Fit, name: str) -> set[str]:
    """The constants that an effect's parameters are, replace or add to."""
    return {f.quantity or f.adds_to for f in own_parameters(fitted.free, name)} - {""}


def _carried_over(
    model: Model,
    base: Fit,
    hypothesis: Hypothesis,
    free: tuple[Free, ...],
    theta: FloatArray,
    places: Sequence[int],
) -> Slopes:
    """Slopes of the larger hypothesis: the base's for shared parameters, fresh for its own."""
    place = {name: i for i, name in enumerate(base.names)}
    shared = [place.get(f.name, -1) for f in free]

    def widened(of_base: FloatArray) -> FloatArray:
        with_zero = np.hstack([of_base, np.zeros((len(of_base), 1))])
        return np.asarray(with_zero[:, shared])

    old = Slopes(
        base.slopes.scores,
        tuple(widened(d) for d in base.slopes.innovation),
        tuple(widened(d) for d in base.slopes.variance),
    )
    missing = [i for i, s in enumerate(shared) if s < 0 or i in places]
    return slopes_at(model, hypothesis, base.episodes, theta, (old, missing))
