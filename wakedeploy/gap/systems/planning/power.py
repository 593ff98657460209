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
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.responses import GRID, Responses, lost_nats

_DRAWS = 1600
_TINY = 1e-12


@dataclass(frozen=True)
class EffectPower:
    """One effect: sizes of its first parameter, `unit`; infinite where no size that was tried will.

    `detected` gains more than chance, `named` is also ahead of `rival`, the effect that imitates it
    best there; `matters` changes forecasts enough.
    """

    name: str
    parameter: str
    unit: str
    detected: float
    named: float
    rival: str
    matters: float

    @property
    def least(self) -> float:
        """The size from which it is named and kept."""
        return max(self.detected, self.named, self.matters)


@dataclass(frozen=True)
class Power:
    """The whole answer: gains have to exceed `threshold_nats`."""

    threshold_nats: float
    effects: tuple[EffectPower, ...]


def power(
    model: LogModel, base: Fit, names: Sequence[str] | None = None, steps: StepsDone = uncounted
) -> Power:
    """What logs of this length and motion can show of each effect in `names`, by default of all.

    "All" leaves out those that have no size, as a sensor's limit, which vanishes far away.
    Raises UnusableInput for an effect that the system does not have, or that has no size.
    """
    model.require_effects()
    sized = [n for n, free in model.effects.items() if any(f.neutral == 0.0 for f in free)]
    chosen = tuple(sized if names is None else names)
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
        curves[name] = changes.reshape(*points.shape[:2], -1)
        steps(done, len(chosen))
    threshold = chance(curves)
    return Power(threshold, tuple(_of(responses, curves, n, threshold) for n in chosen))


def chance(curves: Mapping[str, FloatArray]) -> float:
    """The best gain of any effect that noise alone exceeds in one of twenty logs [nats]."""
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
    """One effect, at the first of its starts."""
    free = responses.model.effects[name]
    first = responses.usual(name)[:1]
    sizes = np.abs(responses.scaled(name, first, GRID)[0, :, 0])
    rows = curves[name][0]
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
    return EffectPower(name, parameter, free[0].unit, detected, named, rival, matters)


def _crossing(sizes: FloatArray, nats: FloatArray, wanted: float) -> float:
    """The size from which nats stay above what is wanted; nats grow with its square in between."""
    below = np.flatnonzero(~(nats >= wanted))
    if not below.size:
        return float(sizes[0] * math.sqrt(wanted / nats[0]))
    last = int(below[-1])
    if last + 1 == len(sizes):
        return math.inf
    low, high = (math.log(max(n, _TINY)) for n in nats[last : last + 2])
    part = (math.log(wanted) - low) / (high - low)
    return float(sizes[last] * (sizes[last + 1] / sizes[last]) ** part)


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
    error = np.nanmean(parts[1] ** 2, axis=1)
    moved = np.nanmean((parts[0] - parts[1]) ** 2, axis=1)
    most = float(np.max(moved / np.maximum(error, _TINY)))
    if not most > _TINY:
        return math.inf
    return float(GRID[far] / GRID[0]) * math.sqrt(
        RULES.least_share / (1.0 - RULES.least_share) / most
    )
