"""A self-similar round turbulent jet, calibrated to a wake that is given by its field equations.

Gaussian profile, half-width that grows linearly with the distance, centreline speed from the
conservation of momentum (v·b constant, Pope, *Turbulent Flows*, § 5.1) with an exponential loss.
What the source does arrives after a delay that depends on the distance, spread by two mixing lags.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .constants import Wake

FloatArray = npt.NDArray[np.float64]


class Jet(NamedTuple):
    """v(d, r) = speed_m2ps / b · exp(−loss·d − r² / 2b²), b = width_m + spread·d, per √(u / u_ref).

    Arrives `delay_s + delay_s_per_m · d` after the source's thrust on average, mixed by two equal
    lags of `mixing_s + mixing_s_per_m · d` each.
    """

    speed_m2ps: float
    loss_per_m: float
    width_m: float
    spread: float
    delay_s: float
    delay_s_per_m: float
    mixing_s: float
    mixing_s_per_m: float
    reference_thrust_n: float
    drag_n_s2_per_m2: float  # ½ρ·CdA
    speed_exponent: float


AIR_DENSITY_KGPM3 = 1.2
_NEAREST_M, _FARTHEST_M = 1.0, 2.0  # distances that are flown, from the source


def calibrated_jet(wake: Wake) -> Jet:
    """The jet whose width, speed, delay and mixing follow those of `wake` where flights are."""
    distance = np.linspace(_NEAREST_M, _FARTHEST_M, 21)
    speed, width, delay, mixing = (np.empty_like(distance) for _ in range(4))
    for i, d in enumerate(distance):
        speed[i], width[i], delay[i], mixing[i] = _profile(wake, float(d))
    spread, nozzle = np.polyfit(distance, width, 1)
    loss, momentum = np.polyfit(distance, np.log(speed * (nozzle + spread * distance)), 1)
    delay_slope, delay_0 = np.polyfit(distance, delay, 1)
    mixing_slope, mixing_0 = np.polyfit(distance, mixing / np.sqrt(2.0), 1)
    return Jet(
        speed_m2ps=float(np.exp(momentum)),
        loss_per_m=float(-loss),
        width_m=float(nozzle),
        spread=float(spread),
        delay_s=float(delay_0),
        delay_s_per_m=float(delay_slope),
        mixing_s=float(mixing_0),
        mixing_s_per_m=float(mixing_slope),
        reference_thrust_n=wake.reference_thrust_n,
        drag_n_s2_per_m2=0.5 * AIR_DENSITY_KGPM3 * wake.drag_area_m2,
        speed_exponent=wake.speed_exponent,
    )


def field_response(
    wake: Wake, distance_m: float, lateral_m: float, age_s: FloatArray
) -> FloatArray:
    """What puffs of these ages (M,) bring to a place [m/s²]: sink, diffuse, decay."""
    width2 = wake.width_m**2 + 2.0 * wake.diffusivity_m2ps * age_s
    away2 = lateral_m**2 + (distance_m - wake.speed_mps * age_s) ** 2
    fading = np.exp(-wake.decay_per_s * age_s - 0.5 * away2 / width2)
    return np.asarray(wake.strength * wake.width_m**2 / width2 * fading)


def _profile(wake: Wake, distance_m: float) -> tuple[float, float, float, float]:
    """Centreline speed, width, mean delay and its standard deviation at a distance."""
    age = np.linspace(0.0, 3.0 * (_FARTHEST_M + 1.0) / wake.speed_mps, 6001)
    step = float(age[1])
    axis = field_response(wake, distance_m, 0.0, age)
    total = float(axis.sum())
    aside_m = 0.15
    aside = float(field_response(wake, distance_m, aside_m, age).sum())
    mean = float((age * axis).sum()) / total
    variance = float(((age - mean) ** 2 * axis).sum()) / total
    width = aside_m / np.sqrt(2.0 * np.log(total / aside)) if total > 0.0 else wake.width_m
    return max(total * step, 1e-12), float(width), mean, float(np.sqrt(variance))
