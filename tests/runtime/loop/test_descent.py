"""The way down: a straight line while the height is known, a ladder of pulses while it is not."""

import numpy as np
import pytest

from runtime.loop.blind import BlindPulses, ladder_pulse, ladder_s
from runtime.loop.descent import Descent, descent_reference, has_landed, is_down, limit_s
from wakedeploy.rig.file import default_rig

LIMITS = default_rig().limits
TICK_S = 1.0 / 32.0


def controlled(z_m, start_s=10.0):
    return Descent(start_s, z_m, 0.2, limit_s(start_s, z_m))


def test_the_way_down_is_bounded_and_ends_on_the_stop():
    descent = controlled(0.7)
    aims = [descent_reference(descent, t, 1000.0) for t in np.arange(10.0, 14.0, TICK_S)]
    heights = np.array([aim.z_m for aim in aims])
    assert heights[0] == pytest.approx(0.7)
    assert heights[-1] == 0.0
    assert np.all(np.diff(heights) <= 0.0)
    assert np.min(np.diff(heights)) / TICK_S >= -0.2501
    assert {aim.source_us for aim in aims} == {1000.0}


def test_a_controlled_descent_is_down_where_it_is_low_or_after_twice_its_time():
    assert not is_down(controlled(0.7), 12.0, 0.2)
    assert is_down(controlled(0.7), 13.0, 0.01)
    assert is_down(controlled(0.7), 20.0, 0.5)
    assert not is_down(controlled(3.0), 30.0, 0.5)
    assert is_down(controlled(3.0), 35.0, 0.5)


def test_without_a_height_it_brakes_sinks_more_and_more_and_ramps_to_idle():
    pulses = BlindPulses(1750.0, 1690.0)
    after_s = np.arange(0.0, ladder_s(LIMITS) + 0.5, TICK_S)
    sent_us = np.array([ladder_pulse(pulses, t, LIMITS) for t in after_s])
    assert set(sent_us[after_s < LIMITS.brake_s]) == {1750.0}
    sinks = (after_s >= LIMITS.brake_s) & (after_s < LIMITS.brake_s + LIMITS.sink_s)
    assert sent_us[sinks][0] == pytest.approx(1690.0, abs=1.0)
    slopes = np.diff(sent_us[sinks]) / TICK_S
    assert slopes == pytest.approx(-LIMITS.sink_rate_us_per_s)
    assert sent_us[-1] == 1000.0
    fastest = 1000.0 * TICK_S / LIMITS.sufferer_descent_s
    assert np.max(-np.diff(sent_us[after_s >= LIMITS.brake_s])) <= fastest + 1e-9
    blind = Descent(10.0, 0.7, 0.0, 10.0 + ladder_s(LIMITS), pulses)
    assert not has_landed(blind, 10.0 + ladder_s(LIMITS) - 0.1, LIMITS)
    assert has_landed(blind, 10.0 + ladder_s(LIMITS), LIMITS)
