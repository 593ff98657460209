"""Where simulation and measurement disagree, beyond noise, in any system.

In: series of residuals with the coordinates that they may depend on. Out: maps of the residuals
over each coordinate, and a ranked list of places in words. Residuals are permuted in blocks longer
than their correlation and within each episode, so that a map's p value holds for coloured residuals
and for episodes that differ as a whole; false discoveries are controlled over all maps (Benjamini
and Hochberg 1995).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Map, Place
from wakedeploy.gap.wording import minus, signs

IntArray = npt.NDArray[np.int64]
Orders = npt.NDArray[np.int32]
BoolArray = npt.NDArray[np.bool_]

INNOVATION = "innovation"  # it has no unit: it says that something is off, not by how much
_BINS = 8
_FEWEST = 80  # residuals that a map is made of
_PERMUTATIONS = 999  # the fewest with which one map among all can be significant
_CLEAR_SE = 2.0
_MOST_PLACES = 12
_MOST_OF_INNOVATIONS = 4


@dataclass(frozen=True, eq=False)
class Residuals:
    """One episode's residuals of one channel at some times (n,), and the coordinates there (n,)."""

    channel: str
    at_s: FloatArray
    value: FloatArray
    coordinates: dict[str, FloatArray]


@dataclass(frozen=True)
class Axes:
    """What residuals are of and over: channels' units, coordinates' units, blocks' lengths.

    A coordinate also says whether it is known whatever the system does. A block [s] is longer than
    a channel's residuals stay alike.
    """

    channels: Mapping[str, str]
    coordinates: Mapping[str, tuple[str, bool]]
    block_s: Mapping[str, float]


def disagreements(
    series: Mapping[str, Sequence[Residuals]], axes: Axes, least: Mapping[str, float] | None = None
) -> tuple[list[Map], list[Place]]:
    """Maps of every channel's residuals, and the places that stand out in them.

    A place counts from the size `least` of its channel on, in its unit; a channel without one
    counts by its q value alone. Places are sorted by q value, then by how far their map stands out
    of its shuffles; innovations come after the other channels.
    """
    maps = [m for each in series.values() for m in _maps(each, axes)]
    of_all = q_values([m.p_value for m in maps])
    maps = [m.model_copy(update={"q_value": q}) for m, q in zip(maps, of_all, strict=True)]
    maps.sort(key=lambda m: (m.q_value, -m.clarity))
    found = [p for m in maps if m.q_value <= RULES.false_discoveries for p in _places(m)]
    return maps, _ranked(found, dict(least or {}))


def _ranked(places: Sequence[Place], limits: Mapping[str, float]) -> list[Place]:
    """Places beyond their channel's limit, the most significant first.

    Innovations have neither newtons nor millimetres: they come last and push no other place out.
    """

    def key(place: Place) -> tuple[float, bool, float, float]:
        white = place.channel == INNOVATION
        return place.q_value, white, -place.clarity, -abs(place.residual)

    beyond = [p for p in places if abs(p.residual) > limits.get(p.channel, 0.0)]
    beyond.sort(key=key)
    physical = [p for p in beyond if p.channel != INNOVATION][:_MOST_PLACES]
    white = [p for p in beyond if p.channel == INNOVATION][:_MOST_OF_INNOVATIONS]
    return sorted([*physical, *white], key=key)


def q_values(p: Sequence[float]) -> list[float]:
    """Benjamini–Hochberg: the false-discovery rate at which each would just be reported."""
    order = np.argsort(p)
    count = len(order)
    ranked = np.asarray(p, float)[order] * count / np.arange(1, count + 1)
    q = np.minimum.accumulate(ranked[::-1])[::-1]
    result = np.empty(count)
    result[order] = np.minimum(q, 1.0)
    return [float(v) for v in result]


def _maps(series: Sequence[Residuals], axes: Axes) -> list[Map]:
    """A channel's maps over every coordinate that varies, and its mean over all places.

    Their q values are only known once all other channels are.
    """
    length = block_length(series, axes)
    rng = np.random.default_rng([len(s.value) for s in series])
    orders = _orders([len(s.value) for s in series], length, rng)
    each = (_map(series, name, length, orders, axes) for name in axes.coordinates)
    return [*(m for m in each if m is not None), _everywhere(series, length, axes)]


def block_length(series: Sequence[Residuals], axes: Axes) -> int:
    """Samples of a block of a channel's residuals."""
    spacing_s = np.median(np.concatenate([np.diff(s.at_s) for s in series]))
    return max(round(axes.block_s[series[0].channel] / float(spacing_s)), 1)


