"""Whether a log's columns can be what they claim: units, clocks and origins.

A wrong column would not stop the fits: they would run for minutes, and end in a name.
"""

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog

_OLDEST_S = 0.5  # median age of a range sample: the loop gives up after half of this
_HIGHEST = 3.0  # times the sufferer's travel; a sensor may see the floor beside its reflector
_BEYOND_M = 0.1  # of the carriage's limits
_SOME = 0.01  # of the ticks


def require_plausible(log: RunLog, rig: Rig, name: str, flying: npt.NDArray[np.bool_]) -> None:
    """UnusableInput if a column cannot be what the rig file and its unit say that it is."""
    low, high = rig.limits.pulse_us
    for column in ("sufferer_cmd_us", "source_cmd_us"):
        command = log[column][flying]
        if _beyond(command, low, high) > 0.5:
            raise UnusableInput(
                f"{name}: {column} lies between {np.nanmin(command):g} and {np.nanmax(command):g} "
                f"in flight, and limits.pulse_us between {low:g} and {high:g}; it has to be in "
                "microseconds, and the rig file that of the flight."
            )
    height_m = _middle(log["range_m"][flying])
    if height_m > _HIGHEST * rig.sufferer.travel_m:
        raise UnusableInput(
            f"{name}: range_m is {height_m:g} at the median in flight, and sufferer.travel_m is "
            f"{rig.sufferer.travel_m:g}; it has to be in metres."
        )
    age_s = _middle(log["range_age_s"][flying])
    if not 0.0 <= age_s <= _OLDEST_S:
        raise UnusableInput(
            f"{name}: range_age_s is {age_s:g} at the median in flight; it has to say, in seconds, "
            "how long before t_s a range sample was taken, so it is 0 or more and small."
        )
    x_m = np.asarray(log["steps"][flying], float) / rig.stepper.steps_per_m
    left_m, right_m = rig.limits.x_m
    if np.nanmin(x_m) < left_m - _BEYOND_M or np.nanmax(x_m) > right_m + _BEYOND_M:
        raise UnusableInput(
            f"{name}: by steps the carriage goes from {np.nanmin(x_m):.3g} to "
            f"{np.nanmax(x_m):.3g} m, and limits.x_m is {left_m:g} to {right_m:g}; the count has "
            "to be 0 at x = 0, without jumps, and stepper.steps_per_m that of the rig."
        )


def told_of_columns(log: RunLog, rig: Rig, flying: npt.NDArray[np.bool_]) -> list[str]:
    """What was made of columns that are a little beyond the possible, in words."""
    remarks = []
    low, high = rig.limits.pulse_us
    for column in ("sufferer_cmd_us", "source_cmd_us"):
        share = _beyond(log[column][flying], low, high)
        if share > _SOME:
            remarks.append(
                f"{100 * share:.0f} % of {column} lie beyond limits.pulse_us: taken as clipped"
            )
    if "unfinished" in log.metadata:
        remarks.append(log.metadata["unfinished"])
    return remarks


def _middle(values: npt.NDArray[np.float64]) -> float:
    """The median of the known values; 0 if there is none, which other checks refuse."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0


def _beyond(command: npt.NDArray[np.float64], low: float, high: float) -> float:
    """The share of known commands that are out of bounds by more than rounding."""
    known = command[np.isfinite(command)]
    return float(((known < low - 1.0) | (known > high + 1.0)).mean()) if len(known) else 0.0
