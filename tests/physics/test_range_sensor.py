"""The range sensor's statistics and its timing."""

import math

import numpy as np
import pytest

from wakedeploy.core.rig_sections import Disturbance, RangeSensor
from wakedeploy.physics.range_sensor import RangeSensorModel
from wakedeploy.physics.turbulence import OrnsteinUhlenbeck

DT_S = 1.0 / 256.0


def readings(sensor: RangeSensor, disturbance: Disturbance, seconds: float) -> np.ndarray:
    model = RangeSensorModel(sensor, disturbance, 0.009, np.random.default_rng(3))
    seen: list[tuple[float, float]] = []
    for i in range(round(seconds / DT_S)):
        model.observe(i * DT_S, 0.5)
        sample = model.newest(i * DT_S)
        if math.isfinite(sample.range_m) and (not seen or sample.sensor_time_s != seen[-1][0]):
            assert i * DT_S - sample.sensor_time_s >= 0.009 - 1e-6
            seen.append((sample.sensor_time_s, sample.range_m))
    return np.array(seen)


def test_noise_rate_and_resolution_are_those_of_the_rig() -> None:
    sensor = RangeSensor(noise_m=0.004, period_s=0.02, resolution_m=0.001)
    seen = readings(sensor, Disturbance(outlier_probability=0.0), 60.0)
    assert len(seen) == pytest.approx(3000, abs=2)
    assert np.std(seen[:, 1]) == pytest.approx(0.004, rel=0.05)
    assert np.allclose(seen[:, 1] * 1000, np.round(seen[:, 1] * 1000), atol=1e-9)


def test_outliers_come_as_often_as_stated() -> None:
    sensor = RangeSensor(noise_m=0.001, period_s=0.02, resolution_m=0.0)
    seen = readings(sensor, Disturbance(outlier_probability=0.1, outlier_size_m=0.4), 60.0)
    far = np.abs(seen[:, 1] - 0.5) > 0.005
    assert np.mean(far) == pytest.approx(0.1, abs=0.02)


def test_turbulence_has_unit_variance_and_its_correlation_time() -> None:
    process = OrnsteinUhlenbeck(0.08, DT_S, np.random.default_rng(5))
    series = np.array([process.step() for _ in range(100_000)])
    assert np.std(series) == pytest.approx(1.0, abs=0.05)
    lag = round(0.08 / DT_S)
    correlation = np.mean(series[:-lag] * series[lag:]) / np.var(series)
    assert correlation == pytest.approx(math.exp(-lag * DT_S / 0.08), abs=0.05)
