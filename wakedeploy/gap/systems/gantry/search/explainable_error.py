"""How much of the forecast error any explanation could remove, if none was found.

Flights may disagree with a model beyond doubt without making its forecasts worse. Whatever is
missing shows as a mean error at some place, or as innovations that predict the next ones; what both
together predict of the error on other flights is what knowing it would be worth.

In: a base fit, and the flights that judge. Out: the share of the squared error 0.25 s ahead that
the best map and the filter's own last innovations remove.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.systems.gantry.flight import FloatArray
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.residuals import AHEAD_S, COORDINATES, residuals
from wakedeploy.gap.systems.gantry.search.importance import Removed, removed
from wakedeploy.gap.systems.gantry.search.places import AXES

_CHANNEL = "height 0.25 s ahead"
_BINS = 8
_LAGS = 8
_STRAY = 5.0


@dataclass(frozen=True, eq=False)
class _Told:
    """One flight's forecast errors (n,), and what is known when they are made."""

    at_s: FloatArray
    error_m: FloatArray
    places: dict[str, FloatArray]
    last: FloatArray  # (n, lags) whitened innovations


def explainable(model: GantryModel, fitted: Fit, judging: GantryModel | None) -> Removed:
    """The error that could be removed from the flights of `judging`, by what those of `model` show.

    Without `judging`, each flight is predicted by the others.
    """
    known = [_errors_ahead(model, fitted, i) for i in range(model.episodes)]
    if judging is not None:
        other = [_errors_ahead(judging, fitted, i) for i in range(judging.episodes)]
        return _removed(known, other)
    return _joined([(known[:i] + known[i + 1 :], [known[i]]) for i in range(len(known))])


def _joined(splits: Sequence[tuple[list[_Told], list[_Told]]]) -> Removed:
    blocks = [_blocks(others, judged) for others, judged in splits]
    return removed([b for old, _ in blocks for b in old], [b for _, new in blocks for b in new])


def _removed(known: list[_Told], other: list[_Told]) -> Removed:
    return removed(*_blocks(known, other))


def _blocks(known: list[_Told], other: list[_Told]) -> tuple[list[FloatArray], list[FloatArray]]:
    """Errors of `other` per block, as they are and without what `known` predicts of them."""
    name = max(COORDINATES, key=lambda coordinate: _explained(known, coordinate))
    edges = _edges(known, name)
    design = [_design(flight, name, edges) for flight in known]
    errors = np.concatenate([flight.error_m for flight in known])
    weights, *_ = np.linalg.lstsq(np.vstack(design), errors, rcond=1e-9)
    old, new = list[FloatArray](), list[FloatArray]()
    for flight in other:
        remainder = flight.error_m - _design(flight, name, edges) @ weights
        number = np.floor((flight.at_s - flight.at_s[0]) / AXES.block_s[_CHANNEL])
        for n in np.unique(number):
            old.append(flight.error_m[number == n])
            new.append(remainder[number == n])
    return old, new


def _errors_ahead(model: GantryModel, fitted: Fit, episode: int) -> _Told:
    found = residuals(model, fitted, _CHANNEL, episode)
    flight = model.flights[episode]
    times = flight.sample_s[flight.counted]
    white = model.score(fitted.hypothesis, fitted.theta, episode).white[: len(times)]
    at = np.searchsorted(times, found.at_s - 0.5 * AHEAD_S - 1e-9)
    back = np.clip(at[:, None] - np.arange(_LAGS)[None, :], 0, len(white) - 1)
    limit = _STRAY * float(np.median(np.abs(found.value))) if len(found.value) else 0.0
    value = np.clip(found.value, -limit, limit)
    return _Told(found.at_s, value, found.coordinates, np.clip(white[back], -_STRAY, _STRAY))


def _explained(known: Sequence[_Told], name: str) -> float:
    """The squared error that a map over a coordinate removes where it was drawn."""
    edges = _edges(known, name)
    errors = np.concatenate([flight.error_m for flight in known])
    rows = np.vstack([_in_bins(flight.places[name], edges) for flight in known])
    means = rows.T @ errors / np.maximum(rows.sum(axis=0), 1.0)
    return float(rows.sum(axis=0) @ means**2)


def _edges(known: Sequence[_Told], name: str) -> FloatArray:
    where = np.concatenate([flight.places[name] for flight in known])
    where = where[np.isfinite(where)]
    if not len(where):
        return np.zeros(0)
    return np.asarray(np.unique(np.quantile(where, np.linspace(0.0, 1.0, _BINS + 1)))[1:-1])


def _in_bins(where: FloatArray, edges: FloatArray) -> FloatArray:
    """One column per bin (n, bins); all zero where the coordinate is not known."""
    number = np.digitize(np.nan_to_num(where), edges)
    rows = np.eye(len(edges) + 1)[number]
    return np.asarray(np.where(np.isfinite(where)[:, None], rows, 0.0))


def _design(flight: _Told, name: str, edges: FloatArray) -> FloatArray:
    return np.hstack([_in_bins(flight.places[name], edges), flight.last])
