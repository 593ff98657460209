"""Is FlareDW's force label a force? Checks that need no model of a wake.

In: flights. Out: plain numbers per folder and for all. Beyond 2 m to the side no wake reaches the
sufferer, so that a label of force should be zero there but for the body's own drag; and the logged
acceleration, on which the label rests, should be the derivative of the logged velocity.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from wakedeploy.domains.quadrotor_files import (
    LABEL_GRAVITY_MPS2,
    MASS_KG,
    THRUST_VALID_RADPS,
    Flight,
    corrected_label,
    differentiated,
    smoothed,
    transport_term,
)

FloatArray = npt.NDArray[np.float64]

GRAVITY_MPS2 = 9.81
FAR_M = 2.0
_MARGIN = 20  # samples at either end, where the smoother looks across a cut
_BLOCK = 100  # samples, half a second: longer than the label's memory
_FLIPS = 1999


def audit(flights: Sequence[Flight]) -> dict[str, Any]:
    """Numbers for every group of flights (folder and file) and for `all` together."""
    groups: dict[str, list[Flight]] = {"all": list(flights)}
    for flight in flights:
        groups.setdefault(flight.name.split("@")[0], []).append(flight)
    return {name: _numbers(group) for name, group in groups.items()}


def _numbers(flights: Sequence[Flight]) -> dict[str, Any]:
    columns: list[list[Any]] = [[] for _ in range(6)]
    missing, turning, raw, mended, far, outside = columns
    for flight in flights:
        inner = slice(_MARGIN, len(flight.label) - _MARGIN)
        s = flight.sufferer
        missing.append((smoothed(s[:, 6:9]) - differentiated(s))[inner])
        turning.append(transport_term(s)[inner])
        far.append(flight.distance_m[inner] > FAR_M)
        rotor = np.abs(s[inner, 22:26]).mean(1)
        outside.append((rotor < THRUST_VALID_RADPS[0]) | (rotor > THRUST_VALID_RADPS[1]))
        raw.append(flight.label[inner])
        mended.append(corrected_label(flight)[inner])
    beyond = np.concatenate(far)
    return {
        "flights": len(flights),
        "seconds": len(beyond) / 200.0,
        "outside_thrust_fit_share": float(np.concatenate(outside).mean()),
        "constant_n": MASS_KG * (LABEL_GRAVITY_MPS2 - GRAVITY_MPS2),
        "acceleration_less_derivative": _explained(missing, turning),
        "label_rms_n": float(np.sqrt(np.mean(np.concatenate(raw)[:, 2] ** 2))),
        "corrected_rms_n": float(np.sqrt(np.mean(np.concatenate(mended)[:, 2] ** 2))),
        "stated_label": _stated(flights),
        "angular_acceleration_correlation": _turning_up(flights),
        "source_acceleration_less_derivative": _of_the_source(flights),
        "far_seconds": float(beyond.sum()) / 200.0,
        "far_label_n": _spread(np.concatenate(raw), beyond),
        "far_corrected_n": _spread(np.concatenate(mended), beyond),
    }


def _explained(missing: list[FloatArray], turning: list[FloatArray]) -> dict[str, Any]:
    """The z difference against (ω × v)_z: slope, correlation, rms before and after, p value."""
    y, x = np.concatenate(missing)[:, 2], np.concatenate(turning)[:, 2]
    slope = float(x @ y / (x @ x))
    residual = np.concatenate(missing) + np.concatenate(turning)
    return {
        "slope": slope,
        "correlation": _correlation(x, y),
        "rms_mps2": float(np.sqrt(np.mean(y**2))),
        "rms_left_mps2": float(np.sqrt(np.mean(residual[:, 2] ** 2))),
        "p_value": _p_value([m[:, 2] * t[:, 2] for m, t in zip(missing, turning, strict=True)]),
    }


def _of_the_source(flights: Sequence[Flight]) -> dict[str, Any]:
    """The same for the upper vehicle, whose log no label rests on."""
    inner = slice(_MARGIN, -_MARGIN)
    states = [f.source for f in flights]
    missing = [(smoothed(s[:, 6:9]) - differentiated(s))[inner] for s in states]
    return _explained(missing, [transport_term(s)[inner] for s in states])


def _stated(flights: Sequence[Flight]) -> dict[str, float] | None:
    """Largest difference [N] of the file's label from ours, inside flights and near their cuts."""
    pairs = [(f.stated_n, f.label[:, 2]) for f in flights if f.stated_n is not None]
    if not pairs:
        return None
    apart = [np.abs(theirs - ours) for theirs, ours in pairs]
    return {
        "inside": max(float(a[_MARGIN:-_MARGIN].max()) for a in apart),
        "near_cuts": max(float(max(a[:_MARGIN].max(), a[-_MARGIN:].max())) for a in apart),
    }


def _turning_up(flights: Sequence[Flight]) -> list[float]:
    """Columns 15 to 17, undocumented, against the derivative of the body rates."""
    rates, columns = [], []
    for flight in flights:
        inner = slice(_MARGIN, len(flight.label) - _MARGIN)
        rates.append(smoothed(np.gradient(flight.sufferer[:, 12:15], 0.005, axis=0))[inner])
        columns.append(smoothed(flight.sufferer[:, 15:18])[inner])
    x, y = np.concatenate(rates), np.concatenate(columns)
    return [_correlation(x[:, k], y[:, k]) for k in range(3)]


def _correlation(x: FloatArray, y: FloatArray) -> float:
    """The correlation of two series; NaN where one of them does not vary."""
    spread = float(x.std() * y.std())
    return float(np.mean((x - x.mean()) * (y - y.mean()))) / spread if spread else float("nan")


def _p_value(products: list[FloatArray]) -> float:
    """Random signs for half-second blocks within flights: how often the sum is as large."""
    sums = np.concatenate(
        [np.add.reduceat(p, np.arange(0, len(p), _BLOCK)) for p in products if len(p)]
    )
    signs = np.random.default_rng(0).choice((-1.0, 1.0), (_FLIPS, len(sums)))
    return float((1 + (np.abs(signs @ sums) >= abs(sums.sum())).sum()) / (1 + _FLIPS))


def _spread(force: FloatArray, beyond: FloatArray) -> dict[str, list[float]] | None:
    """Mean, rms and largest size of each axis [N] where no wake is."""
    if not beyond.any():
        return None
    there = force[beyond]
    return {
        "mean": there.mean(0).tolist(),
        "rms": np.sqrt((there**2).mean(0)).tolist(),
        "largest": np.abs(there).max(0).tolist(),
    }
