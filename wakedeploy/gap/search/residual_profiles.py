"""Residuals over every coordinate and along one episode, before and after, on sealed episodes.

In: a `Comparison`, its fit without and with what was found, and the sealed episodes. Out: what the
report draws of them.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from wakedeploy.gap.evidence.fits import Fit, FloatArray
from wakedeploy.gap.search.artefacts import Course, Profile, Shown, Trace
from wakedeploy.gap.search.comparison import Comparison

_RANGES = 6
_FEWEST = 12  # samples of a range


def profiles(model: Comparison, base: Fit, found: Fit, sealed: Sequence[int]) -> Shown:
    """Mean residuals over every coordinate, and the typical sealed episode."""
    before, after = (
        [model.disagreement(model.values(f.hypothesis, f.theta), e) for e in sealed]
        for f in (base, found)
    )
    return Shown(
        places=_places(model, sealed, np.hstack(before), np.hstack(after)),
        trace=_trace(model, sealed, before, after),
    )


def _places(
    model: Comparison, sealed: Sequence[int], before: FloatArray, after: FloatArray
) -> list[Profile]:
    """Means of the residuals (c, n) in the ranges of each coordinate; NaN where samples lack."""
    each = [model.coordinates(e) for e in sealed]
    result = []
    for coordinate, (coordinate_unit, _) in each[0].items():
        edges, inside = _joined(ranges(np.concatenate([c[coordinate][1] for c in each])))
        for row, (channel, unit) in enumerate(model.channels):
            was, now = (
                [math.nan if i is None else float(residual[i].mean()) for i in inside]
                for residual in (before[row], after[row])
            )
            result.append(
                Profile(
                    channel=channel,
                    unit=unit,
                    coordinate=coordinate,
                    coordinate_unit=coordinate_unit,
                    edges=edges,
                    before=was,
                    after=now,
                )
            )
    return [profile for profile in result if profile.before]


def ranges(at: FloatArray) -> list[tuple[float, float, FloatArray]]:
    """Up to six ranges with as many samples each: lowest, highest and which samples."""
    known = at[np.isfinite(at)]
    if not len(known):
        return []
    edges = np.unique(np.quantile(known, np.linspace(0.0, 1.0, _RANGES + 1)))
    result = []
    for low, high in itertools.pairwise(edges):
        inside = (at >= low) & ((at < high) | (high == edges[-1]))
        if inside.sum() >= _FEWEST:
            result.append((float(low), float(high), inside))
    return result


def _joined(
    found: Sequence[tuple[float, float, FloatArray]],
) -> tuple[list[float], list[FloatArray | None]]:
    """Edges (n+1,) of ranges one after another and which samples lie in each; None for a hole."""
    edges: list[float] = []
    inside: list[FloatArray | None] = []
    for low, high, samples in found:
        if not edges:
            edges.append(low)
        elif low > edges[-1]:
            edges.append(low)
            inside.append(None)
        edges.append(high)
        inside.append(samples)
    return edges, inside


def _trace(
    model: Comparison,
    sealed: Sequence[int],
    before: Sequence[FloatArray],
    after: Sequence[FloatArray],
) -> Trace:
    """The sealed episode whose error fell by the median share: neither the best nor the worst."""
    shares = [float(np.sum(a**2) / np.sum(b**2)) for b, a in zip(before, after, strict=True)]
    k = int(np.argsort(shares)[len(shares) // 2])
    record = model.records[sealed[k]]
    channels = {
        name: Course(
            unit=unit,
            measured=record.measured[row].tolist(),
            before=(record.measured[row] - before[k][row]).tolist(),
            after=(record.measured[row] - after[k][row]).tolist(),
        )
        for row, (name, unit) in enumerate(model.channels)
    }
    time_s = (record.time_s - record.time_s[0]).tolist()
    return Trace(episode=record.name, time_s=time_s, channels=channels)
