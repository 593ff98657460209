"""Candidates fitted from where the best one ended: some explain as much only from there.

In: a base and a fit of each candidate on top of it. Out: better fits of those that come near the
best one with its noise and constants. Where constants have bent to an effect that the base lacks,
the way from the base leads through fits that are worse than both. A candidate begins there at its
usual sizes, and at the size at which it changes outputs most nearly as the best one does.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from wakedeploy.gap.evidence.ascent import aside
from wakedeploy.gap.evidence.fits import (
    Fit,
    FloatArray,
    Free,
    Score,
    Slopes,
    bounds_of,
    densities,
    extended,
    own_places,
    scores_of,
)
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.climbing import DAMPINGS, height, raced, stepped
from wakedeploy.gap.search.comparison import Comparison
from wakedeploy.gap.search.first_look import slopes_with, starts_of, together

NEAR = 0.3  # share of the best one's gain that another must reach there to be fitted
_MOST = 4  # that are fitted from there
_LEADERS = 3  # the most candidates from whose ends others are tried
_SIZED = 3  # times that a candidate is sized
_LIKE = 0.3  # cosine from which on a candidate is sized
_ALIKE = 0.8  # cosine from which on a candidate follows the best one
_FOLLOWED, _FOLLOWING = 8, 4  # how many do, and how many steps
_MOSTLY = 0.1  # share that may be left of what the best one does
_DELAYS = (0.5, 1.0)  # of the best one's: two lags in series are each half as long
Added = tuple[str, ...]  # the effects that a candidate adds to a base


def imitated(model: Comparison, base: Fit, fitted: Mapping[str, Fit]) -> dict[str, Fit]:
    """The fits by effect; one that is better from where the best one ended replaces its own.

    If another is then the best, the rest are tried from its end, too.
    """
    known, tried = dict(fitted), set[str]()
    for _ in range(_LEADERS):
        best = max(known, key=lambda n: height(known[n]), default=None)
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
    begun = doing_alike(model, base, fitted[best], [(n,) for n in fitted if n != best])
    begun |= _followed(model, base, fitted[best], begun)
    near = {
        n: f
        for (n,), f in begun.items()
        if f.objective > max(height(fitted[n]), base.objective + NEAR * gained)
    }
    chosen = sorted(near, key=lambda n: -height(near[n]))[:_MOST]
    return dict(zip(chosen, raced(model, base, [near[n] for n in chosen]), strict=True))


def doing_alike(
    model: Comparison, base: Fit, best: Fit, added: Sequence[Added]
) -> dict[Added, Fit]:
    """The best start of each candidate with the noise and constants of the best fit.

    A candidate is one effect, or several, beside those of the base. One that does something like
    what the best one does is sized, and once it does most of it, further: where noise is small, a
    tenth more or less costs more than nothing at all.
    """
    points = {a: _points(best, model.free((*base.hypothesis, *a)), a) for a in added}
    absent = _absent(model, base, best)
    at, highest = dict[Added, Fit](), dict[Added, Fit]()
    for name, fits in _placed(model, base, best, points):
        highest[name] = max(fits, key=height)
        likeness, nearest = max(
            ((_likeness(absent, f, best), f) for f in fits), key=lambda each: each[0]
        )
        if likeness > _LIKE:
            at[name] = nearest
    least = _MOSTLY * _apart(absent, best)
    for _ in range(_SIZED):
        places = {a: _places(f.free, a) for a, f in at.items()}
        moved = {a: [aside(f.theta, f.free, i)[0] for i in places[a]] for a, f in at.items()}
        sized = {
            a: [_as_far(best, at[a], beside, places[a])]
            for a, beside in _placed(model, base, best, moved)
        }
        at = {a: fits[0] for a, fits in _placed(model, base, best, sized)}
        highest |= {a: max(highest[a], f, key=height) for a, f in at.items()}
        at = {a: f for a, f in at.items() if _apart(f, best) < least}
    return highest


def _followed(
    model: Comparison, base: Fit, best: Fit, begun: Mapping[Added, Fit]
) -> dict[Added, Fit]:
    """Those most like the best, a few steps on, all that they share with it by its slopes.

    Where its constants have bent to it, another that does the same is off by a little of each, and
    with little noise that costs more than it gains. Slopes of its own would take a run for each.
    """
    absent = _absent(model, base, best)
    alike = {a: _likeness(absent, f, best) for a, f in begun.items()}
    chosen = sorted((a for a in alike if alike[a] > _ALIKE), key=lambda a: -alike[a])
    highest = {a: begun[a] for a in chosen[:_FOLLOWED]}
    rising = dict(highest)
    for _ in range(_FOLLOWING):
        beside = {a: [aside(f.theta, f.free, i) for i in _places(f.free, a)]
                  for a, f in rising.items()}  # fmt: skip
        moved = {a: [theta for theta, _ in each] for a, each in beside.items()}
        steps = dict[Added, list[FloatArray]]()
        for a, fits in _placed(model, base, best, moved):
            f = rising[a]
            at = zip(_places(f.free, a), beside[a], strict=True)
            known = replace(best, slopes=replace(best.slopes, scores=f.slopes.scores))
            slopes = slopes_with(
                known, f.free, [m.slopes.scores for m in fits], [(i, *each) for i, each in at]
            )
            steps[a] = [stepped(replace(f, slopes=slopes), damping) for damping in DAMPINGS]
        reached = {a: max(fits, key=height) for a, fits in _placed(model, base, best, steps)}
        rising = {a: f for a, f in reached.items() if height(f) > height(highest[a])}
        highest |= rising
    return highest


def _absent(model: Comparison, base: Fit, best: Fit) -> Fit:
    """The best fit's constants and noise without the effect that it added."""
    theta = extended(best, base.free)
    scores = scores_of(model, base.hypothesis, np.array([theta]), base.episodes)[0]
    return replace(base, theta=theta, slopes=Slopes(scores, (), ()))


