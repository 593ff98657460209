"""A candidate effect around the base, before any fit: what its slopes promise, how far a step gets.

In: a `Comparison`, a fit without the effect. Out: the score statistic (Rao, Math. Proc. Cambridge
Philos. Soc. 44, 1948) from one pass over the logs, the best point that a Newton step from there
reaches, and slopes from which a climb and the gain of chance are estimated.

An effect's amplitude is a parameter whose neutral value is 0: there the effect vanishes, whatever
its shapes are, and the base's scores hold.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wakedeploy.gap.evidence.ascent import aside
from wakedeploy.gap.evidence.fits import (
    LOST_NATS,
    Fit,
    FloatArray,
    Free,
    Score,
    Slopes,
    bounds_of,
    densities,
    extended,
    neutral,
    own_places,
    prior_precision,
    scores_of,
)
from wakedeploy.gap.evidence.separation import whitened
from wakedeploy.gap.progress import StepsDone, uncounted
from wakedeploy.gap.search.comparison import Comparison

_PARTS = (1.0, 0.3)  # of a step, tried for as long as the likelihood rises
_SEEDS = 2  # shapes from which a step is tried
_PROMISING = 1.5  # [nats] no step is tried for less


@dataclass(frozen=True, eq=False)
class Ground:
    """A base, seen from a candidate: its directions and what they leave of the innovations.

    `q` (2n + p, p) and `r` (p, p) factor its whitened slopes with the priors below them; slopes
    times `rest` (2n + p,) give a gradient.
    """

    base: Fit
    q: FloatArray
    r: FloatArray
    rest: FloatArray

    @classmethod
    def of(cls, base: Fit) -> "Ground":
        """From a fit's slopes."""
        root = np.sqrt(prior_precision(base.free))
        known = np.concatenate(whitened(base.slopes))
        q, r = np.linalg.qr(np.vstack([known, np.diag(root)]))
        white = np.concatenate([white_rest(s) for s in base.slopes.scores])
        rest = np.concatenate([white, root * (neutral(base.free) - base.theta)])
        return cls(base, q, r, rest - q @ (q.T @ rest))

    def residual(self, columns: FloatArray) -> FloatArray:
        """What the known directions leave of columns (2n, k): (2n + p, k)."""
        padded = np.vstack([columns, np.zeros((len(self.r), columns.shape[1]))])
        return np.asarray(padded - self.q @ (self.q[: len(columns)].T @ columns))

    def followed(self, columns: FloatArray) -> FloatArray:
        """How far the base's parameters move back for a unit of each column, (p, k)."""
        pull = self.q[: len(columns)].T @ columns
        return np.asarray(np.linalg.lstsq(self.r, pull, rcond=1e-12)[0])


@dataclass(frozen=True, eq=False)
class Look:
    """A candidate around the base: the best point reached, the promised gain, and slopes.

    `columns` are its whitened slopes for each shape (2n, k), and what each of its starts changes
    (2n, 1).
    """

    name: str
    fit: Fit
    promised: float
    columns: tuple[FloatArray, ...]

    def prospect(self, base: Fit) -> float:
        """The gain [nats] that was reached or is promised, whichever is larger."""
        return max(self.fit.objective - base.objective, self.promised)


def white_rest(score: Score) -> FloatArray:
    """What whitened slopes are multiplied by to give a gradient, (2n,)."""
    seen = score.log_density != 0.0
    spread = np.sqrt(0.5 * score.weight) * (score.innovation**2 / score.variance - 1.0)
    return np.concatenate([-score.white, np.where(seen, spread, 0.0)])


@dataclass(frozen=True, eq=False)
class _Plan:
    """Where a candidate is looked at: beside each seed, and at its starts."""

    name: str
    free: tuple[Free, ...]
    amplitudes: list[int]
    seeds: list[FloatArray]
    moved: list[tuple[int, FloatArray, float]]
    leaps: list[FloatArray]

    @classmethod
    def of(cls, model: Comparison, base: Fit, name: str) -> "_Plan":
        free = model.free((*base.hypothesis, name))
        places = own_places(free, name)
        amplitudes = [i for i in places if free[i].neutral == 0.0] or places
        origin = extended(base, free)
        starts = starts_of(origin, free, places)
        seeds = _seeds(starts, origin, amplitudes)
        moved = [(i, *aside(seed, free, i)) for seed in seeds for i in amplitudes]
        return cls(name, free, amplitudes, seeds, moved, starts)

    @property
    def thetas(self) -> list[FloatArray]:
        """All points."""
        return [*(theta for _, theta, _ in self.moved), *self.leaps]


