"""`calibrate range`: bias and scale of the range sensor from known heights.

The sufferer rests on spacers of known height, motors off; a height of 0 is the stop itself. A line
through the mean readings, each weighted by its own error and the spacer's (0.5 mm), gives what is
read on the stop and what is read per metre. Three heights or more also show whether it is a line.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from runtime.calibration import Outcome, require
from runtime.calibration.readings import rest_of
from runtime.calibration.session import Site, resting
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.rig.update import Calibrated

FloatArray = npt.NDArray[np.float64]

SECONDS = 10.0
HEIGHT_SD_M = 0.0005  # of a spacer measured with a steel rule
_SHORTEST_M = 0.1  # between the heights: over less, 1 mm of error is 1 % of scale
_MOST_OFF_M = 0.006
_TOO_FEW_TO_TELL = 3  # heights: off a line, any of them could be the wrong one
_SCALES = (0.9, 1.1)
_FURTHEST_M = 0.3


def require_heights(heights_m: Sequence[float], rig: Rig) -> None:
    """UnusableInput for heights from which no line follows."""
    if not len(set(heights_m)) >= 2 or not max(heights_m) - min(heights_m) >= _SHORTEST_M:
        raise UnusableInput(
            f"Give two or more heights, the highest at least {_SHORTEST_M:g} m above the lowest: "
            "--height-m 0 --height-m 0.5."
        )
    if not (min(heights_m) >= 0.0 and max(heights_m) <= rig.sufferer.travel_m):
        raise UnusableInput(
            f"Heights lie within 0 and sufferer.travel_m = {rig.sufferer.travel_m:g} m."
        )


def record(site: Site, rig: Rig, height_m: float, number: int) -> RunLog:
    """Rest on one spacer."""
    return site.flown(f"range{number}", *resting(rig, SECONDS), spacer_m=height_m)


def estimate(logs: Sequence[RunLog], heights_m: Sequence[float], rig: Rig) -> Outcome:
    """Bias and scale from one log per height."""
    rests = [rest_of(log, rig) for log in logs]
    height_m = np.array(heights_m)
    read_m = np.array([rest.mean_m for rest in rests])
    error_m = np.hypot([rest.mean_sd_m for rest in rests], HEIGHT_SD_M)
    design = np.stack([np.ones_like(height_m), height_m], axis=1) / error_m[:, None]
    cov = np.linalg.inv(design.T @ design)
    bias_m, scale = (float(v) for v in cov @ design.T @ (read_m / error_m))
    off_m = read_m - bias_m - scale * height_m
    leverage = np.einsum("ki,ij,kj->k", design, cov, design)
    _require_line(off_m, error_m, leverage, heights_m)
    require(
        _SCALES[0] < scale < _SCALES[1],
        f"The readings rise by {scale:.3f} m per metre, and a sound sensor's by {_SCALES[0]:g} to "
        f"{_SCALES[1]:g}: check the heights and that the sufferer lay on the spacers.",
    )
    require(
        abs(bias_m) < _FURTHEST_M,
        f"The line gives {bias_m:.3f} m on the stop, and it may be up to {_FURTHEST_M:g} m: check "
        "the heights.",
    )
    # The scatter of more than two heights shows when the errors are larger than thought.
    chi2 = float(np.sum((off_m / error_m) ** 2)) / max(len(heights_m) - 2, 1)
    spreads = np.sqrt(np.diag(cov) * max(1.0, chi2))
    constants = {
        "range_sensor.bias_m": Calibrated(bias_m, float(spreads[0]), "m"),
        "range_sensor.scale": Calibrated(scale, float(spreads[1])),
    }
    sentences = [
        f"{h:g} m: read {r:.4f} m, {1e3 * o:+.1f} mm beside the line."
        for h, r, o in zip(heights_m, read_m, off_m, strict=True)
    ]
    return Outcome(constants, tuple(sentences))


def _require_line(
    off_m: FloatArray, error_m: FloatArray, leverage: FloatArray, heights_m: Sequence[float]
) -> None:
    """CheckFailed where a height lies off the line; it names the spacer if the others can tell.

    An end of the line pulls it along, so that its neighbour seems to be off: each height is held
    against the line through the others.
    """
    if len(off_m) <= _TOO_FEW_TO_TELL:
        miss_m = float(np.max(np.abs(off_m)))
        require(
            miss_m < _MOST_OFF_M,
            f"The heights miss a straight line by up to {1e3 * miss_m:.1f} mm: measure the spacers "
            "again; a fourth height would tell which of them it is.",
        )
        return
    beside_m = off_m / (1.0 - leverage)
    worst = int(np.argmax(np.abs(off_m) / (error_m * np.sqrt(1.0 - leverage))))
    require(
        abs(beside_m[worst]) < _MOST_OFF_M,
        f"At {heights_m[worst]:g} m the sensor reads {1e3 * beside_m[worst]:+.1f} mm beside the "
        "line through the others: measure that spacer again.",
    )
