"""Candidates begun as the system itself is begun, where nobody has measured some of its constants.

In: a `Comparison` and a fit of the system as it is. Out: fits of candidates that explain more from
there, and the base bettered. Constants of unlimited spread, and noise, bend to what a system lacks,
as far as they can; from where they end, the way to the truth leads through worse fits. Built into
the system, an effect would not begin there, so as a candidate it begins twice. Most are left on
the way (successive halving: Jamieson and Talwalkar, AISTATS 2016).
"""

from collections.abc import Iterable, Sequence

import numpy as np

from wakedeploy.gap.evidence.fits import NO_SLOPES, Fit, densities, own_places, scores_of
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.progress import StepsDone, uncounted
from wakedeploy.gap.search.climbing import advanced, fresh, height
from wakedeploy.gap.search.comparison import Comparison
from wakedeploy.gap.search.first_look import starts_of
from wakedeploy.gap.search.starting_constants import points_around

_POINTS = 2  # of each candidate that are climbed
_STEPS, _FURTHER = 3, 4  # of a climb, and of those that go on
_KEPT, _ENDED = 8, 4  # candidates that go on, and that are fitted to the end


def begun_anew(
    model: Comparison, base: Fit, names: Sequence[str], steps: StepsDone = uncounted
) -> dict[str, Fit]:
    """Fits of candidates that come out above the base, which has no effect yet.

    There are none where all constants were measured.
    """
    if len(points_around(model, ())) == 0:
        return {}
    running = {}
    for done, name in enumerate(names, 1):
        points = sorted(_scored(model, name, base.episodes), key=height)[-_POINTS:]
        running[name] = max((_climbed(model, p, _STEPS) for p in points), key=height)
        steps(done, len(names))
    first = sorted(running, key=lambda n: -height(running[n]))[:_KEPT]
    running = {n: _climbed(model, running[n], _FURTHER) for n in first}
    ends = {}
    for name in sorted(running, key=lambda n: -height(running[n]))[:_ENDED]:
        ends[name] = settled(model, fit(model, (name,), base.episodes, running[name].theta))[0]
    return {n: f for n, f in ends.items() if f.objective > base.objective}


def bettered(model: Comparison, base: Fit, others: Iterable[Fit]) -> Fit:
    """The base, or what it comes to from where others ended, if that is more.

    What it had left to rise would count as every candidate's gain.
    """
    reached = [base]
    for fitted in others:
        known = dict(zip(fitted.names, fitted.theta, strict=True))
        start = np.array([known[n] for n in base.names])
        reached.append(fit(model, base.hypothesis, base.episodes, start))
    best = max(reached, key=lambda f: f.objective)
    return best if best is base else settled(model, best)[0]


def _scored(model: Comparison, name: str, episodes: tuple[int, ...]) -> list[Fit]:
    """A candidate at each of its starts, at points where a system may begin."""
    hypothesis = (name,)
    free = model.free(hypothesis)
    places = own_places(free, name)
    around = points_around(model, hypothesis)
    points = [start for point in around for start in starts_of(point, free, places)]
    scores = scores_of(model, hypothesis, np.array(points), episodes)
    return [
        Fit(hypothesis, free, episodes, theta, NO_SLOPES, densities(each))
        for theta, each in zip(points, scores, strict=True)
    ]


def _climbed(model: Comparison, fitted: Fit, count: int) -> Fit:
    """So many steps on, from a point that may have no slopes yet."""
    if not fitted.slopes.scores:
        fitted = fresh(model, fitted, fitted.theta)
    for _ in range(count):
        fitted, rise = advanced(model, fitted)
        if rise == 0.0:
            break
    return fitted
