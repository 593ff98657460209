"""The bounds of thrust before a stop, and a touch-down that begins in the air."""

from dataclasses import replace

import numpy as np

from runtime.loop.estimate import Estimate, initial_estimate
from runtime.loop.settling import Stage, begun
from runtime.loop.stops import LOWER_MPS, Stops
from wakedeploy.physics.rail import GRAVITY_MPS2
from wakedeploy.rig.file import default_rig

RIG = default_rig()
WEIGHT_N = RIG.sufferer.mass_kg * GRAVITY_MPS2


def at(z_m: float, vz_mps: float) -> Estimate:
    sure = replace(initial_estimate(0.0), height_cov=np.zeros((3, 3)))
    return replace(sure, height=np.array([z_m, vz_mps, 0.0]), rotor_speed=WEIGHT_N**0.5)


def test_far_from_a_stop_or_slow_there_are_no_bounds() -> None:
    for now in (at(0.6, 0.5), at(0.6, -0.5), at(0.05, -0.3), at(0.0, 0.0)):
        assert not np.isfinite([Stops(RIG).ahead(now, 0.0).least_n]).any()


def test_the_least_thrust_meets_the_lower_stop_softly() -> None:
    now = at(0.3, -1.5)
    least_n = Stops(RIG).ahead(now, 0.0).least_n
    lag_s = 0.5 * (RIG.latency.round_trip_s + RIG.disturbance.esc_frame_s) + 0.06
    left_m, braking_mps2 = 0.3 - 1.5 * lag_s, (least_n - WEIGHT_N) / RIG.sufferer.mass_kg
    assert np.isclose(1.5**2 - 2.0 * braking_mps2 * left_m, LOWER_MPS**2, rtol=1e-3)


def test_where_full_thrust_is_too_little_the_source_is_to_idle() -> None:
    assert Stops(RIG).ahead(at(0.1, -1.5), -2.0).is_short


def test_a_touch_down_in_the_air_sinks_before_it_is_tested() -> None:
    assert begun(at(0.2, 0.0), 1.0).stage is Stage.SINK
    assert begun(at(0.01, 0.0), 1.0).stage is Stage.TEST
