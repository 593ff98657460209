"""A push is told from readings that add up; noise, strays and a hand in the beam are none."""

from dataclasses import replace

import numpy as np
import pytest
from sufferer_in_numbers import AGE_S, DT_S, HOVER_US, RIG, hovering, moved, reading

from runtime.loop.estimate import Measurement
from runtime.loop.estimator import Estimator

BEGINS_S = 1.0
SEEDS = range(6)


def followed(push_n=0.0, noise_m=0.004, seed=0, seconds=1.5, changed=lambda t_s, one: one):
    """(time since the fault, its true speed, the estimate) at each tick from a second on."""
    rng, estimator, now = np.random.default_rng(seed), Estimator(RIG), hovering(0.6)
    motion = moved(0.6, lambda t_s: push_n if t_s > BEGINS_S else 0.0, BEGINS_S + seconds)
    for t_s, z_m, vz_mps in motion:
        since_s = t_s - BEGINS_S
        one = reading(t_s, z_m, vz_mps, rng, noise_m if since_s > 0.0 else 0.004)
        now = estimator.step(now, changed(since_s, one), (HOVER_US, HOVER_US))
        if since_s > 0.0:
            yield since_s, vz_mps, now


@pytest.mark.parametrize(("push_n", "within_s"), [(-3.0, 0.17), (-2.0, 0.3), (2.0, 0.3)])
def test_a_push_is_known_soon(push_n, within_s):
    for seed in SEEDS:
        known_s = next(
            since_s
            for since_s, vz_mps, now in followed(push_n, seed=seed, seconds=0.5)
            if abs(now.vz_mps - vz_mps) < 0.4 and now.disturbance_n / push_n > 0.8
        )
        assert known_s < within_s


def test_a_push_off_the_stop_is_known_as_soon():
    """As with pulses that are too long at lift-off: the stop itself pushes only what sinks."""
    for seed in SEEDS:
        rng, estimator = np.random.default_rng(seed), Estimator(RIG)
        now, known_s = hovering(0.0), None
        for t_s, z_m, vz_mps in moved(0.0, lambda _: 3.0, 0.5):
            one = reading(t_s, z_m, vz_mps, rng)
            now = estimator.step(now, one, (HOVER_US, HOVER_US))
            if known_s is None and abs(now.vz_mps - vz_mps) < 0.3 and now.disturbance_n > 2.1:
                known_s = t_s
        assert known_s < 0.25


def test_a_stray_as_the_push_begins_delays_it_by_little():
    def strayed(since_s, one):
        return replace(one, range_m=one.range_m - 0.15) if 0.0 < since_s < DT_S else one

    for seed in SEEDS:
        last = [now for since_s, _, now in followed(-3.0, seed=seed, changed=strayed)][8]
        assert last.disturbance_n < -1.5


@pytest.mark.parametrize("noise_m", [0.02, 0.05, 0.1])
def test_noise_that_begins_at_once_is_no_motion(noise_m):
    """A single reading of the rig file's noise would be worth metres a second."""
    for seed in SEEDS:
        speeds = np.array([now.vz_mps for _, _, now in followed(noise_m=noise_m, seed=seed)])
        assert np.count_nonzero(np.abs(speeds) > 1.0) <= 5  # of 48 ticks
        assert np.sqrt(np.mean(speeds**2)) < 1.0


@pytest.mark.parametrize("off_m", [0.055, 0.07])
def test_a_push_that_was_none_is_taken_back(off_m):
    """Something comes into the beam: near enough for what a push does in three ticks."""

    def hidden(since_s, one):
        return replace(one, range_m=one.range_m + off_m) if since_s > 0.0 else one

    for seed in SEEDS:
        estimates = [now for _, _, now in followed(seed=seed, seconds=0.4, changed=hidden)]
        assert max(abs(now.vz_mps) for now in estimates[5:]) < 1.5
        assert abs(estimates[-1].disturbance_n) < 0.5


def test_the_first_reading_after_a_pause_does_not_tell_the_speed_alone():
    estimator, now = Estimator(RIG), hovering(0.6)
    for tick in range(1, 33):
        now = estimator.step(now, Measurement(tick * DT_S, 0.6, AGE_S, 0, 0), (HOVER_US, HOVER_US))
    paused_s = now.t_s + 0.27
    stray = Measurement(paused_s, 0.49, AGE_S, 0, 0)
    now = estimator.step(now, stray, (HOVER_US, HOVER_US))
    for tick in (1, 2):
        good = Measurement(paused_s + tick * DT_S, 0.6, AGE_S, 0, 0)
        now = estimator.step(now, good, (HOVER_US, HOVER_US))
    assert abs(now.vz_mps) < 0.3
    assert now.z_m == pytest.approx(0.6, abs=0.02)


def test_one_filter_at_most_goes_on_beside():
    """Through noise for seconds, too: each would cost a tick's time."""
    for _, _, now in followed(noise_m=0.1, seconds=3.0):
        assert now.unpushed is None or now.unpushed.unpushed is None


def test_the_same_reading_again_tells_of_no_push():
    def pinned(since_s, one):
        return replace(one, range_m=0.56, alike=5) if since_s > 0.0 else one

    assert max(now.height_cov[1, 1] for _, _, now in followed(changed=pinned, seconds=0.3)) < 0.25
