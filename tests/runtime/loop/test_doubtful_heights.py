"""Heights that cannot be true: noise, strays, and a sufferer in the air that nothing carries."""

from dataclasses import replace

import numpy as np
import pytest

from runtime.loop.estimate import Measurement, initial_estimate
from runtime.loop.estimator import Estimator
from runtime.loop.safety import HELD_UP_MPS
from runtime.loop.settling import Settling, Stage, settled
from runtime.loop.silent_faults import SignReader, Signs
from wakedeploy.physics.rail import GRAVITY_MPS2
from wakedeploy.rig.file import default_rig

RIG = default_rig()
WEIGHT_N = RIG.sufferer.mass_kg * GRAVITY_MPS2
HOVER_US = RIG.thrust.sufferer.pulse(WEIGHT_N)
DT_S = 1.0 / 32.0


def hovering(noise_m, stray_share=0.0, seed=0, seconds=6.0):
    """The estimates of a hover at 0.5 m, one a tick; readings are off from the third second on."""
    rng = np.random.default_rng(seed)
    estimator = Estimator(RIG)
    now = replace(initial_estimate(0.0), height=np.array([0.5, 0.0, 0.0]))
    now = replace(now, rotor_speed=np.sqrt(WEIGHT_N))
    for i in range(round(seconds / DT_S)):
        t_s = (i + 1) * DT_S
        sd_m = noise_m if t_s > 3.0 else RIG.range_sensor.noise_m
        range_m = 0.5 + sd_m * rng.standard_normal()
        if t_s > 3.0 and rng.random() < stray_share:
            range_m = rng.uniform(0.0, 1.2)
        measured = Measurement(t_s, range_m, 0.0, 0, 0)
        now = estimator.step(now, measured, (HOVER_US, HOVER_US))
        yield t_s, now


@pytest.mark.parametrize(("noise_m", "strays"), [(0.004, 0.0), (0.008, 0.0), (0.004, 0.1)])
def test_a_sensor_of_some_noise_and_few_strays_is_flown_with(noise_m, strays):
    for seed in range(3):
        assert not any(now.is_noisy for _, now in hovering(noise_m, strays, seed))


@pytest.mark.parametrize(("noise_m", "strays"), [(0.25, 0.0), (0.004, 0.7)])
def test_much_noise_or_strays_in_most_samples_nearly_always_show(noise_m, strays):
    noticed_s = [
        next((t_s for t_s, now in hovering(noise_m, strays, seed) if now.is_noisy), np.inf)
        for seed in range(8)
    ]
    assert min(noticed_s) > 3.0
    assert sorted(noticed_s)[5] < 5.0  # six of eight, within two seconds


def owed_mps(share, vz_of_t, seconds=0.5):
    """What gravity owes at the end, with this share of the weight carried; speed by time [s]."""
    reader, signs = SignReader(RIG), Signs()
    for i in range(round(seconds / DT_S)):
        t_s = i * DT_S
        signs = reader.step(
            signs,
            t_s=t_s,
            range_m=0.5 + 0.001 * i,
            z_m=0.5,
            vz_mps=vz_of_t(t_s),
            thrust_n=share * WEIGHT_N,
            battery_v=0.0,
        )
    return signs.held_up_mps


def test_a_sufferer_that_does_not_fall_with_a_third_of_its_weight_carried_stands_somewhere():
    assert owed_mps(0.33, lambda t_s: 0.15) > HELD_UP_MPS
    assert owed_mps(0.5, lambda t_s: 0.15) == 0.0  # an updraft may carry half


def test_a_free_fall_and_a_swing_owe_nothing():
    assert owed_mps(0.0, lambda t_s: -GRAVITY_MPS2 * t_s) < 0.2 * HELD_UP_MPS
    assert owed_mps(0.2, lambda t_s: 2.0 * np.sin(8.0 * t_s)) < HELD_UP_MPS


def test_readings_that_end_at_zero_do_not_show_that_it_stands():
    """A sensor that drifted down says zero for the rest of a fall of half a metre."""
    fallen = [max(0.02 - 0.6 * (i * DT_S) ** 2 - 0.002 * i, 0.0) for i in range(18)]
    now = Settling(0.0, 0.0)
    for i, range_m in enumerate(fallen):
        now = settled(now, i * DT_S, range_m, ladder_s=10.0)
    assert now.stage is Stage.SINK


def test_noise_on_the_stop_shows_that_it_stands():
    rng = np.random.default_rng(1)
    now = Settling(0.0, 0.0)
    for i in range(18):
        range_m = max(round(0.002 + 0.004 * rng.standard_normal(), 3), 0.0)
        now = settled(now, i * DT_S, range_m, ladder_s=10.0)
    assert now.stage is Stage.STANDS
