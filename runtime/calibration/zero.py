"""`calibrate zero`: what the range sensor reads while the sufferer rests on the stop.

Heights count from the stop, so this reading is the sensor's bias. Assumed: the sufferer lies on
the stop, motors off, and the sensor is warm. Chance is known from the readings' scatter and from
how far the two halves of the time lie apart.
"""

from runtime.calibration import Outcome, require
from runtime.calibration.readings import rest_of
from runtime.calibration.session import Site, resting
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.rig.update import Calibrated

SECONDS = 20.0
_FURTHEST_M = 0.3  # as the rig file allows; a stop that far away leaves too little of the travel


def record(site: Site, rig: Rig) -> RunLog:
    """Rest."""
    return site.flown("zero", *resting(rig, SECONDS))


def estimate(log: RunLog, rig: Rig) -> Outcome:
    """The bias from one log's rest."""
    rest = rest_of(log, rig)
    require(
        abs(rest.mean_m) < _FURTHEST_M,
        f"At rest the sensor reads {rest.mean_m:.3f} m, and on the stop it may read up to "
        f"{_FURTHEST_M:g} m: check that the sufferer lies on the stop.",
    )
    bias = Calibrated(rest.mean_m, rest.mean_sd_m, "m")
    sentence = f"{rest.readings} readings scatter by {1e3 * rest.noise_m:.1f} mm."
    return Outcome({"range_sensor.bias_m": bias}, (sentence,))
