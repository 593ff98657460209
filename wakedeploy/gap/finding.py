"""Where simulation and measurement disagree, beyond noise.

In: a model and its fitted base. Out: maps of the residuals over each coordinate, and a ranked list
of places in words. Residuals are permuted in blocks longer than their correlation, within each
flight, so that a map's p value holds for coloured residuals; false discoveries are controlled over
all maps (Benjamini and Hochberg 1995).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wakedeploy.gap.flight import FloatArray
from wakedeploy.gap.gantry import GantryModel
from wakedeploy.gap.inference import Fit
from wakedeploy.gap.residuals import CHANNELS, COORDINATES, Residuals, mean_square, residuals
from wakedeploy.gap.whiteness import samples, spectrum, whiteness

FALSE_DISCOVERIES = 0.05
HORIZONS_S = (0.25, 0.5, 1.0)
_BLOCK_S = 2.0
_BINS = 8
_PERMUTATIONS = 499
_CLEAR_SE = 2.0
_MOST_PLACES = 12


def find_places(
    model: GantryModel, base: Fit, limit: float, least: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """`find.json` without its header: maps, places, whiteness (`limit`), spectrum, replay.

    A place counts from the size `least` of its channel on: so much the model's own approximations
    leave on this rig when nothing is missing (see `threshold`).
    """
    floor = dict.fromkeys(CHANNELS, 0.0) | dict(least or {})
    maps: list[dict[str, Any]] = []
    for channel in CHANNELS:
        series = [residuals(model, base, channel, i) for i in range(model.episodes)]
        each = (_map(series, name, k) for k, name in enumerate(COORDINATES))
        maps += [*(m for m in each if m is not None), _everywhere(series)]
    for m, q in zip(maps, q_values([m["p_value"] for m in maps]), strict=True):
        m["q_value"] = q
    maps.sort(key=lambda m: (m["q_value"], -m["strength"]))
    significant = [m for m in maps if m["q_value"] <= FALSE_DISCOVERIES]
    places = [p for m in significant for p in _places(m)]
    places = [p for p in places if abs(p["residual"]) > floor[p["channel"]]]
    places.sort(key=lambda p: (p["q_value"], -abs(p["residual"]) / max(floor[p["channel"]], 1e-9)))
    white = [samples(score) for score in base.slopes.scores]
    return {
        "white": whiteness(base).as_json(limit),
        "places": places[:_MOST_PLACES],
        "maps": maps,
        "spectrum": spectrum(white, 1.0 / model.flights[0].spacing_s),
        "replay": [_replay(model, base, h) for h in HORIZONS_S],
        "noise_floor": {c: {"value": floor[c], "unit": unit} for c, unit in CHANNELS.items()},
        "sentence": _sentence(places),
    }


def q_values(p: Sequence[float]) -> list[float]:
    """Benjamini–Hochberg: the false-discovery rate at which each would just be reported."""
    order = np.argsort(p)
    count = len(order)
    ranked = np.asarray(p, float)[order] * count / np.arange(1, count + 1)
    q = np.minimum.accumulate(ranked[::-1])[::-1]
    result = np.empty(count)
    result[order] = np.minimum(q, 1.0)
    return [float(v) for v in result]


def _map(series: Sequence[Residuals], name: str, seed: int) -> dict[str, Any] | None:
    """Mean residual in bins of one coordinate, with a permutation test of "depends on it"."""
    unit, exogenous = COORDINATES[name]
    coordinate = np.concatenate([s.coordinates[name] for s in series])
    value = np.concatenate([s.value for s in series])
    known = np.isfinite(coordinate) & np.isfinite(value)
    if known.sum() < 80:
        return None
    edges = np.unique(np.quantile(coordinate[known], np.linspace(0.0, 1.0, _BINS + 1)))
    if len(edges) < 3:
        return None
    bins = np.where(known, np.clip(np.digitize(coordinate, edges[1:-1]), 0, len(edges) - 2), -1)
    centred = np.where(known, value - value[known].mean(), 0.0)
    blocks = _blocks(series)
    rng = np.random.default_rng([seed, len(value)])
    strength = _strength(centred, bins, len(edges) - 1)
    beaten = sum(
        _strength(centred[_shuffled(blocks, rng)], bins, len(edges) - 1) >= strength
        for _ in range(_PERMUTATIONS)
    )
    means, errors, counts = _bin_means(value, bins, blocks, len(edges) - 1)
    return {
        "channel": series[0].channel,
        "coordinate": name,
        "exogenous": exogenous,
        "unit": CHANNELS[series[0].channel],
        "coordinate_unit": unit,
        "edges": edges.tolist(),
        "mean": means.tolist(),
        "low": (means - 1.645 * errors).tolist(),
        "high": (means + 1.645 * errors).tolist(),
        "count": counts.tolist(),
        "p_value": (beaten + 1) / (_PERMUTATIONS + 1),
        "strength": strength / mean_square(centred) / len(value),
    }


def _everywhere(series: Sequence[Residuals]) -> dict[str, Any]:
    """The mean over all places, against the spread of its blocks (each block's sign flipped)."""
    value = np.concatenate([s.value for s in series])
    sums = np.array([value[b].sum() for b in _blocks(series)])
    rng = np.random.default_rng(len(value))
    flips = rng.choice([-1.0, 1.0], size=(_PERMUTATIONS, len(sums)))
    total = abs(float(sums.sum()))
    p = (int((np.abs(flips @ sums) >= total).sum()) + 1) / (_PERMUTATIONS + 1)
    mean, error = float(value.mean()), float(np.sqrt((sums**2).sum()) / len(value))
    return {
        "channel": series[0].channel,
        "coordinate": "everywhere",
        "exogenous": True,
        "unit": CHANNELS[series[0].channel],
        "coordinate_unit": "",
        "edges": [0.0, 1.0],
        "mean": [mean],
        "low": [mean - 1.645 * error],
        "high": [mean + 1.645 * error],
        "count": [len(value)],
        "p_value": p,
        "strength": mean**2 / mean_square(value) if len(value) else 0.0,
    }


def _blocks(series: Sequence[Residuals]) -> list[np.typing.NDArray[np.int64]]:
    """Indices of blocks of two seconds, none across two flights."""
    blocks, offset = [], 0
    for s in series:
        number = np.floor((s.at_s - s.at_s[0]) / _BLOCK_S).astype(int) if len(s.at_s) else []
        for n in np.unique(number):
            blocks.append(offset + np.flatnonzero(number == n))
        offset += len(s.at_s)
    return blocks


def _shuffled(
    blocks: Sequence[np.typing.NDArray[np.int64]], rng: np.random.Generator
) -> np.typing.NDArray[np.int64]:
    """Blocks in another order, laid end to end.

    Flights all come from one rig, so blocks may also change flights.
    """
    return np.concatenate([blocks[i] for i in rng.permutation(len(blocks))])


def _strength(value: FloatArray, bins: np.typing.NDArray[np.int64], count: int) -> float:
    """Sum of squares between bins."""
    inside = bins >= 0
    total = np.bincount(bins[inside], value[inside], count)
    number = np.maximum(np.bincount(bins[inside], minlength=count), 1)
    return float((total**2 / number).sum())


def _bin_means(
    value: FloatArray,
    bins: np.typing.NDArray[np.int64],
    blocks: Sequence[np.typing.NDArray[np.int64]],
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


def _places(m: dict[str, Any]) -> list[dict[str, Any]]:
    """Runs of neighbouring bins that clearly deviate to the same side."""
    mean, low, high = (np.array(m[k]) for k in ("mean", "low", "high"))
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
    return sorted(places, key=lambda p: -abs(p["residual"]))[:2]


def _place(m: dict[str, Any], mean: FloatArray, start: int, end: int) -> dict[str, Any]:
    count = np.array(m["count"])[start:end]
    residual = float((mean[start:end] * count).sum() / max(count.sum(), 1))
    low, high = m["edges"][start], m["edges"][end]
    first, last = start == 0, end == len(mean)
    return {
        "channel": m["channel"],
        "coordinate": m["coordinate"],
        "exogenous": m["exogenous"],
        "low": low,
        "high": high,
        "residual": residual,
        "unit": m["unit"],
        "coordinate_unit": m["coordinate_unit"],
        "q_value": m["q_value"],
        "words": _words(m, low, high, residual, first, last),
    }


def _words(
    m: dict[str, Any], low: float, high: float, residual: float, first: bool, last: bool
) -> str:
    unit = f" {m['coordinate_unit']}" if m["coordinate_unit"] else ""
    if m["coordinate"] == "everywhere" or (first and last):
        where = "everywhere"
    elif first:
        where = f"{m['coordinate']} below {_short(high)}{unit}"
    elif last:
        where = f"{m['coordinate']} above {_short(low)}{unit}"
    else:
        where = f"{m['coordinate']} {_short(low)} to {_short(high)}{unit}"
    size = f"{1e3 * residual:+.1f} mm" if m["unit"] == "m" else f"{residual:+.2g} {m['unit']}"
    return f"{where}: {size} ({m['channel']}), q = {m['q_value']:.3f}"


def _short(value: float) -> str:
    """Three digits, and never a power of ten: 0.0941, 1714."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def _replay(model: GantryModel, base: Fit, horizon_s: float) -> dict[str, float]:
    errors, expected = [], []
    for episode in range(model.episodes):
        ahead = model.forecasts(base, episode, (horizon_s,))
        errors.append(ahead.measured_m[0] - ahead.forecast_m[0])
        expected.append(ahead.variance_m2[0])
    error, variance = np.concatenate(errors), np.concatenate(expected)
    known = np.isfinite(error) & np.isfinite(variance)
    typical = np.abs(error[known]) < 6.0 * np.median(np.abs(error[known]))
    return {
        "horizon_s": horizon_s,
        "rmse_m": float(np.sqrt((error[known][typical] ** 2).mean())),
        "expected_m": float(np.sqrt(variance[known].mean())),
    }


def _sentence(places: Sequence[dict[str, Any]]) -> str:
    if not places:
        return "Simulation and measurement agree everywhere to within noise."
    return f"They disagree beyond noise: {places[0]['words']}."
