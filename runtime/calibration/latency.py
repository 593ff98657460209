"""`calibrate latency`: from measurement to actuation, motors apart.

Two parts that the loop itself measures add up. Sensing: how old a range sample is when it can first
be read; ticks come at any time after that, so the youngest samples tell. Communication: how long
the board's answer to a command takes, the median over ticks. The answer's own way back is in it
(command and status together take 2.1 ms at 250,000 baud), so the value errs to the long side, as a
round trip does. The rig file halves the sum between sensing and command; a sentence warns when the
halves are not alike. Motors stay off. The spread is the scatter from tick to tick: one number has
to stand for all of them.
"""

import numpy as np

from runtime.calibration import Outcome, require
from runtime.calibration.session import Site, resting
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.rig.update import Calibrated

SECONDS = 20.0
_FEWEST = 200
_YOUNGEST = 0.01  # the share of samples taken to be as young as they can be
_LEAST_SPREAD_S = 0.0005  # the sensor is asked once a millisecond
_MOST_SENSING_S = 0.1
_MOST_JITTER_S = 0.01
_ALIKE_S = 0.005


def record(site: Site, rig: Rig) -> RunLog:
    """Rest; commands go out and are answered all the same."""
    return site.flown("latency", *resting(rig, SECONDS))


def estimate(log: RunLog, rig: Rig) -> Outcome:
    """The round trip from any log of the rig, flown or rested."""
    trips_s = log["round_trip_s"][np.isfinite(log["round_trip_s"])]
    ages_s = log["range_age_s"][(log["range_repeats"] == 0) & np.isfinite(log["range_m"])]
    fewest = min(len(trips_s), len(ages_s))
    require(
        fewest >= _FEWEST,
        f"Only {fewest} round trips or range samples in the log, {_FEWEST} are needed: check cable "
        "and sensor, and record for longer.",
    )
    low_s, trip_s, high_s = (float(v) for v in np.quantile(trips_s, (0.16, 0.5, 0.84)))
    jitter_s = 0.5 * (high_s - low_s)
    sensing_s = float(np.quantile(ages_s, _YOUNGEST))
    require(
        0.0 < trip_s < 1.0 / LOOP_RATE_HZ,
        f"The board's answers take {1e3 * trip_s:.1f} ms, and a tick lasts "
        f"{1e3 / LOOP_RATE_HZ:.2f} ms: check the baud rate and what else the USB hub carries.",
    )
    require(
        jitter_s < _MOST_JITTER_S,
        f"The board's answers scatter by {1e3 * jitter_s:.1f} ms: stop what else runs on this "
        "computer.",
    )
    require(
        0.0 <= sensing_s < _MOST_SENSING_S,
        f"The youngest range samples are {1e3 * sensing_s:.1f} ms old, and 0 to "
        f"{1e3 * _MOST_SENSING_S:g} ms would be plausible: check the sensor's timing budget.",
    )
    spread_s = float(np.hypot(jitter_s, _LEAST_SPREAD_S))
    sentences = [
        f"Sensing {1e3 * sensing_s:.1f} ms, round trip of a command {1e3 * trip_s:.1f} ms."
    ]
    if abs(sensing_s - trip_s) > _ALIKE_S:
        sentences.append(
            "The rig file counts half of the sum as the command's way: "
            f"{500 * (sensing_s + trip_s):.1f} ms."
        )
    found = Calibrated(sensing_s + trip_s, spread_s, "s")
    return Outcome({"latency.round_trip_s": found}, tuple(sentences))
