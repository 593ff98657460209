"""The time-of-flight sensor: sampled, noisy, quantised, with outliers, readable with a delay."""

import math
from collections import deque
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from wakedeploy.core.rig_sections import Disturbance, RangeSensor

Height = TypeVar("Height", float, npt.NDArray[np.float64])


@dataclass(frozen=True, slots=True)
class RangeSample:
    """One reading: range [m] (NaN while there is none), when it was taken [s], 0 for a good one."""

    range_m: float
    sensor_time_s: float
    status: int = 0


NO_SAMPLE = RangeSample(math.nan, -math.inf, 255)


def seen_m(z_m: Height, bias_m: float, scale: float) -> Height:
    """The range [m] at a height, noise apart."""
    return bias_m + scale * z_m


class RangeSensorModel:
    """Takes a sample each period; `newest` gives what can be read `delay_s` after it was taken.

    With `hold_s`, a new reading is made only so often, by a clock of the sensor's own; samples in
    between repeat it under new time stamps.
    """

    def __init__(
        self,
        sensor: RangeSensor,
        disturbance: Disturbance,
        delay_s: float,
        rng: "np.random.Generator",
        hold_s: float = 0.0,
    ) -> None:
        self._sensor, self._disturbance, self._rng = sensor, disturbance, rng
        self._delay_s, self._hold_s = delay_s, hold_s
        self._next_s = float(rng.uniform(0.0, sensor.period_s))
        self._held_m = math.nan
        self._next_reading_s = -float(rng.uniform(0.0, hold_s)) if hold_s > 0.0 else math.inf
        self._waiting: deque[RangeSample] = deque()
        self._readable = NO_SAMPLE

    def observe(self, t_s: float, z_m: float) -> None:
        """Offer the true height [m] at `t_s`; a sample is taken when one is due."""
        if t_s >= self._next_reading_s - 1e-9:
            self._held_m = self._reading(z_m)
            self._next_reading_s += self._hold_s * (
                1 + int((t_s - self._next_reading_s) / self._hold_s)
            )
        if t_s < self._next_s - 1e-9:
            return
        self._next_s += self._sensor.period_s * (
            1 + int((t_s - self._next_s) / self._sensor.period_s)
        )
        reading_m = self._held_m if self._hold_s > 0.0 else self._reading(z_m)
        self._waiting.append(RangeSample(reading_m, t_s))

    def newest(self, t_s: float) -> RangeSample:
        """The newest sample that can be read at `t_s`."""
        while self._waiting and self._waiting[0].sensor_time_s + self._delay_s <= t_s + 1e-9:
            self._readable = self._waiting.popleft()
        return self._readable

    def _reading(self, z_m: float) -> float:
        reading = z_m + self._sensor.noise_m * self._rng.standard_normal()
        # Both draws are always made, so that switching outliers off leaves the noise as it was.
        stray, size = self._rng.random(), self._rng.uniform(-1.0, 1.0)
        if stray < self._disturbance.outlier_probability:
            reading += self._disturbance.outlier_size_m * size
        step = self._sensor.resolution_m
        return max(0.0, round(reading / step) * step if step > 0.0 else reading)