def _placed(
    model: Comparison, base: Fit, best: Fit, points: Mapping[Added, Sequence[FloatArray]]
) -> Iterator[tuple[Added, list[Fit]]]:
    """Every candidate at its points, scored and without derivatives."""
    for added, scored in _scored(model, base, best, points):
        hypothesis = (*base.hypothesis, *added)
        free = model.free(hypothesis)
        yield (
            added,
            [
                Fit(hypothesis, free, base.episodes, theta, Slopes(each, (), ()), densities(each))
                for theta, each in zip(points[added], scored, strict=True)
            ],
        )


def _scored(
    model: Comparison, base: Fit, best: Fit, points: Mapping[Added, Sequence[FloatArray]]
) -> Iterator[tuple[Added, list[tuple[Score, ...]]]]:
    single = {added[0]: thetas for added, thetas in points.items() if len(added) == 1}
    for name, scored in together(model, base, best, single):
        yield (name,), scored
    for added, thetas in points.items():
        if len(added) > 1:
            hypothesis = (*base.hypothesis, *added)
            yield added, scores_of(model, hypothesis, np.array(thetas), base.episodes)


def _places(free: Sequence[Free], added: Added) -> list[int]:
    """Where the parameters of a candidate's effects stand."""
    return [i for name in added for i in own_places(free, name)]


def _as_far(best: Fit, at: Fit, moved: Sequence[Fit], places: Sequence[int]) -> FloatArray:
    """A candidate's point (p,) whose innovations are nearly the best fit's, by Gauss and Newton.

    `moved` are its fits with each of the parameters at `places` moved.
    """
    here, theta = _white(at, best), at.theta.copy()
    steps = [m.theta[i] - theta[i] for m, i in zip(moved, places, strict=True)]
    columns = [(_white(m, best) - here) / s for m, s in zip(moved, steps, strict=True)]
    change = _white(best, best) - here
    if not (np.isfinite(change).all() and np.isfinite(columns).all()):
        return theta
    theta[places] += np.linalg.lstsq(np.transpose(columns), change, rcond=1e-9)[0]
    low, high = bounds_of(at.free)
    return np.clip(theta, low, high)


def _likeness(absent: Fit, fitted: Fit, best: Fit) -> float:
    """The cosine between what a fit and the best one do to innovations, either way round."""
    without = _white(absent, best)
    done, sought = _white(fitted, best) - without, _white(best, best) - without
    norms = float(np.linalg.norm(done) * np.linalg.norm(sought))
    return abs(float(done @ sought)) / norms if 0.0 < norms < np.inf else 0.0


def _apart(fitted: Fit, best: Fit) -> float:
    """The sum of squares by which innovations differ from those of the best fit."""
    return float(np.square(_white(fitted, best) - _white(best, best)).sum())


def _white(fitted: Fit, best: Fit) -> FloatArray:
    """A fit's innovations by the spread and weights that the best one has, (n,)."""
    parts = zip(fitted.slopes.scores, best.slopes.scores, strict=True)
    return np.concatenate(
        [s.innovation / np.sqrt(b.variance) * np.sqrt(b.weight) for s, b in parts]
    )


def _points(best: Fit, free: Sequence[Free], added: Added) -> list[FloatArray]:
    """A candidate's starts; if it and the best are both delays, also those as late as the best."""
    origin, places = extended(best, free), _places(free, added)
    points = starts_of(origin, free, places)
    late = [v for f, v in zip(best.free, best.theta, strict=True) if _is_delay(f, best)]
    times = [i for i in places if free[i].unit == "s"]
    for share in _DELAYS if late and times else ():
        point = origin.copy()
        for i in times:
            point[i] = np.clip(share * late[0], free[i].low, free[i].high)
        points.append(point)
    return points


def _is_delay(free: Free, best: Fit) -> bool:
    return free.unit == "s" and free.name.startswith(f"{best.hypothesis[-1]}.")
