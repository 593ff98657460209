"""Candidates fitted from where the best one ended: some explain as much only from there.

In: a base and a fit of each candidate on top of it. Out: better fits of those that come near the
best one with its noise and constants. Where constants have bent to an effect that the base lacks,
the way from the base leads through fits that are worse than both.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from wakedeploy.gap.evidence.fits import (
    NO_SLOPES,
    Fit,
    FloatArray,
    Free,
    densities,
    extended,
    log_prior,
    own_places,
)
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.climbing import raced
from wakedeploy.gap.search.comparison import Comparison
from wakedeploy.gap.search.first_look import starts_of, together

_NEAR = 0.3  # share of the best one's gain that another must reach there to be fitted
_MOST = 4  # that are fitted from there
_LEADERS = 3  # the most candidates from whose ends others are tried
_DELAYS = (0.5, 1.0)  # of the best one's: two lags in series are each half as long


def imitated(model: Comparison, base: Fit, fitted: Mapping[str, Fit]) -> dict[str, Fit]:
    """The fits by effect; one that is better from where the best one ended replaces its own.

    If another is then the best, the rest are tried from its end, too.
    """
    known, tried = dict(fitted), set[str]()
    for _ in range(_LEADERS):
        best = max(known, key=lambda n: known[n].objective, default=None)
        if best is None or best in tried:
            break
        tried.add(best)
        known |= _imitating(model, base, known, best)
    return known


def _imitating(
    model: Comparison, base: Fit, fitted: Mapping[str, Fit], best: str
) -> dict[str, Fit]:
    """Better fits of others from where the best one ended."""
    gained = fitted[best].objective - base.objective
    if gained < RULES.least_nats:
        return {}
    begun = _begun(model, base, fitted[best], [n for n in fitted if n != best])
    near = {
        n: f
        for n, f in begun.items()
        if f.objective > max(fitted[n].objective, base.objective + _NEAR * gained)
    }
    chosen = sorted(near, key=lambda n: -near[n].objective)[:_MOST]
    return dict(zip(chosen, raced(model, base, [near[n] for n in chosen]), strict=True))


def _begun(model: Comparison, base: Fit, best: Fit, names: Sequence[str]) -> dict[str, Fit]:
    """The best start of each candidate with the noise and constants of the best fit."""
    points, frees = {}, {}
    for name in names:
        frees[name] = model.free((*base.hypothesis, name))
        points[name] = _points(best, frees[name], name)
    begun = {}
    for name, scores in together(model, base, best, points):
        density = [densities(each) for each in scores]
        objectives = [float(d.sum()) + log_prior(frees[name], theta)
                for d, theta in zip(density, points[name], strict=True)]  # fmt: skip
        k = int(np.argmax(np.nan_to_num(objectives, nan=-np.inf)))
        hypothesis, theta = (*base.hypothesis, name), points[name][k]
        begun[name] = Fit(hypothesis, frees[name], base.episodes, theta, NO_SLOPES, density[k])
    return begun


def _points(best: Fit, free: Sequence[Free], name: str) -> list[FloatArray]:
    """A candidate's starts; if it and the best are both delays, also those as late as the best."""
    origin = extended(best, free)
    places = own_places(free, name)
    points = starts_of(origin, free, places)
    late = [v for f, v in zip(best.free, best.theta, strict=True) if _is_delay(f, best)]
    for i in places:
        if late and free[i].unit == "s":
            for share in _DELAYS:
                point = origin.copy()
                point[i] = np.clip(share * late[0], free[i].low, free[i].high)
                points.append(point)
    return points


def _is_delay(free: Free, best: Fit) -> bool:
    return free.unit == "s" and free.name.startswith(f"{best.hypothesis[-1]}.")
