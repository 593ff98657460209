"""Where the climb to an effect's best fit begins: sizes that are likely before anything follows.

In: a model, a fit of the base and an effect on top of it. Out: starts of climbs. A likelihood that
is jagged in a size has many summits; a base that has bent its constants to do without an effect is
a valley of its own.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from wakedeploy.gap.evidence.fits import (
    Fit,
    FloatArray,
    Free,
    Hypothesis,
    Model,
    extended,
    own_places,
)

GLANCED_AT = 2  # this many flights are enough to choose a start, and to come near a summit
_ROW = (-1.0, -0.4, -0.15, 0.15, 0.3, 0.6, 1.2)  # sizes tried, in widths of the prior
APART = 0.03  # sizes nearer to each other are one place to begin
# A scan before a first climb: how many episodes, how many sizes are kept, and how far apart.
_GLANCES = ((1, 200, 0.0), (2, 30, APART))
_SCANNED_CLIMBED = 4
_SUMMITS_CLIMBED = 12  # of an effect that was found
_MOVED_SD = 1.0  # a constant nearer to its calibration has not been bent
_ABSURD_NATS = 10.0  # a start worse than no effect by more is not worth climbing from

Scans = dict[tuple[Hypothesis, str, int], list[float]]  # the likeliest sizes of jagged parameters


class Related(Protocol):
    """What an effect says of others: which it is confused with, which constants it moves."""

    @property
    def confused_with(self) -> Sequence[str]:
        """Names of effects."""
        ...

    @property
    def constants(self) -> Sequence[str]:
        """The calibrated constants that its parameters stand for."""
        ...


def relations(model: Model) -> Mapping[str, Related]:
    """What is known of a model's effects, by name; nothing where it has no `relations`."""
    known: Mapping[str, Related] = getattr(model, "relations", {})
    return known


def scanned_starts(model: Model, found: Fit) -> list[FloatArray]:
    """The likeliest of the sizes that a fit's jagged parameters ask to be looked at, as starts.

    All are looked at on all episodes: on a single one, a lower summit may seem the highest.
    """
    return [
        start
        for i, free in enumerate(found.free)
        for start in _scanned(
            *(model, found.episodes, found.hypothesis, found.theta, free, i),
            keep=_SUMMITS_CLIMBED,
        )
    ]


def starts_of(
    model: Model,
    base: Fit,
    hypothesis: Hypothesis,
    free: tuple[Free, ...],
    places: Sequence[int],
    scans: Scans,
) -> list[FloatArray]:
    """The neutral point, and those of the effect's starts that are not absurd.

    Of a jagged parameter the likeliest scanned sizes are starts instead of those that it states.
    """
    neutral_point = extended(base, free)
    starts = [neutral_point]
    smooth = [i for i in places if not free[i].scanned]
    for k in range(max((len(free[i].starts) for i in smooth), default=0)):
        theta = neutral_point.copy()
        for i in smooth:
            theta[i] = free[i].starts[min(k, len(free[i].starts) - 1)]
        here = sum(model.score(hypothesis, theta, e).log_density.sum() for e in base.episodes)
        if here > base.log_likelihood - _ABSURD_NATS:
            starts.append(theta)
    points = [neutral_point]
    confusable = _constants_of_confused(relations(model), hypothesis[-1])
    bent = [
        i
        for i, f in enumerate(free)
        if f.quantity in confusable
        and i not in places
        and abs(neutral_point[i] - f.neutral) > _MOVED_SD * f.prior_sd
    ]
    if bent:
        # A base may have bent a constant for what the effect would explain, as a range sensor's
        # delay for the age of held readings: with both, the right size looks absurd.
        points.append(neutral_point.copy())
        points[1][bent] = [free[i].neutral for i in bent]
    for i in places:
        for k, point in enumerate(points):
            key = (hypothesis, free[i].name, k)
            if key not in scans:
                found = _scanned(
                    *(model, base.episodes, hypothesis, point, free[i], i),
                    glances=_GLANCES,
                    keep=_SCANNED_CLIMBED,
                )
                scans[key] = [float(start[i]) for start in found]
            starts += [np.where(np.arange(len(point)) == i, size, point) for size in scans[key]]
    return starts


