"""Times that are even but for their jitter."""

import numpy as np
import pytest

from wakedeploy.core.even_time import evened, meant_hz, unevenness


def test_steps_are_even_up_to_half_of_one() -> None:
    stamps_s = np.arange(100) / 100
    assert unevenness(stamps_s) is None
    late = stamps_s.copy()
    late[40] += 0.0045
    assert unevenness(late) is None
    assert unevenness(np.delete(stamps_s, 40)) == 40
    jittery = stamps_s + np.random.default_rng(0).uniform(-0.002, 0.002, 100)
    assert np.abs(evened(jittery) - stamps_s).max() < 0.001
    np.testing.assert_allclose(np.diff(evened(jittery)), np.diff(evened(jittery))[0], rtol=1e-9)


def test_times_that_stand_still_or_are_no_numbers_are_uneven() -> None:
    assert unevenness(np.zeros(5)) == 1
    assert unevenness(np.array([0.0, 0.1, np.nan, 0.3, 0.4])) is not None
    assert unevenness(np.array([0.0, 0.1, 0.2, 0.15, 0.3])) == 3


def test_the_step_of_rounded_times_is_that_of_the_clock_behind_them() -> None:
    """A log of 128 Hz whose times have milliseconds: most steps are 8 ms, the mean is 7.8125."""
    rounded_s = np.round(np.arange(1000) / 128, 3)
    assert np.median(np.diff(rounded_s)) == pytest.approx(0.008)
    assert unevenness(rounded_s) is None
    np.testing.assert_allclose(np.diff(evened(rounded_s)).mean(), 1 / 128, rtol=1e-5)


@pytest.mark.parametrize(
    "stated", [50.0, 32.0, 62.5, 31.25, 1 / 0.03, 29.97, 49.7213, 23.976, 128.0]
)
def test_a_rate_is_the_one_that_its_clock_just_misses(stated: float) -> None:
    """By a few millionths, as jitter leaves it; a rate that is none of few digits stays itself."""
    for miss in (-4e-6, 0.0, 4e-6):
        rate_hz = stated * (1.0 + miss)
        assert meant_hz(rate_hz) == pytest.approx(stated, rel=5e-6)
    assert meant_hz(stated) == float(f"{stated:.6g}")


def test_clocks_that_miss_a_rate_by_a_few_millionths_mean_the_same_one() -> None:
    assert {meant_hz(50.0 * (1.0 + miss)) for miss in (-4e-6, 4e-6, 9e-5)} == {50.0}
    assert meant_hz(50.02) == 50.02