def _map(
    series: Sequence[Residuals], name: str, length: int, orders: Orders, axes: Axes
) -> Map | None:
    """Mean residual in bins of one coordinate, with a permutation test of "depends on it"."""
    unit, exogenous = axes.coordinates[name]
    coordinate = np.concatenate([s.coordinates[name] for s in series])
    value = np.concatenate([s.value for s in series])
    known = np.isfinite(coordinate) & np.isfinite(value)
    if known.sum() < _FEWEST:
        return None
    edges = np.unique(np.quantile(coordinate[known], np.linspace(0.0, 1.0, _BINS + 1)))
    if len(edges) < 3:
        return None
    bins = np.where(known, np.clip(np.digitize(coordinate, edges[1:-1]), 0, len(edges) - 2), -1)
    inside = np.equal.outer(bins, np.arange(len(edges) - 1)).astype(float)  # (n, bins)
    number = np.maximum(inside.sum(0), 1.0)
    if any(_varies(s.coordinates[name]) for s in series):
        centred = _centred(value, known, [len(s.value) for s in series])
        # A row at a time: of an hour of flights, all shuffles together would fill a gigabyte.
        shuffled = np.array([_strength(centred[order], inside, number) for order in orders])
    else:
        centred = _centred(value, known, [len(value)])
        shuffled = _between_episodes(centred, bins, series)
    strength = _strength(centred, inside, number)
    p_value, clarity = _judged(strength, shuffled)
    blocks = blocks_of(series, length)
    means, errors, counts = bin_means(value, bins, blocks, len(edges) - 1)
    visits = np.array(
        [np.bincount(bins[b][bins[b] >= 0], minlength=len(edges) - 1) for b in blocks]
    )
    return Map(
        channel=series[0].channel,
        coordinate=name,
        exogenous=exogenous,
        unit=axes.channels[series[0].channel],
        coordinate_unit=unit,
        edges=edges.tolist(),
        mean=means.tolist(),
        low=(means - 1.645 * errors).tolist(),
        high=(means + 1.645 * errors).tolist(),
        count=counts.tolist(),
        blocks=(visits > 0).sum(0).tolist(),
        p_value=p_value,
        q_value=math.nan,
        clarity=clarity,
        strength=strength / max(_mean_square(centred) * len(value), 1e-300),
    )


def _judged(strength: float, shuffled: FloatArray) -> tuple[float, float]:
    """The share of shuffles as strong as the map, and by how many deviations it exceeds them.

    Many p values are the least that this number of shuffles can give; deviations still show which
    of them stands out the most, whatever the channel.
    """
    beaten = int((shuffled >= strength * (1.0 - 1e-12)).sum())
    deviation = max(float(shuffled.std()), 1e-300)
    return (beaten + 1) / (len(shuffled) + 1), (strength - float(shuffled.mean())) / deviation


def _varies(values: FloatArray) -> bool:
    finite = values[np.isfinite(values)]
    return len(finite) > 0 and bool(np.ptp(finite) > 0.0)


def _between_episodes(value: FloatArray, bins: IntArray, series: Sequence[Residuals]) -> FloatArray:
    """Strengths where episodes exchange a coordinate that each of them holds still."""
    firsts = np.cumsum([0, *(len(s.value) for s in series[:-1])])
    sums, counts = np.add.reduceat(value, firsts), [len(s.value) for s in series]
    rng = np.random.default_rng(len(value))
    shuffled = []
    for _ in range(_PERMUTATIONS):
        of = rng.permutation(bins[firsts])
        number = np.maximum(np.bincount(of, counts), 1.0)
        shuffled.append(float((np.bincount(of, sums) ** 2 / number).sum()))
    return np.array(shuffled)


def _everywhere(series: Sequence[Residuals], length: int, axes: Axes) -> Map:
    """The mean over all places, against the spread of its blocks (each block's sign flipped).

    It asks whether these flights as a whole are off by more than noise; so a flight's own mean
    counts here, while the maps leave it out.
    """
    value = np.concatenate([s.value for s in series])
    sums = np.array([value[b].sum() for b in blocks_of(series, length)])
    rng = np.random.default_rng(len(value))
    flips = rng.choice([-1.0, 1.0], size=(_PERMUTATIONS, len(sums)))
    p_value, clarity = _judged(float(sums.sum()) ** 2, np.asarray((flips @ sums) ** 2))
    mean, error = float(value.mean()), float(np.sqrt((sums**2).sum()) / len(value))
    return Map(
        channel=series[0].channel,
        coordinate="everywhere",
        exogenous=True,
        unit=axes.channels[series[0].channel],
        coordinate_unit="",
        edges=[0.0, 1.0],
        mean=[mean],
        low=[mean - 1.645 * error],
        high=[mean + 1.645 * error],
        count=[len(value)],
        p_value=p_value,
        q_value=math.nan,
        clarity=clarity,
        strength=mean**2 / _mean_square(value) if len(value) else 0.0,
    )


def blocks_of(series: Sequence[Residuals], length: int) -> list[IntArray]:
    """Indices of blocks of `length` samples, none across two flights."""
    blocks, offset = [], 0
    for s in series:
        count = len(s.value)
        blocks += [
            offset + np.arange(first, min(first + length, count))
            for first in range(0, count, length)
        ]
        offset += count
    return blocks


