"""Range readings of a sufferer that does not move: their mean and scatter.

A reading is rounded and cannot be negative: on a stop at zero half of the noise may be cut off. One
in a hundred may have nothing to do with the reflector. Mean and scatter are those
under which readings like these are likeliest, rounded and cut off as they are.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from scipy.special import ndtr

from runtime.calibration import require
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog

FloatArray = npt.NDArray[np.float64]

FEWEST = 100  # readings; with them the mean of 4 mm of noise is known to 0.4 mm
SETTLED_S = 1.0  # after a landing, before a rest counts
_STRAY, _STRAY_RANGE_M = 0.01, 2.0  # share of readings that mean nothing, and where they may lie
_MOST_SCATTER_M = 0.02
_FINEST_M = 1e-4


@dataclass(frozen=True)
class Rest:
    """A rest's mean reading [m] with its standard error, and the scatter of one reading [m]."""

    mean_m: float
    mean_sd_m: float
    noise_m: float
    readings: int


def rest_readings(log: RunLog) -> FloatArray:
    """The new range readings [m] of a log's ticks at rest, motors off, in order of time."""
    t_s, at_rest = log["t_s"], log["mode"].astype(str) == "ARMED"
    flying = np.flatnonzero(log.flying)
    if flying.size:
        at_rest &= (t_s < t_s[flying[0]]) | (t_s > t_s[flying[-1]] + SETTLED_S)
    fresh = ~(log["range_repeats"] > 0) & np.isfinite(log["range_m"])
    return np.asarray(log["range_m"][at_rest & fresh], float)


def rest_of(log: RunLog, rig: Rig) -> Rest:
    """What the sensor reads at rest; CheckFailed when that is not one steady value."""
    reading_m = rest_readings(log)
    count = len(reading_m)
    require(
        count >= FEWEST,
        f"Only {count} valid range readings at rest, {FEWEST} are needed: check that the sensor "
        "sees the reflector.",
    )
    at_zero = float(np.mean(reading_m <= 0.0))
    require(
        at_zero < 0.9,
        f"{100 * at_zero:.0f} % of the readings at rest are zero: the true one lies below what the "
        "sensor can read; mount the reflector higher.",
    )
    step_m = rig.range_sensor.resolution_m
    mean_m, noise_m = _likeliest(reading_m, step_m)
    first, second = (_likeliest(half, step_m)[0] for half in np.array_split(reading_m, 2))
    error_m = noise_m * (1.25 if at_zero > 0.1 else 1.0) / np.sqrt(count)
    require(
        noise_m < _MOST_SCATTER_M,
        f"The readings at rest scatter by {1e3 * noise_m:.0f} mm, and a sound sensor's by 3 to 6: "
        "check the reflector and stray light.",
    )
    apart_m = abs(second - first)
    require(
        apart_m < max(0.003, 10.0 * error_m),
        f"The readings at rest drifted by {1e3 * apart_m:.1f} mm: let the sensor warm up for some "
        "minutes, and touch nothing.",
    )
    # Neighbouring readings may err alike; then the halves lie further apart than chance has them.
    return Rest(mean_m, float(np.hypot(max(error_m, 0.5 * apart_m), _FINEST_M)), noise_m, count)


def _likeliest(reading_m: FloatArray, step_m: float) -> tuple[float, float]:
    """Mean and standard deviation [m] of what was rounded to `step_m` and cut off at zero."""
    step_m = max(step_m, _FINEST_M)
    low = np.where(reading_m <= 0.0, -np.inf, reading_m - 0.5 * step_m)
    high = reading_m + 0.5 * step_m
    stray = _STRAY * step_m / _STRAY_RANGE_M

    def unlikelihood(theta: FloatArray) -> float:
        mean_m, noise_m = theta[0], np.exp(theta[1])
        share = ndtr((high - mean_m) / noise_m) - ndtr((low - mean_m) / noise_m)
        return -float(np.sum(np.log((1.0 - _STRAY) * share + stray)))

    middle_m = float(np.median(reading_m))
    upper_m = float(np.quantile(reading_m, 0.84)) - middle_m
    start = np.array([middle_m, np.log(max(upper_m, 0.5 * step_m))])
    simplex = start + np.array([[0.0, 0.0], [0.002, 0.0], [0.0, 0.3]])
    found = minimize(
        unlikelihood,
        start,
        method="Nelder-Mead",
        options={"xatol": 1e-5, "fatol": 1e-4, "initial_simplex": simplex},
    )
    return float(found.x[0]), float(np.exp(found.x[1]))