def looks(
    model: Comparison, ground: Ground, names: Sequence[str], steps: StepsDone = uncounted
) -> list[Look]:
    """A look at every candidate; on short logs, where a run costs the same, several share one."""
    plans = {name: _Plan.of(model, ground.base, name) for name in names}
    scored = together(model, ground.base, ground.base, {n: p.thetas for n, p in plans.items()})
    found = []
    for name, scores in scored:
        found.append(_look(model, ground, plans[name], scores))
        steps(len(found), len(names))
    known = {seen.name: seen for seen in found}
    return [known[name] for name in names]


def changes(
    model: Comparison, base: Fit, names: Sequence[str], steps: StepsDone = uncounted
) -> dict[str, FloatArray]:
    """What each candidate changes at its first start, whitened, (2n,)."""
    points, found = {}, {}
    for name in names:
        free = model.free((*base.hypothesis, name))
        points[name] = starts_of(extended(base, free), free, own_places(free, name))[:1]
    for name, (scores,) in together(model, base, base, points):
        found[name] = _change(base, scores)[:, 0]
        steps(len(found), len(names))
    return {name: found[name] for name in names}


def together(
    model: Comparison, base: Fit, like: Fit, points: Mapping[str, Sequence[FloatArray]]
) -> Iterator[tuple[str, list[tuple[Score, ...]]]]:
    """Scores of several candidates, each at points of its own hypothesis on top of `base`.

    On short logs several are scored in one run: all are in it, but only one acts at a time. What a
    candidate's points leave open is as in `like`.
    """
    for group in model.groups(list(points)):
        hypothesis = (*base.hypothesis, *group)
        free = model.free(hypothesis)
        origin = dict(zip([f.name for f in free], extended(like, free), strict=True))
        thetas = []
        for name in group:
            names = [f.name for f in model.free((*base.hypothesis, name))]
            for theta in points[name]:
                point = {**origin, **dict(zip(names, theta, strict=True))}
                thetas.append([point[f.name] for f in free])
        scores = scores_of(model, hypothesis, np.array(thetas), base.episodes)
        for name in group:
            yield name, scores[: len(points[name])]
            scores = scores[len(points[name]) :]


def _look(
    model: Comparison, ground: Ground, plan: _Plan, scores: Sequence[tuple[Score, ...]]
) -> Look:
    base, moved, count = ground.base, plan.moved, len(plan.amplitudes)
    climb = _Climb(ground, plan.name, plan.free, plan.amplitudes)
    columns = [
        slopes_with(base, plan.free, scores[k : k + count], moved[k : k + count])
        for k in range(0, len(moved), count)
    ]
    leapt = scores[len(moved) :]
    tried = [climb.at(plan.seeds[0], base.slopes.scores, columns[0])]
    tried += [climb.at(t, s, columns[0]) for t, s in zip(plan.leaps, leapt, strict=True)]
    steps = [climb.promise(seed, slopes) for seed, slopes in zip(plan.seeds, columns, strict=True)]
    best = sorted(range(len(steps)), key=lambda k: -steps[k][0])[:_SEEDS]
    further = [(climb.within(plan.seeds[k] + part * steps[k][1]), columns[k])
               for k in best if steps[k][0] > _PROMISING for part in _PARTS]  # fmt: skip
    if further:
        points = np.array([theta for theta, _ in further])
        again = scores_of(model, (*base.hypothesis, plan.name), points, base.episodes)
        tried += [climb.at(p, s, c) for (p, c), s in zip(further, again, strict=True)]
    reached = max(tried, key=lambda f: f.objective)
    mine = [np.concatenate(whitened(c))[:, plan.amplitudes] for c in columns]
    changed = [_change(base, s) for s in leapt]
    promised = steps[best[0]][0]
    return Look(plan.name, reached, promised, (*mine, *changed))


