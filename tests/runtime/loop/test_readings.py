"""What a range sensor cannot mean stays outside, whatever its own status says."""

import math
from dataclasses import replace

import pytest

from runtime.io.range_source import NOTHING_IN_RANGE_MM, STATUS_NO_TARGET, RangeReading
from runtime.loop.readings import AHEAD_S, RangeDoor
from runtime.loop.safety import SAMPLE_OLD_S
from wakedeploy.rig.file import default_rig

RIG = default_rig()
NOW_S, AGE_S = 100.0, 0.02
GOOD = RangeReading(500.0, round(1e6 * (NOW_S - AGE_S)))


def seen(**changes):
    """A reading as the door lets it in, or not."""
    return RangeDoor(RIG).step(replace(GOOD, **changes), NOW_S)


def test_a_good_sample_passes_with_its_age():
    let_in = seen()
    assert let_in.range_m == 0.5
    assert let_in.age_s == pytest.approx(AGE_S)
    assert not let_in.is_bad
    assert let_in.silence_s == 0.0


@pytest.mark.parametrize(
    "range_mm", [math.nan, math.inf, -math.inf, float(NOTHING_IN_RANGE_MM), 1e303, -200.0]
)
def test_an_impossible_range_of_good_status_is_bad_and_not_let_in(range_mm):
    kept_out = seen(range_mm=range_mm)
    assert kept_out.is_bad
    assert math.isnan(kept_out.range_m)


def test_noise_at_either_stop_is_possible():
    for height_m in (0.0, RIG.sufferer.travel_m):
        for off_m in (-0.02, 0.02):
            assert not seen(range_mm=1e3 * (height_m + off_m)).is_bad


@pytest.mark.parametrize("age_s", [1.0, SAMPLE_OLD_S + 1e-3, -AHEAD_S - 1e-3, -1.0])
def test_a_stamp_of_another_time_makes_a_good_range_bad(age_s):
    kept_out = seen(sensor_time_us=round(1e6 * (NOW_S - age_s)))
    assert kept_out.is_bad
    assert math.isnan(kept_out.range_m)


@pytest.mark.parametrize("age_s", [SAMPLE_OLD_S - 1e-3, 0.0, -AHEAD_S + 1e-3])
def test_a_stamp_within_the_clocks_resolution_or_not_yet_old_is_believed(age_s):
    assert not seen(sensor_time_us=round(1e6 * (NOW_S - age_s))).is_bad


def test_no_target_is_nothing_new_and_nothing_bad():
    nothing = seen(range_mm=float(NOTHING_IN_RANGE_MM), status=STATUS_NO_TARGET)
    assert math.isnan(nothing.range_m)
    assert not nothing.is_bad


def test_impossible_samples_are_silence_however_often_they_come():
    door, silence_s = RangeDoor(RIG), []
    for tick in range(10):
        now_s = NOW_S + tick / 32.0
        mm = 500.0 if tick == 0 else math.nan
        silence_s.append(door.step(RangeReading(mm, round(1e6 * now_s)), now_s).silence_s)
    assert silence_s == pytest.approx([tick / 32.0 for tick in range(10)])
