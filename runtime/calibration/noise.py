"""`calibrate noise`: the scatter of single range readings in hover, where the filter meets it.

A reading is compared with the line between its neighbours, at the times at which they were taken:
what the sufferer really does within 60 ms of a hover is a tenth of a millimetre. The noise of
neighbouring readings is assumed independent; rounding is taken off. The rest before and after the
flight shows whether the running motors matter.
"""

import numpy as np
import numpy.typing as npt

from runtime.calibration import Outcome, require
from runtime.calibration.readings import FEWEST, rest_of
from runtime.calibration.session import Site
from runtime.reference import TAKE_OFF_S, FlightPlan, ceiling_m, hold_plan
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.rig.update import Calibrated

FloatArray = npt.NDArray[np.float64]

SECONDS = 25.0
_BLOCKS = 8
_STRAY_SD = 4.0  # readings further off say nothing of the noise
_MOST_EQUAL = 0.4  # of neighbours: a sensor that repeats itself looks quieter than it is
_RANGE_M = (1e-4, 0.05)
_MOST_UNSURE = 0.3


def record(site: Site, rig: Rig) -> RunLog:
    """Hover with the source off."""
    return site.flown("noise", rig, hovering(rig))


def hovering(rig: Rig) -> FlightPlan:
    """At half the travel, or as high as the limits allow."""
    height_m = min(0.5 * rig.sufferer.travel_m, ceiling_m(rig))
    return hold_plan(rig, SECONDS, height_m, rig.limits.pulse_us[0])


def estimate(log: RunLog, rig: Rig) -> Outcome:
    """The noise from one log with a hover."""
    reading_m, taken_s = _hovering(log)
    require(
        len(reading_m) >= 2 * FEWEST,
        f"Only {len(reading_m)} valid range readings in hover, {2 * FEWEST} are needed: check that "
        "the sensor sees the reflector at that height.",
    )
    equal = float(np.mean(np.diff(reading_m) == 0.0))
    require(
        equal < _MOST_EQUAL,
        f"{100 * equal:.0f} % of the readings repeat the one before: the sensor measures more "
        "slowly than it is read; check its timing budget.",
    )
    off_m = _off_the_line(reading_m, taken_s)
    variances = [_variance(block) for block in np.array_split(off_m, _BLOCKS)]
    rounding = rig.range_sensor.resolution_m**2 / 12.0
    noise_m = float(np.sqrt(max(_variance(off_m) - rounding, 0.0)))
    require(
        _RANGE_M[0] < noise_m < _RANGE_M[1],
        f"The readings scatter by {1e3 * noise_m:.2f} mm, and {1e3 * _RANGE_M[0]:g} to "
        f"{1e3 * _RANGE_M[1]:g} mm would be plausible: check the reflector and stray light.",
    )
    spread_m = float(np.std(variances, ddof=1) / np.sqrt(_BLOCKS) / (2.0 * noise_m))
    require(
        spread_m < _MOST_UNSURE * noise_m,
        f"The noise changed between {1e3 * np.sqrt(min(variances)):.1f} and "
        f"{1e3 * np.sqrt(max(variances)):.1f} mm during the hover: look for stray light.",
    )
    rest = rest_of(log, rig)
    differs = abs(rest.noise_m - noise_m) > 3.0 * np.hypot(spread_m, spread_m)
    more = "; in hover it differs, and that is what is written" if differs else ""
    sentence = f"At rest the readings scatter by {1e3 * rest.noise_m:.1f} mm{more}."
    return Outcome({"range_sensor.noise_m": Calibrated(noise_m, spread_m, "m")}, (sentence,))


def _hovering(log: RunLog) -> tuple[FloatArray, FloatArray]:
    """New readings [m] in flight and when they were taken [s], take-off and touch-down apart."""
    flown_s = log["t_s"][log.flying]
    if len(flown_s) == 0:
        return np.empty(0), np.empty(0)
    since_s, left_s = log["t_s"] - flown_s[0], flown_s[-1] - log["t_s"]
    chosen = log.flying & (since_s > TAKE_OFF_S + 1.0) & (left_s > TAKE_OFF_S)
    chosen &= ~(log["range_repeats"] > 0) & np.isfinite(log["range_m"])
    return log["range_m"][chosen], (log["t_s"] - log["range_age_s"])[chosen]


def _off_the_line(reading_m: FloatArray, taken_s: FloatArray) -> FloatArray:
    """How far each reading lies off its neighbours' line, scaled to the noise of one reading."""
    before_s, after_s = taken_s[1:-1] - taken_s[:-2], taken_s[2:] - taken_s[1:-1]
    near = (before_s > 0.0) & (after_s > 0.0) & (before_s + after_s < 0.15)
    share = np.where(near, after_s / np.where(near, before_s + after_s, 1.0), 0.5)
    off_m = reading_m[1:-1] - share * reading_m[:-2] - (1.0 - share) * reading_m[2:]
    return np.asarray((off_m / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2))[near])


def _variance(off_m: FloatArray) -> float:
    """Their mean square without strays."""
    limit_m = _STRAY_SD * 1.4826 * float(np.median(np.abs(off_m)))
    for _ in range(10):
        variance = float(np.mean(off_m[np.abs(off_m) <= limit_m] ** 2))
        limit_m = _STRAY_SD * np.sqrt(variance)
    return variance