def _orders(counts: Sequence[int], length: int, rng: np.random.Generator) -> Orders:
    """Indices (permutations, n) that shuffle blocks of `length` samples within each flight.

    A flight has few blocks, so where they are cut is drawn, too, on the flight bent into a ring;
    the ring breaks only one more pair of neighbours.
    """
    orders = np.empty((_PERMUTATIONS, sum(counts)), np.int32)
    offset = 0
    for count in counts:
        for row in orders:
            ring = (rng.integers(max(count, 1)) + np.arange(count)) % max(count, 1)
            firsts = length * rng.permutation(math.ceil(count / length))
            blocks = [ring[first : first + length] for first in firsts]
            row[offset : offset + count] = offset + np.concatenate([ring[:0], *blocks])
        offset += count
    return orders


def _centred(value: FloatArray, known: BoolArray, counts: Sequence[int]) -> FloatArray:
    """Values less the mean of their own flight, 0 where they are not known: (n,)."""
    result = np.zeros(len(value))
    for stop, count in zip(np.cumsum(counts), counts, strict=True):
        samples = np.arange(stop - count, stop)[known[stop - count : stop]]
        if len(samples):
            result[samples] = value[samples] - value[samples].mean()
    return result


def _strength(values: FloatArray, inside: FloatArray, number: FloatArray) -> float:
    """Sum of squares between bins; `inside` (n, bins) is 1 in the bin of each of the values (n,).

    `number` are the samples of each bin, at least one.
    """
    return float(((values @ inside) ** 2 / number).sum())


def bin_means(
    value: FloatArray,
    bins: IntArray,
    blocks: Sequence[IntArray],
    count: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean, standard error clustered by block, and number per bin."""
    inside = bins >= 0
    number = np.bincount(bins[inside], minlength=count).astype(float)
    means = np.bincount(bins[inside], value[inside], count) / np.maximum(number, 1.0)
    square = np.zeros(count)
    for block in blocks:
        kept = block[bins[block] >= 0]
        rest = value[kept] - means[bins[kept]]
        square += np.bincount(bins[kept], rest, count) ** 2
    return means, np.sqrt(square) / np.maximum(number, 1.0), number


def _places(m: Map) -> list[Place]:
    """Runs of neighbouring bins that clearly deviate to the same side."""
    mean, low, high = (np.array(values) for values in (m.mean, m.low, m.high))
    error = (high - low) / (2 * 1.645)
    side = np.where(np.abs(mean) > _CLEAR_SE * error, np.sign(mean), 0.0)
    if not side.any():
        side[np.argmax(np.abs(mean) / np.maximum(error, 1e-12))] = 1.0
    places, start = [], 0
    for end in range(1, len(side) + 1):
        if end < len(side) and side[end] == side[start]:
            continue
        if side[start] != 0.0:
            places.append(_place(m, mean, start, end))
        start = end
    return sorted(places, key=lambda p: -abs(p.residual))[:2]


def _place(m: Map, mean: FloatArray, start: int, end: int) -> Place:
    count = np.array(m.count)[start:end]
    residual = float((mean[start:end] * count).sum() / max(count.sum(), 1))
    low, high = m.edges[start], m.edges[end]
    first, last = start == 0, end == len(mean)
    return Place(
        channel=m.channel,
        coordinate=m.coordinate,
        exogenous=m.exogenous,
        low=low,
        high=high,
        residual=residual,
        unit=m.unit,
        coordinate_unit=m.coordinate_unit,
        q_value=m.q_value,
        clarity=m.clarity,
        words=_words(m, low, high, residual, first, last),
    )


def _words(m: Map, low: float, high: float, residual: float, first: bool, last: bool) -> str:
    unit = f" {signs(m.coordinate_unit)}" if m.coordinate_unit else ""
    if m.coordinate == "everywhere" or (first and last):
        where = "everywhere"
    elif first:
        where = f"{m.coordinate} below {_short(high)}{unit}"
    elif last:
        where = f"{m.coordinate} above {_short(low)}{unit}"
    else:
        where = f"{m.coordinate} {_short(low)} to {_short(high)}{unit}"
    size = f"{1e3 * residual:+.1f} mm" if m.unit == "m" else f"{residual:+.2g} {m.unit}"
    return f"{where}: {minus(size)} ({m.channel}), q = {m.q_value:.3f}"


def _short(value: float) -> str:
    """Three digits without a power of ten: 0.0941, 1714."""
    return minus(f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}")


def forbids_none(places: Sequence[Place]) -> bool:
    """Whether a place disagrees too clearly for "nothing is missing".

    Innovations do not count: their whiteness is a gate of its own.
    """
    return any(
        place.channel != INNOVATION and place.q_value <= RULES.forbids_none_q for place in places
    )


def _mean_square(values: FloatArray) -> float:
    """The mean square of the finite values; 0 for none."""
    finite = values[np.isfinite(values)]
    return float((finite**2).mean()) if len(finite) else 0.0
