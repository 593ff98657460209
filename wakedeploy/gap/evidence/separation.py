"""How well flights tell effects apart, before any of them is fitted to anything.

In: a `Model` and its base fit. Out: one information matrix per episode over nuisances and effects.
It gives the nats by which each rival of an effect loses, how often an effect will be detected and
named, and how these grow with more flights.

An effect changes the whitened innovations along its signature; nuisances with their priors explain
part of every signature (marginalised, as in a Kalman filter); what is left is Gaussian with unit
variance. Innovations are linear in the size of an effect to the accuracy that planning needs.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wakedeploy.gap.evidence.fits import (
    Fit,
    FloatArray,
    Free,
    Model,
    Slopes,
    extended,
    own_places,
    prior_precision,
    scores_of,
)

_TINY = 1e-10
_HELD = 1e14  # precision of what may not move
_MOST_DEVIATIONS = 2.0
_SMALLEST_SHARE = 1e-4
_SWEEPS = 20


@dataclass(frozen=True, eq=False)
class Column:
    """One direction in which an effect can move the innovations.

    It is the difference between what `hypothesis` says at the parameters `near` and `origin`, over
    `share`. `parameter` is empty for the effect as a whole, whose first parameter it moves by
    `amount`; `low` and `high` bound what a fit may use of it, in multiples of `amount`. A parameter
    that only shapes the effect does nothing without it, so its bounds go with the whole.
    """

    effect: str
    parameter: str
    unit: str
    amount: float
    low: float
    high: float
    hypothesis: tuple[str, ...]
    near: FloatArray
    origin: FloatArray
    share: float = 1.0
    is_shape: bool = False
    nuisances: tuple[tuple[int, float], ...] = ()  # (place, amount) where it is a sum of those


@dataclass(frozen=True, eq=False)
class Evidence:
    """Information about nuisances and effects: `gram` (E, q, q) per episode, nuisances first.

    `precision` (p,) is that of the nuisances' priors; `columns` name the q − p effect directions.
    `whole` (C, q − p) is how much of each direction the effects `names` are when they are the
    truth, at the sizes that they were evaluated at.
    """

    names: tuple[str, ...]
    columns: tuple[Column, ...]
    precision: FloatArray
    gram: FloatArray
    whole: FloatArray

    def information(self, copies: float = 1.0) -> FloatArray:
        """Marginal information over the effect directions (c, c), from `copies` of all episodes."""
        total, p = copies * self.gram.sum(0), len(self.precision)
        nuisance = total[:p, :p] + np.diag(self.precision)
        scale = 1.0 / np.sqrt(np.maximum(np.diag(nuisance), _TINY))
        known = nuisance * scale[:, None] * scale[None, :]
        shared = scale[:, None] * total[:p, p:]
        explained = shared.T @ np.linalg.lstsq(known, shared, rcond=1e-12)[0]
        remainder = total[p:, p:] - explained
        return np.asarray(0.5 * (remainder + remainder.T))

    def of(self, name: str) -> list[int]:
        """The directions of an effect."""
        return [i for i, c in enumerate(self.columns) if c.effect == name]


def gather(
    model: Model,
    base: Fit,
    names: Sequence[str],
    sizes: Mapping[str, Sequence[float]] | None = None,
    progress: Callable[[], None] | None = None,
) -> Evidence:
    """Evaluate every effect on the episodes of `base`.

    `sizes` are the parameters at which an effect is evaluated; one that is not there is evaluated
    at one prior scale (its last start).
    """
    columns: list[Column] = []
    directions: list[list[FloatArray]] = []  # per column, per episode (2n,)
    nuisances = whitened(base.slopes)
    for name in names:
        target = _Target.of(model, base, name, None if sizes is None else sizes.get(name))
        if len(target.claimed) == len(target.places):
            moved = _of_nuisances(model, base, target, nuisances)
        else:
            moved = _directions(model, base, target)
        for column, direction in moved:
            columns.append(column)
            directions.append(direction)
        if progress is not None:
            progress()
    grams = []
    for i, nuisance in enumerate(nuisances):
        movement = np.stack([d[i] for d in directions], axis=1)
        everything = np.hstack([nuisance, movement])
        grams.append(everything.T @ everything)
    precision = np.array([1.0 / f.prior_sd**2 for f in base.free])
    whole = np.array([[_share(c, name) for c in columns] for name in names])
    return Evidence(tuple(names), tuple(columns), precision, np.array(grams), whole)


def _share(column: Column, name: str) -> float:
    """The whole of an effect is its first direction; the others are what a fit may add."""
    return 1.0 if column.effect == name and column.parameter == "" else 0.0


@dataclass(frozen=True, eq=False)
class _Target:
    """An effect to be evaluated: its hypothesis with the parameters without it and with it.

    `places` are the places of its parameters. `claimed` are the base's nuisances that it replaces:
    calibrated constants that it moves further than calibration allows.
    """

    name: str
    hypothesis: tuple[str, ...]
    free: tuple[Free, ...]
    places: tuple[int, ...]
    neutral: FloatArray
    there: FloatArray
    claimed: tuple[int, ...]

    @classmethod
    def of(cls, model: Model, base: Fit, name: str, size: Sequence[float] | None) -> "_Target":
        hypothesis = (*base.hypothesis, name)
        free = model.free(hypothesis)
        parameters = tuple(own_places(free, name))
        places = {f.quantity: i for i, f in enumerate(base.free) if f.quantity}
        claimed = tuple(places[free[i].quantity] for i in parameters if free[i].quantity in places)
        neutral = extended(base, free)
        for i in parameters:
            neutral[i] = free[i].neutral
        there = neutral.copy()
        for k, i in enumerate(parameters):
            start = free[i].starts[min(1, len(free[i].starts) - 1)] if size is None else size[k]
            there[i] = np.clip(start, free[i].low, free[i].high)
        return cls(name, hypothesis, free, parameters, neutral, there, claimed)


def _of_nuisances(
    model: Model, base: Fit, target: _Target, nuisances: Sequence[FloatArray]
) -> list[tuple[Column, list[FloatArray]]]:
    """An effect on constants that are nuisances of the base: the same directions, without priors.

    They have to be exactly the same: flights know these constants so well that the least curvature
    would pass for a difference. They are taken over the effect's size, not over a step: a delay of
    a millisecond moves only the few servo frames beside a change of command. `nuisances` are
    changed in place.
    """
    hypothesis, neutral = target.hypothesis, target.neutral
    origin = changes(model, base, hypothesis, neutral)
    whole = [np.zeros(len(o)) for o in origin]
    found = []
    for i, place in zip(target.places, target.claimed, strict=True):
        there, free = neutral.copy(), target.free[i]
        there[i] = target.there[i]
        amount = float(there[i] - neutral[i]) or 1.0
        share, near = _response(model, base, hypothesis, (neutral, there), origin)
        at = neutral + share * (there - neutral)
        for e, (n, o) in enumerate(zip(near, origin, strict=True)):
            nuisances[e][:, place] = (n - o) / (share * amount)
            whole[e] += nuisances[e][:, place] * amount
        low, high = sorted((b - target.there[i]) / amount for b in (free.low, free.high))
        column = Column(
            target.name, free.name, free.unit, amount, low, high, hypothesis, at, neutral, share,
            nuisances=((place, amount),),
        )  # fmt: skip
        found.append((column, [n[:, place] * amount for n in nuisances]))
    sums = tuple(pair for column, _ in found for pair in column.nuisances)
    first = replace(_whole_column(target), nuisances=sums)
    return [(first, whole), *found[1:]]


def _directions(model: Model, base: Fit, target: _Target) -> list[tuple[Column, list[FloatArray]]]:
    """The effect as a whole first, then its parameters one by one where it has several."""
    name, hypothesis, free, places = target.name, target.hypothesis, target.free, target.places
    neutral, there = target.neutral, target.there
    origin = changes(model, base, hypothesis, neutral)
    share, near = _response(model, base, hypothesis, (neutral, there), origin)
    whole = [(n - o) / share for n, o in zip(near, origin, strict=True)]
    at = neutral + share * (there - neutral)
    found = [(replace(_whole_column(target), near=at, share=share), whole)]
    for i in places[1:]:
        step = -free[i].step if at[i] - free[i].step >= free[i].low else free[i].step
        aside, alone = at.copy(), neutral.copy()
        aside[i] += step
        alone[i] += step
        moved = changes(model, base, hypothesis, aside)
        unmoved = changes(model, base, hypothesis, alone)
        bounds = sorted(((free[i].low - at[i]) / -step, (free[i].high - at[i]) / -step))
        found.append(
            (
                Column(
                    effect=name,
                    parameter=free[i].name,
                    unit=free[i].unit,
                    amount=-step,
                    low=bounds[0],
                    high=bounds[1],
                    hypothesis=hypothesis,
                    near=at,
                    origin=aside,
                    is_shape=all(np.allclose(u, o) for u, o in zip(unmoved, origin, strict=True)),
                ),
                [n - m for n, m in zip(near, moved, strict=True)],
            )
        )
    return found


def _response(
    model: Model,
    base: Fit,
    hypothesis: tuple[str, ...],
    ends: tuple[FloatArray, FloatArray],
    origin: list[FloatArray],
) -> tuple[float, list[FloatArray]]:
    """The share of the way from neutral to the effect that was taken, and the `changes` there.

    It goes as far as no sample moves by more than two standard deviations: beyond, a filter would
    take good samples for outliers and lose track, which a fit to data does not.
    """
    share = 1.0
    while True:
        moved = changes(model, base, hypothesis, ends[0] + share * (ends[1] - ends[0]))
        furthest = max(
            float(np.abs((m - o)[: len(m) // 2]).max(initial=0.0))
            for m, o in zip(moved, origin, strict=True)
        )
        if furthest <= _MOST_DEVIATIONS or share < _SMALLEST_SHARE:
            return share, moved
        share *= max(0.1, min(0.5, 0.7 * _MOST_DEVIATIONS / furthest))


def _whole_column(target: _Target) -> Column:
    first = target.places[0]
    free, neutral = target.free[first], target.neutral
    amount = float(target.there[first] - neutral[first]) or 1.0
    bounds = sorted((b - neutral[first]) / amount for b in (free.low, free.high))
    return Column(
        effect=target.name,
        parameter="",
        unit=free.unit,
        amount=amount,
        low=bounds[0],
        high=bounds[1],
        hypothesis=target.hypothesis,
        near=target.there,
        origin=neutral,
    )


def changes(
    model: Model, base: Fit, hypothesis: tuple[str, ...], theta: FloatArray
) -> list[FloatArray]:
    """Innovations and variances minus the base's, whitened, (2n,) per episode."""
    parts = []
    moved = scores_of(model, hypothesis, np.asarray(theta)[None], base.episodes)[0]
    for score, there in zip(base.slopes.scores, moved, strict=True):
        root = np.sqrt(score.weight)
        shift = root * (there.innovation - score.innovation) / np.sqrt(score.variance)
        stretch = root * (there.variance - score.variance) / (score.variance * 2.0**0.5)
        parts.append(np.concatenate([shift, stretch]))
    return parts