def with_louder_noise(free: Sequence[Free], theta: FloatArray) -> FloatArray:
    """Parameters (p,) with the noise half-way to that of a first fit.

    For a start far from a summit: under the noise fitted elsewhere most samples would be outliers
    there, and a climb from outliers goes nowhere.
    """
    return np.array(
        [x if f.first is None else 0.5 * (x + f.first) for f, x in zip(free, theta, strict=True)]
    )


def unbent_sizes(
    model: Model, base: Fit, hypothesis: Hypothesis, name: str
) -> list[tuple[float, FloatArray]]:
    """Sizes of an effect, likeliest first, with the calibrated constants as they were measured.

    Noise is louder than the base's: see `with_louder_noise`.
    """
    free = model.free(hypothesis)
    places = own_places(free, name)
    plain = with_louder_noise(free, extended(base, free))
    plain = np.array([f.neutral if f.quantity else x for f, x in zip(free, plain, strict=True)])
    tried: list[tuple[float, FloatArray]] = []
    for k in range(len(_ROW) + max(len(free[i].starts) for i in places)):
        theta = plain.copy()
        for i in places:
            sizes = (*free[i].starts, *(free[i].neutral + r * free[i].prior_sd for r in _ROW))
            theta[i] = np.clip(sizes[min(k, len(sizes) - 1)], free[i].low, free[i].high)
        if any(np.array_equal(theta, known) for _, known in tried):
            continue  # several sizes may lie beyond one bound
        some = base.episodes[:GLANCED_AT]
        density = sum(float(model.score(hypothesis, theta, e).log_density.sum()) for e in some)
        tried.append((density, theta))
    return sorted(tried, key=lambda pair: -pair[0])


def _constants_of_confused(known: Mapping[str, Related], name: str) -> set[str]:
    """The calibrated constants moved by effects that this one is confused with."""
    if name not in known:
        return set()
    confused = {n for n, effect in known.items() if name in effect.confused_with}
    return {c for n in confused | {*known[name].confused_with} for c in known[n].constants}


def _scanned(
    model: Model,
    episodes: Sequence[int],
    hypothesis: Hypothesis,
    theta: FloatArray,
    free: Free,
    place: int,
    *,
    keep: int,
    glances: Sequence[tuple[int, int, float]] = (),
) -> list[FloatArray]:
    """The likeliest of the sizes that a parameter asks to be looked at, as starts.

    All are looked at on the first episodes, as many as `glances` say, and those that are likely
    there on all. No two are nearer than a few per cent: the sizes around one summit would crowd the
    others out.
    """
    density = dict.fromkeys(free.scanned, 0.0)
    seen = 0
    for count, most, apart in (*glances, (len(episodes), keep, APART)):
        for size in density:
            start = np.where(np.arange(len(theta)) == place, size, theta)
            scores = (model.score(hypothesis, start, e) for e in episodes[seen:count])
            density[size] += sum(float(s.log_density.sum()) for s in scores)
        density, seen = _likeliest(density, most, apart), max(seen, count)
    return [np.where(np.arange(len(theta)) == place, size, theta) for size in density]


def _likeliest(density: Mapping[float, float], most: int, apart: float) -> dict[float, float]:
    """The sizes of highest log density, highest first, none within `apart` of a higher one."""
    places: set[float] = set()
    kept: dict[float, float] = {}
    for size, value in sorted(density.items(), key=lambda pair: (-pair[1], -pair[0])):
        place = round(math.log(size) / apart) if apart else size
        if place not in places and len(kept) < most:
            kept[size] = value
            places.add(place)
    return kept
