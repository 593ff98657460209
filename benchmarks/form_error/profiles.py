"""Jets of several forms as tables, each calibrated to the wake that a rig file states.

In: the wake's constants as plain numbers, a family, and the misfit that is wanted. Out: tables of
the air's speed over distance and lateral place, of when it arrives, and the misfit that is left of
the steady force after the model has been calibrated to it within the rig file's spreads.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

FloatArray = npt.NDArray[np.float64]

AIR_DENSITY_KGPM3 = 1.2
FAMILIES = ("same", "round", "core", "hollow", "bent")
DISTANCE_M = np.arange(0.4, 2.21, 0.02)  # below the source
LATERAL_M = np.arange(-0.9, 0.905, 0.01)
_FLOWN_BELOW_M = (0.9, 1.9)
_FLOWN_ASIDE_M = 0.4
_SPREADS = {"strength": 0.10, "width_m": 0.05, "diffusivity_m2ps": 0.10, "speed_mps": 0.05}


@dataclass(frozen=True)
class Wake:
    """A wake as a rig file states it: puffs that sink, widen and fade."""

    speed_mps: float
    diffusivity_m2ps: float
    decay_per_s: float
    strength: float
    width_m: float
    drag_area_m2: float


@dataclass(frozen=True, eq=False)
class Jet:
    """Speed (D, L) [m/s, downwards] at the reference thrust; arrival's mean and spread (D,) [s].

    `misfit_n` is the root mean square of the steady force that a calibrated model does not have,
    over the box that flights visit; `misfit_share` that over the root mean square of the force.
    """

    speed_mps: FloatArray
    delay_s: FloatArray
    mixing_s: FloatArray
    misfit_n: float
    misfit_share: float


def jet_of(wake: Wake, family: str, misfit_share: float) -> Jet:
    """A jet of a family, so far from the wake's own form that the misfit is as asked for."""
    wake_form, delay_s, mixing_s = _puffs(wake)
    if family == "same" or misfit_share <= 0.0:
        return Jet(wake_form, delay_s, mixing_s, *_misfit(wake, wake_form))
    other, arrival_s = _fitted(wake, wake_form, family, delay_s)
    share = 1.0
    for _ in range(4):  # the misfit is nearly linear in the share
        mixed = _mixed(wake_form, other, share)
        share *= misfit_share / max(_misfit(wake, mixed)[1], 1e-6)
    mixed = _mixed(wake_form, other, share)
    later = min(share, 1.0)
    arrives_s = (1.0 - later) * delay_s + later * arrival_s
    return Jet(mixed, arrives_s, mixing_s, *_misfit(wake, mixed))


def _mixed(wake_form: FloatArray, other: FloatArray, share: float) -> FloatArray:
    return np.asarray(np.maximum((1.0 - share) * wake_form + share * other, 0.0))


def _puffs(wake: Wake) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The wake's own steady speed (D, L), and mean and spread of its ages on the axis (D,)."""
    age = np.arange(0.001, 1.2, 0.001)
    width2 = wake.width_m**2 + 2.0 * wake.diffusivity_m2ps * age
    along = DISTANCE_M[:, None] - wake.speed_mps * age
    amplitude = wake.strength * 0.001 * np.exp(-wake.decay_per_s * age) * wake.width_m**2 / width2
    axis = amplitude * np.exp(-0.5 * along**2 / width2)  # (D, A)
    lateral = np.exp(-0.5 * LATERAL_M[None, :] ** 2 / width2[:, None])  # (A, L)
    mean = (axis * age).sum(axis=1) / axis.sum(axis=1)
    spread = (axis * (age - mean[:, None]) ** 2).sum(axis=1) / axis.sum(axis=1)
    return axis @ lateral, mean, np.sqrt(spread)