class _Climb:
    """Steps of a candidate's amplitudes; the base's parameters follow."""

    def __init__(
        self, ground: Ground, name: str, free: tuple[Free, ...], amplitudes: Sequence[int]
    ) -> None:
        self._ground, self._free, self._amplitudes = ground, free, list(amplitudes)
        self._hypothesis = (*ground.base.hypothesis, name)
        place = {n: i for i, n in enumerate(ground.base.names)}
        self._shared = [i for i, f in enumerate(free) if f.name in place]
        self._theirs = [place[free[i].name] for i in self._shared]

    def promise(self, seed: FloatArray, slopes: Slopes) -> tuple[float, FloatArray]:
        """The nats that a step promises, and the step (p,)."""
        columns = np.concatenate(whitened(slopes))[:, self._amplitudes]
        span = self._ground.residual(columns)
        pull = span.T @ self._ground.rest
        amplitudes = [self._free[i] for i in self._amplitudes]
        curvature = span.T @ span + np.diag(prior_precision(amplitudes))
        amount = np.linalg.lstsq(curvature, pull, rcond=1e-10)[0]
        there = seed[self._amplitudes] + amount
        amount = np.clip(there, *bounds_of(amplitudes)) - seed[self._amplitudes]
        step = np.zeros(len(self._free))
        step[self._amplitudes] = amount
        step[self._shared] = -(self._ground.followed(columns) @ amount)[self._theirs]
        return float(pull @ amount - 0.5 * amount @ curvature @ amount), np.nan_to_num(step)

    def within(self, theta: FloatArray) -> FloatArray:
        """A point moved to within the bounds."""
        return np.asarray(np.clip(theta, *bounds_of(self._free)))

    def at(self, theta: FloatArray, scores: tuple[Score, ...], slopes: Slopes) -> Fit:
        """A point with its scores; it takes the slopes of where the step began."""
        rescored = Slopes(scores, slopes.innovation, slopes.variance)
        episodes, density = self._ground.base.episodes, densities(scores)
        return Fit(self._hypothesis, self._free, episodes, theta, rescored, density)


def _seeds(
    starts: Sequence[FloatArray], origin: FloatArray, amplitudes: Sequence[int]
) -> list[FloatArray]:
    """Points with amplitudes at 0 and shapes at each of their starts."""
    seeds: dict[bytes, FloatArray] = {}
    for start in starts:
        seed = start.copy()
        seed[list(amplitudes)] = origin[list(amplitudes)]
        seeds[seed.tobytes()] = seed
    return list(seeds.values())


def starts_of(origin: FloatArray, free: Sequence[Free], places: Sequence[int]) -> list[FloatArray]:
    """Points with an effect's parameters (at `places`) at each of its starts, else as `origin`."""
    count = max(len(free[i].starts) for i in places)
    starts = []
    for k in range(count):
        start = origin.copy()
        for i in places:
            of = free[i].starts or (free[i].neutral,)
            start[i] = np.clip(of[min(k, len(of) - 1)], free[i].low, free[i].high)
        starts.append(start)
    return starts


def slopes_with(
    base: Fit,
    free: Sequence[Free],
    beside: Sequence[tuple[Score, ...]],
    moved: Sequence[tuple[int, FloatArray, float]],
) -> Slopes:
    """The base's slopes for what is shared, fresh ones for the effect's amplitudes."""
    place = {name: i for i, name in enumerate(base.names)}
    innovation, variance = [], []
    for e, score in enumerate(base.slopes.scores):
        de, dv = (np.zeros((len(score.innovation), len(free))) for _ in range(2))
        for i, f in enumerate(free):
            if f.name in place:
                de[:, i] = base.slopes.innovation[e][:, place[f.name]]
                dv[:, i] = base.slopes.variance[e][:, place[f.name]]
        for there, (i, _, size) in zip(beside, moved, strict=True):
            seen = _seen(there[e], score)
            de[:, i] = np.where(seen, there[e].innovation - score.innovation, 0.0) / size
            dv[:, i] = np.where(seen, there[e].variance - score.variance, 0.0) / size
        innovation.append(de)
        variance.append(dv)
    return Slopes(base.slopes.scores, tuple(innovation), tuple(variance))


def _change(base: Fit, scores: Sequence[Score]) -> FloatArray:
    """What an effect at a start changes, whitened, as one column (2n, 1)."""
    parts = []
    for here, there in zip(base.slopes.scores, scores, strict=True):
        root = np.sqrt(here.weight) * _seen(there, here)
        parts.append(root * (there.innovation - here.innovation) / np.sqrt(here.variance))
        parts.append(root * (there.variance - here.variance) / (here.variance * 2.0**0.5))
    return np.nan_to_num(np.concatenate(parts))[:, None]


def _seen(score: Score, other: Score) -> FloatArray:
    """The samples at which neither filter has lost track."""
    return np.asarray((score.log_density > LOST_NATS) & (other.log_density > LOST_NATS))