def whitened(slopes: Slopes) -> list[FloatArray]:
    """Derivatives by the base's parameters in the units of `changes`, (2n, p) per episode."""
    parts = []
    for s, de, dv in zip(slopes.scores, slopes.innovation, slopes.variance, strict=True):
        root = np.sqrt(s.weight)[:, None]
        shift = root * de / np.sqrt(s.variance)[:, None]
        parts.append(np.vstack([shift, root * dv / (s.variance[:, None] * 2.0**0.5)]))
    return parts


def loss_nats(evidence: Evidence, copies: float = 1.0) -> FloatArray:
    """Nats that the best version of rival j loses when effect i is the truth, (C, C)."""
    information = evidence.information(copies)
    count = len(evidence.names)
    loss = np.zeros((count, count))
    for i, truth in enumerate(evidence.whole):
        for j, rival in enumerate(evidence.names):
            if i != j:
                loss[i, j] = _unexplained_nats(information, truth, evidence, rival)
    return loss


def gain_nats(evidence: Evidence, copies: float = 1.0) -> FloatArray:
    """Nats that each effect gains on the base when it is the truth, (C,)."""
    information = evidence.information(copies)
    return np.array([0.5 * float(w @ information @ w) for w in evidence.whole])


def lost_to_form(evidence: Evidence, free: Sequence[Free]) -> FloatArray:
    """The share of each effect's nats that the model's own form can imitate, (C,) from 0 to 1.

    `free` are the nuisances of the evidence. No flight can name an effect that loses everything.
    """
    held = np.where([f.is_form for f in free], _HELD, evidence.precision)
    alone = gain_nats(replace(evidence, precision=held))
    return np.asarray(np.clip(1.0 - gain_nats(evidence) / np.maximum(alone, _TINY), 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Explained:
    """What a fit's free parameters imitate; it is the same for every effect held against it.

    `known` (N, p) are its whitened slopes; `directions` (N + p, p) span them and the priors.
    """

    known: FloatArray
    directions: FloatArray


def explained(base: Fit) -> Explained:
    """What all free parameters of a fit can imitate."""
    known = np.concatenate(whitened(base.slopes))
    prior = np.sqrt(prior_precision(base.free))
    directions, _ = np.linalg.qr(np.vstack([known, np.diag(prior)]))
    return Explained(known, directions)


def information(
    model: Model, base: Fit, beside: Explained, name: str, size: float | None = None
) -> FloatArray:
    """Fisher information of an effect's own parameters (k, k), with all free ones readjusted.

    It is taken where the effect is not there: half of it times a size squared is what an effect of
    that size gains [nats]. With `size`, it is from the change that this size of its parameters
    makes. An effect that moves a calibrated constant is seen against that constant's prior.
    `beside` is what the base explains.
    """
    hypothesis = (*base.hypothesis, name)
    free = model.free(hypothesis)
    theta = extended(base, free)
    calibrated = {f.quantity: i for i, f in enumerate(base.free) if f.quantity}
    columns = []
    for i in own_places(free, name):
        f = free[i]
        if f.quantity in calibrated:
            columns.append(beside.known[:, calibrated[f.quantity]])
            continue
        moved = theta.copy()
        step = f.step if size is None else size
        moved[i] += step
        columns.append(np.concatenate(changes(model, base, hypothesis, moved)) / step)
    span, q = np.stack(columns, axis=1), beside.directions
    padded = np.vstack([span, np.zeros((len(q) - len(span), span.shape[1]))])
    rest = padded - q @ (q.T @ padded)
    return np.asarray(rest.T @ rest)


def _unexplained_nats(
    information: FloatArray, truth: FloatArray, evidence: Evidence, rival: str
) -> float:
    rows = evidence.of(rival)
    pull = information[rows] @ truth
    share = fitted_shares(information[np.ix_(rows, rows)], pull[None, :], evidence, rows)[0]
    explained = share @ pull - 0.5 * share @ information[np.ix_(rows, rows)] @ share
    return max(0.0, 0.5 * float(truth @ information @ truth) - float(explained))


def fitted_shares(
    gram: FloatArray, pulls: FloatArray, evidence: Evidence, places: Sequence[int]
) -> FloatArray:
    """What a fit uses of a rival's directions (n, k), each within its bounds.

    It starts at the unbounded optimum and moves one direction after another: the problem is convex.
    """
    columns = [evidence.columns[i] for i in places]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), _TINY))
    scaled = gram * scale[:, None] * scale[None, :]
    shares = (np.linalg.lstsq(scaled, (scale * pulls).T, rcond=1e-8)[0].T * scale).copy()
    for _ in range(_SWEEPS if len(places) > 1 else 1):
        before = shares.copy()
        for k, column in enumerate(columns):
            rest = pulls[:, k] - shares @ gram[:, k] + shares[:, k] * gram[k, k]
            reach = np.maximum(shares[:, 0], 0.0) if column.is_shape else 1.0
            best = rest / max(gram[k, k], _TINY)
            shares[:, k] = np.clip(best, reach * column.low, reach * column.high)
        if np.allclose(shares, before, rtol=1e-4, atol=1e-6):
            break
    return np.asarray(shares)