def _fitted(
    wake: Wake, wake_form: FloatArray, family: str, delay_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A family's jet with the parameters that come nearest to the wake's force, and its arrival."""
    box = _box()
    wanted = _force(wake, wake_form)[box]

    def off(p: FloatArray) -> FloatArray:
        return np.asarray(_force(wake, _PROFILES[family](p))[box] - wanted).ravel()

    middle = wake_form[:, len(LATERAL_M) // 2]
    start = np.array([float(middle[len(middle) // 2]), 0.1, 0.08])
    best = least_squares(off, start, x_scale=np.abs(start)).x
    if family == "bent":
        return _bent(wake_form), delay_s
    # Air that decelerates along its way arrives later the farther it is.
    paces = np.interp(DISTANCE_M, DISTANCE_M, middle) if family == "hollow" else 1.0 / DISTANCE_M
    arrival = np.cumsum(1.0 / paces)
    arrival *= delay_s[len(delay_s) // 2] / arrival[len(arrival) // 2]
    return _PROFILES[family](best), np.asarray(0.5 * (arrival + delay_s))


def _round(p: FloatArray) -> FloatArray:
    """Self-similar: speed falls as 1/d, (1 + r²)⁻² across (Pope, Turbulent Flows, § 5.1)."""
    d = DISTANCE_M[:, None]
    reach = np.maximum(p[1] + p[2] * d, 0.02)
    across = (1.0 + (LATERAL_M[None, :] / reach) ** 2 * (np.sqrt(2.0) - 1.0)) ** -2
    return np.asarray(p[0] * 1.3 / (d + p[1]) * across)


def _core(p: FloatArray) -> FloatArray:
    """A flat core that the mixing layer has not reached: a steeper flank than a Gaussian's."""
    d = DISTANCE_M[:, None]
    reach = np.maximum(p[1] + p[2] * d, 0.02)
    power = 3.0 - 0.4 * d
    return np.asarray(p[0] * np.exp(-0.5 * np.abs(LATERAL_M[None, :] / reach) ** power) / d**0.3)


def _hollow(p: FloatArray) -> FloatArray:
    """A rotor's annular jet, whose hub leaves a dip that fills on the way."""
    d = DISTANCE_M[:, None]
    reach = np.maximum(p[1] + p[2] * d, 0.02)
    r2 = (LATERAL_M[None, :] / reach) ** 2
    dip = 0.6 * np.exp(-0.7 * d)
    return np.asarray(p[0] * np.exp(-0.5 * r2) * (1.0 - dip * np.exp(-2.5 * r2)) / d**0.3)


_PROFILES = {"round": _round, "core": _core, "hollow": _hollow, "bent": _round}


def _bent(wake_form: FloatArray) -> FloatArray:
    """The wake's own form, one flank steeper than the other, around an axis that bends aside.

    On the whole of what is flown the axis stays where it was: an offset would be an effect.
    """
    bend_m = 0.012 * ((DISTANCE_M / 1.4) ** 2 - 1.04)
    rows = [
        np.interp(LATERAL_M - a - 0.4 * LATERAL_M**2 + 0.01, LATERAL_M, row)
        for a, row in zip(bend_m, wake_form, strict=True)
    ]
    return np.array(rows)


def _force(wake: Wake, speed: FloatArray) -> FloatArray:
    return np.asarray(0.5 * AIR_DENSITY_KGPM3 * wake.drag_area_m2 * speed * np.abs(speed))


def _box() -> tuple[FloatArray, FloatArray]:
    inside = (_FLOWN_BELOW_M[0] <= DISTANCE_M) & (_FLOWN_BELOW_M[1] >= DISTANCE_M)
    beside = np.abs(LATERAL_M) <= _FLOWN_ASIDE_M
    return np.ix_(inside, beside)  # type: ignore[return-value]


def _misfit(wake: Wake, speed: FloatArray) -> tuple[float, float]:
    """What a model calibrated within its spreads lacks of the steady force [N], and its share."""
    box = _box()
    wanted = _force(wake, speed)[box]
    size = wanted.size**0.5
    names = list(_SPREADS)

    def rest(moved: FloatArray) -> FloatArray:
        shares = {n: 1.0 + _SPREADS[n] * m for n, m in zip(names, moved, strict=True)}
        changed = {n: getattr(wake, n) * share for n, share in shares.items()}
        off = _force(wake, _puffs(replace(wake, **changed))[0])[box] - wanted
        # A calibration's spread weighs as much as a misfit of 5 mN.
        return np.concatenate([off.ravel() / size / 0.005, moved])

    fitted = least_squares(rest, np.zeros(len(names)), max_nfev=8).x
    off = rest(fitted)[: wanted.size] * size * 0.005
    misfit = float(np.sqrt(np.mean(off**2)))
    return misfit, misfit / float(np.sqrt(np.mean(wanted**2)))
