"""Readings older than their stamps show in the motion; pushes and noise do not look like them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from sufferer_in_numbers import AGE_S, DT_S, HOVER_US, RIG, hovering

from runtime.loop.estimate import Measurement
from runtime.loop.estimator import Estimator
from runtime.loop.lateness import Lateness
from runtime.loop.pilot import Pilot
from runtime.loop.safety import RANGE_DOUBTED, RANGE_LATE

SWING_US, SWING_HZ = 160.0, 1.0
SEEDS = range(2)


def flown(late_ticks=0, push_n=0.0, noise_m=0.004, seed=0, seconds=5.0, adopts_at_s=math.inf):
    """(time, evidence, estimated less true height) at each tick of a swing about 0.6 m.

    The truth is the filter's own model of the rig, stepped without readings. A push comes after
    2 s, and so does noise.
    """
    pilot, plant, rng = Pilot(RIG), Estimator(RIG), np.random.default_rng(seed)
    lateness, truth, heights_m = Lateness(RIG), hovering(0.6), []
    state = replace(pilot.initial(0.0), estimate=truth, last_us=HOVER_US, before_last_us=HOVER_US)
    for tick in range(1, round(seconds / DT_S)):
        t_s = tick * DT_S
        pulses = (state.before_last_us, state.last_us)
        truth = plant.ahead(truth, t_s, pulses, push_n if t_s > 2.0 else 0.0)
        heights_m.append(truth.z_m - AGE_S * truth.vz_mps)
        sd_m = noise_m if t_s > 2.0 else 0.004
        seen_m = heights_m[max(tick - 1 - late_ticks, 0)] + sd_m * float(rng.standard_normal())
        before, measured = state, Measurement(t_s, round(seen_m, 3), AGE_S, 0, 0)
        state = lateness.step(before, pilot.estimate(before, measured), measured)
        lateness.catch_up()
        if t_s >= adopts_at_s:
            lateness.adopt()
        pulse_us = HOVER_US + SWING_US * math.cos(2.0 * math.pi * SWING_HZ * t_s)
        state = replace(state, last_us=pulse_us, before_last_us=state.last_us)
        yield t_s, lateness.evidence, state.estimate.z_m - truth.z_m


@pytest.mark.parametrize("late_ticks", [3, 6])
def test_late_readings_are_told_by_a_swing(late_ticks):
    for seed in SEEDS:
        told_s = next(t_s for t_s, told, _ in flown(late_ticks, seed=seed) if told > RANGE_LATE)
        assert told_s < 3.0


@pytest.mark.parametrize("late_ticks", [3, 6])
def test_the_filter_that_is_adopted_knows_the_present(late_ticks):
    off_m = [off for t_s, _, off in flown(late_ticks, adopts_at_s=3.0) if t_s > 3.5]
    plain_m = [off for t_s, _, off in flown(late_ticks) if t_s > 3.5]
    assert np.sqrt(np.mean(np.square(off_m))) < 0.25 * np.sqrt(np.mean(np.square(plain_m)))


@pytest.mark.parametrize(
    "fault", [{}, {"push_n": -2.0}, {"push_n": 2.0}, {"noise_m": 0.02}, {"noise_m": 0.05}]
)
def test_readings_in_time_are_not_called_late(fault):
    for seed in SEEDS:
        assert max(told for _, told, _ in flown(seed=seed, seconds=3.0, **fault)) < RANGE_DOUBTED


def test_a_filter_that_was_adopted_for_nothing_is_left_again():
    for seed in SEEDS:
        off_m = [off for t_s, _, off in flown(seed=seed, adopts_at_s=2.0) if t_s > 4.0]
        assert max(map(abs, off_m)) < 0.02
