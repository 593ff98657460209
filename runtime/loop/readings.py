"""The door for range samples: it refuses what a sensor cannot mean, or says again and again.

In: readings as they come. Out: what the estimator may take in, and how long nothing has come.
"""

import math
from dataclasses import dataclass

from runtime.io.range_source import RangeReading
from runtime.loop.safety import SAMPLE_OLD_S
from runtime.loop.silent_faults import may_repeat
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.physics.effects.chain import unplaced_constants

ABOVE_M, BELOW_M = 0.3, 0.1  # past the stops: noise, outliers and calibration reach this far
# Nearer, a sensor that cannot read below zero says the same again and again.
NEAR_M, NEAR_SD = 0.02, 4.0
AHEAD_S = 0.005  # how far a sample's stamp may lie in the future: two clocks' resolution
MOST_SILENCE_S = 2.0 / LOOP_RATE_HZ  # the most that one look can add


@dataclass(frozen=True, slots=True)
class Seen:
    """One tick's look at the sensor: range [m] (NaN: none), age [s], and what is wrong with it."""

    range_m: float
    age_s: float
    repeats: int  # ticks since this sample was new
    is_bad: bool = False  # good by its own status, but impossible
    same: int = 0  # samples in a row that are new by their stamps but the same, off the stop
    alike: int = 0  # the same anywhere: on the stop half of all may read zero
    silence_s: float = 0.0  # since the last new sample that can be believed


class RangeDoor:
    """Remembers from tick to tick the newest stamp, and how often a value came."""

    def __init__(self, rig: Rig) -> None:
        constants = unplaced_constants(rig)
        bias_m, scale = constants["range.bias_m"], constants["range.scale"]
        self._near_m = bias_m + max(NEAR_M, NEAR_SD * rig.range_sensor.noise_m)
        self._low_m = bias_m - BELOW_M
        self._high_m = bias_m + scale * rig.sufferer.travel_m + ABOVE_M
        self._may_repeat = may_repeat(rig)
        self._newest_us, self._repeats = -1, 0
        self._value_m, self._alike = math.nan, 0
        self._silence_s, self._looked_s = 0.0, math.nan

    def step(self, reading: RangeReading, now_s: float) -> Seen:
        """Look at the newest reading."""
        is_new = reading.sensor_time_us != self._newest_us
        self._repeats = 0 if is_new else self._repeats + 1
        self._newest_us = reading.sensor_time_us
        age_s = now_s - reading.sensor_time_s
        is_possible = self._is_possible(reading, age_s)
        # A loop that stood still could not look: that is no silence of the sensor.
        passed_s, self._looked_s = now_s - self._looked_s, now_s
        self._silence_s += min(passed_s, MOST_SILENCE_S) if passed_s > 0.0 else 0.0
        if is_new and is_possible:
            self._silence_s = 0.0
            self._alike = self._alike + 1 if reading.range_m == self._value_m else 0
            self._value_m = reading.range_m
        alike = 0 if self._may_repeat else self._alike
        return Seen(
            reading.range_m if is_possible else math.nan,
            age_s,
            self._repeats,
            is_bad=reading.status == 0 and not is_possible,
            same=alike if self._value_m > self._near_m else 0,
            alike=alike,
            silence_s=self._silence_s,
        )

    def _is_possible(self, reading: RangeReading, age_s: float) -> bool:
        """Whether value and stamp can be a rig's, and not a fault's; False for NaN."""
        in_range = self._low_m <= reading.range_m <= self._high_m
        return in_range and -AHEAD_S <= age_s <= SAMPLE_OLD_S
