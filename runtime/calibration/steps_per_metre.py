"""`calibrate steps`: the carriage's steps per metre, from a distance that someone measures.

The carriage drives to a place, stands there long enough to be measured, and drives home; motors
stay off. The board counts the steps exactly; the error is the rule's, 0.5 mm at either end. Assumed
is a carriage without play in the direction in which it was driven. Steps lost on the way show when
it is back: its count must be zero again while it touches the home switch.
"""

import numpy as np

from runtime.calibration import Outcome, require
from runtime.calibration.session import Site, resting
from runtime.reference import PLAN_RATE_HZ, FlightPlan, smooth_rise
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.rig.update import Calibrated

RULE_SD_M = 0.0007  # 0.5 mm at either end
_SHORTEST_M = 0.1
_TWICE = (0.5, 2.0)  # of the present value: beyond it a unit or a digit went wrong
_LOST_M = 0.003
_STILL_STEPS = 4


def require_distance(distance_m: float, rig: Rig) -> None:
    """UnusableInput for a distance that is too short to measure or beyond the limits."""
    low, high = rig.limits.x_m
    if not (low <= distance_m <= high and abs(distance_m) >= _SHORTEST_M):
        raise UnusableInput(
            f"--distance-m {distance_m:g}: must be at least {_SHORTEST_M:g} m and lie within "
            f"limits.x_m, {low:g} to {high:g} m."
        )


def record(site: Site, rig: Rig, distance_m: float, hold_s: float) -> RunLog:
    """Drive there, stand, drive home."""
    return site.flown("steps", *driving(rig, distance_m, hold_s))


def driving(rig: Rig, distance_m: float, hold_s: float) -> tuple[Rig, FlightPlan]:
    """The rig and the plan of a drive with motors off, at half the carriage's greatest speed."""
    move_s = max(1.0, 15.0 / 8.0 * abs(distance_m) / (0.5 * rig.stepper.max_speed_mps))
    seconds = 2.0 * move_s + hold_s
    t_s = np.arange(round(seconds * PLAN_RATE_HZ)) / PLAN_RATE_HZ
    x_m = distance_m * smooth_rise(t_s / move_s) * smooth_rise((seconds - t_s) / move_s)
    idle_us = np.full_like(t_s, rig.limits.pulse_us[0])
    wide, _ = resting(rig, 2.0 * rig.disturbance.rest_s)
    return wide, FlightPlan(np.zeros_like(t_s), x_m, idle_us, motors_off=True)


def steps_out(log: RunLog) -> int:
    """The step count where the carriage stood; CheckFailed when it never stood away from home."""
    steps, aim_m = log["steps"][log.flying], np.abs(log["x_ref_m"][log.flying])
    there = np.flatnonzero((aim_m > 0.0) & (aim_m >= 0.999 * np.max(aim_m, initial=0.0)))
    standing = steps[there[len(there) // 2 :]]  # by then it has come to rest
    require(
        len(standing) >= PLAN_RATE_HZ and np.ptp(standing) <= _STILL_STEPS,
        "The carriage never stood still away from its home: check the drive.",
    )
    return int(np.median(standing))


def estimate(log: RunLog, measured_m: float, rig: Rig) -> Outcome:
    """Steps per metre from a log with one drive and the distance [m] measured there."""
    count = steps_out(log)
    require(
        abs(measured_m) >= _SHORTEST_M,
        f"{abs(measured_m):g} m are too short for a rule that errs by {1e3 * RULE_SD_M:g} mm: "
        "drive further, and give metres.",
    )
    steps_per_m = abs(count / measured_m)
    before = rig.stepper.steps_per_m
    require(
        _TWICE[0] < steps_per_m / before < _TWICE[1],
        f"{abs(count)} steps over {abs(measured_m):g} m are {steps_per_m:.0f} steps/m, and the rig "
        f"file says {before:g}: measure again, in metres.",
    )
    homed, steps = bool(log["homed"][-1] > 0), float(log["steps"][-1])
    require(
        homed and abs(steps) < _LOST_M * steps_per_m,
        f"The carriage came back to step {steps:.0f} {'at' if homed else 'away from'} its home "
        "switch: it lost steps; drive more slowly or look for what holds it.",
    )
    spread = steps_per_m * RULE_SD_M / abs(measured_m)
    sentence = f"{abs(count)} steps over {abs(measured_m):g} m."
    return Outcome({"stepper.steps_per_m": Calibrated(steps_per_m, spread, "steps/m")}, (sentence,))
