"""How large an effect must be to be named on logs like these.

In: a `LogModel` and its base fit. Out: for every effect the sizes from which it is detected, from
which it is named alone, and from which forecasts get better by it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.fits import Fit, FloatArray, extended, own_places
from wakedeploy.gap.progress import StepsDone, uncounted
from wakedeploy.gap.rules import RULES, surely_nats
from wakedeploy.gap.search.comparison import mean_squares
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.responses import GRID, Responses, lost_nats

_DRAWS = 1600
_TINY = 1e-12
_CUT = 1.0 - 1e-9  # of the largest size of a grid: less was cut at a bound


@dataclass(frozen=True)
class EffectPower:
    """One effect: sizes of its first parameter, `unit`; infinite where no size that was tried will.

    Of one that may have either sign, those from which it is told whichever it has.
    `detected` gains more than chance, `named` is also ahead of `rival`, the effect that imitates it
    best there; `matters` changes forecasts enough. Sizes up to the `largest` were tried.
    """

    name: str
    parameter: str
    unit: str
    detected: float
    named: float
    rival: str
    matters: float
    largest: float

    @property
    def least(self) -> float:
        """The size from which it is named and kept."""
        return max(self.detected, self.named, self.matters)


@dataclass(frozen=True)
class Power:
    """The whole answer: gains have to exceed `threshold_nats`.

    `missing` is the effect that these very logs show already, with what it would gain, roughly
    [nats]; the noise is then that of a model without it, and all sizes come out too large.
    """

    threshold_nats: float
    effects: tuple[EffectPower, ...]
    missing: tuple[str, float] | None


def power(
    model: LogModel, base: Fit, names: Sequence[str] | None = None, steps: StepsDone = uncounted
) -> Power:
    """What logs of this length and motion can show of each effect in `names`, by default of all.

    "All" leaves out those that have no size, as a sensor's limit, which vanishes far away.
    Raises UnusableInput for an effect that the system does not have, or that has no size.
    """
    model.require_effects()
    sized = [n for n, free in model.effects.items() if any(f.neutral == 0.0 for f in free)]
    chosen = tuple(n for n in (sized if names is None else names) if n not in base.hypothesis)
    model.acting(chosen)
    for name in chosen:
        if name not in sized:
            raise UnusableInput(
                f"{name} has no size that could be small or large: its limit is wherever readings "
                "end. Leave it out."
            )
    responses = Responses(model, base)
    curves: dict[str, FloatArray] = {}
    for done, name in enumerate(chosen, 1):
        points = responses.scaled(name, responses.usual(name), GRID)
        changes = responses.of(name, points.reshape(-1, points.shape[-1]))
        curves[name] = _followed(changes.reshape(*points.shape[:2], -1))
        steps(done, len(chosen))
    threshold = chance(curves)
    effects = tuple(_of(responses, curves, n, threshold) for n in chosen)
    return Power(threshold, effects, _missing(curves, responses.rest, threshold))


def _missing(
    curves: Mapping[str, FloatArray], rest: FloatArray, threshold: float
) -> tuple[str, float] | None:
    """What gains most in what the base leaves (m,), and how much, if chance hardly ever does.

    Each size that was tried is a chance of its own where an effect does something else at each, as
    steps of a quantised input do: the best of many gains more from noise than one.
    """
    gains = {n: _gained(rows, rest) for n, rows in curves.items()}
    best = max(gains, key=lambda n: gains[n], default="")
    if not best or gains[best] <= surely_nats(threshold):
        return None
    each = {n: rows.reshape(-1, 1, rows.shape[-1]) for n, rows in curves.items()}
    return (best, gains[best]) if gains[best] > surely_nats(chance(each)) else None


def _followed(rows: FloatArray) -> FloatArray:
    """Changes (S, g, m) at rising sizes; from where the system leaves its model, as before it."""
    for curve in rows:
        for k, row in enumerate(curve):
            if not np.all(np.isfinite(row)):
                curve[k] = curve[k - 1] if k else 0.0
    return rows


def _gained(rows: FloatArray, rest: FloatArray) -> float:
    """What an effect of some size near those that were tried (S, g, m) gains in these logs [nats].

    `rest` (m,) is what the base leaves.
    """
    pulls, squares = rows @ rest, (rows**2).sum(-1)
    near = 10.0 ** (0.5 * np.log10(GRID[1] / GRID[0]))
    part = np.clip(pulls / np.maximum(squares, _TINY), 0.0, near)
    return float((part * pulls - 0.5 * part**2 * squares).max(initial=0.0))


def chance(curves: Mapping[str, FloatArray]) -> float:
    """The best gain of any effect that noise alone exceeds in one of twenty logs [nats]."""
    if not curves:
        return RULES.least_nats
    directions = np.array([c[0] for rows in curves.values() for c in rows])
    size = np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions[size[:, 0] > _TINY] / size[size[:, 0] > _TINY]
    if not len(directions):
        return RULES.least_nats
    value, vector = np.linalg.eigh(directions @ directions.T)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    pulls = np.random.default_rng(0).standard_normal((_DRAWS, len(value))) @ root.T
    return max(
        float(np.quantile(0.5 * (pulls**2).max(1) - 1.0, 1.0 - RULES.false_alarms)),
        RULES.least_nats,
    )


def _of(
    responses: Responses, curves: Mapping[str, FloatArray], name: str, threshold: float
) -> EffectPower:
    """One effect, of the sign that takes the larger size, where it may have either."""
    firsts = responses.usual(name)[:, 0]
    against = np.flatnonzero(firsts * firsts[0] < 0.0)[:1]
    each = [_of_start(responses, curves, name, k, threshold) for k in (0, *map(int, against))]
    worst = max(each, key=lambda e: (e.named, e.least))
    return replace(
        worst,
        detected=max(e.detected for e in each),
        matters=max(e.matters for e in each),
    )


def _of_start(
    responses: Responses, curves: Mapping[str, FloatArray], name: str, k: int, threshold: float
) -> EffectPower:
    """One effect, at one of its starts."""
    free = responses.model.effects[name]
    first = responses.usual(name)[k : k + 1]
    rows = curves[name][k]
    reached = 1 + int(np.flatnonzero(np.any(np.diff(rows, axis=0) != 0.0, axis=1)).max(initial=-1))
    sizes = np.abs(responses.scaled(name, first, GRID)[0, :, 0])
    rivals = [n for n in curves if n != name]
    losses = np.array([[lost_nats(row, curves[n]) for n in rivals] for row in rows])
    gains = 0.5 * (rows**2).sum(1)
    detected = _crossing(sizes, gains, surely_nats(threshold + len(free)))
    closest = losses.min(1) if rivals else np.full(len(rows), math.inf)
    named = max(detected, _crossing(sizes, closest, surely_nats(RULES.class_nats)))
    at = int(np.searchsorted(sizes, named if math.isfinite(named) else sizes[-1]))
    rival = rivals[int(losses[min(at, len(rows) - 1)].argmin())] if rivals else ""
    matters = sizes[0] * _mattering(responses, name, first)
    parameter = free[0].name.removeprefix(f"{name}.")
    unit, largest = free[0].unit, float(sizes[reached])  # beyond, the system leaves its model
    return EffectPower(name, parameter, unit, detected, named, rival, matters, largest)


def _crossing(sizes: FloatArray, nats: FloatArray, wanted: float) -> float:
    """The size from which nats are above what is wanted; nats grow with its square in between.

    They stay above at the next larger size as well, but where that is a bound. Far beyond, effects
    may look alike again: a dead band and a coarse step that both swallow every command; and a gain
    that lets nothing through is no reason not to name one that lets half through.
    """
    above = nats >= wanted
    is_bound = (sizes[1:] == sizes[-1]) & (sizes[-1] < _CUT * sizes[0] * GRID[-1] / GRID[0])
    lasting = np.flatnonzero(above & np.append(above[1:] | is_bound, True))
    if not lasting.size:
        return math.inf
    first = int(lasting[0])
    if first == 0:
        return float(sizes[0] * math.sqrt(wanted / nats[0]))
    low, high = (math.log(max(n, _TINY)) for n in nats[first - 1 : first + 1])
    if low >= high:
        return float(sizes[first])
    part = (math.log(wanted) - low) / (high - low)
    return float(sizes[first - 1] * (sizes[first] / sizes[first - 1]) ** part)


def _mattering(responses: Responses, name: str, first: FloatArray) -> float:
    """The multiple of the smallest size that is a hundredth of the squared forecast error."""
    model, base = responses.model, responses.base
    hypothesis = (*base.hypothesis, name)
    free = model.free(hypothesis)
    places = own_places(free, name)
    far = int(np.argmin(np.abs(GRID - 0.03)))
    there = extended(base, free)
    there[places] = responses.scaled(name, first, GRID)[0, far]
    with_it = replace(base, hypothesis=hypothesis, free=free, theta=there)
    parts = [np.concatenate(model.disagreements(f, base.episodes), 1) for f in (with_it, base)]
    error, moved = mean_squares(parts[1]), mean_squares(parts[0] - parts[1])
    most = float(np.max(moved / np.maximum(error, _TINY)))
    if not most > _TINY:
        return math.inf
    return float(GRID[far] / GRID[0]) * math.sqrt(
        RULES.least_share / (1.0 - RULES.least_share) / most
    )
