"""Even rates of uneven logs: the past alone decides, and a clock that jitters loses no sample."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from wakedeploy.domains.tables.resampling import (
    averaged,
    even_ticks,
    held,
    interpolated,
    low_passed,
)

Vector = NDArray[np.float64]

STEPS = st.lists(st.floats(1e-4, 0.3), min_size=3, max_size=60)


@st.composite
def logs(draw: st.DrawFn) -> tuple[Vector, Vector]:
    stamps_s = np.cumsum(draw(STEPS)) + draw(st.sampled_from([0.0, 1000.0]))
    values = draw(st.lists(st.floats(-1e6, 1e6), min_size=len(stamps_s), max_size=len(stamps_s)))
    return stamps_s, np.array(values)


def ticks_of(stamps_s: Vector, rate_hz: float) -> Vector:
    return even_ticks([stamps_s], float(stamps_s[0]), float(stamps_s[-1]), rate_hz)


@given(logs(), st.floats(1.0, 200.0))
def test_hold_gives_the_newest_sample_and_never_looks_ahead(
    log: tuple[Vector, Vector], rate_hz: float
) -> None:
    stamps_s, values = log
    ticks_s = ticks_of(stamps_s, rate_hz)
    for tick_s, value in zip(ticks_s, held(stamps_s, values, ticks_s), strict=True):
        past = [v for t, v in zip(stamps_s, values, strict=True) if t <= tick_s]
        assert value == past[-1]


@pytest.mark.parametrize("jitter_s", [0.0, 0.0004, 0.002])
@pytest.mark.parametrize("lost", [[], [400, 1100, 1101], list(range(30, 1990, 40))])
def test_no_sample_is_lost_to_the_ticks_of_a_clock_that_jitters(
    jitter_s: float, lost: list[int]
) -> None:
    rng = np.random.default_rng(0)
    number = np.delete(np.arange(2000.0), lost)
    stamps_s = np.arange(2000) / 50 + np.clip(jitter_s * rng.standard_normal(2000), -0.008, 0.008)
    stamps_s = np.delete(stamps_s, lost)
    taken = np.unique(held(stamps_s, number, ticks_of(stamps_s, 50.0)))
    assert len(taken) >= len(number) - 1


@given(logs(), st.floats(2.0, 50.0), st.data())
def test_no_filter_knows_a_sample_of_the_future(
    log: tuple[Vector, Vector], rate_hz: float, data: st.DataObject
) -> None:
    stamps_s, values = log
    ticks_s = ticks_of(stamps_s, rate_hz)
    if len(ticks_s) < 2:
        return
    at = data.draw(st.integers(1, len(values) - 1))
    others = values.copy()
    others[at:] += data.draw(st.floats(-1e6, 1e6))
    before = ticks_s < stamps_s[at]
    for way in (held, lambda *of: low_passed(*of, cutoff_hz=rate_hz / 4)):
        one, other = way(stamps_s, values, ticks_s), way(stamps_s, others, ticks_s)
        assert np.array_equal(one[before], other[before])


@given(logs(), st.floats(1.0, 500.0))
def test_ticks_are_even_and_lie_within_the_log(log: tuple[Vector, Vector], rate_hz: float) -> None:
    stamps_s, _ = log
    ticks_s = ticks_of(stamps_s, rate_hz)
    np.testing.assert_allclose(np.diff(ticks_s), 1 / rate_hz, rtol=1e-6)
    if len(ticks_s):
        assert stamps_s[0] <= ticks_s[0]
        assert (
            ticks_s[-1]
            <= stamps_s[-1] + 0.46 * float(np.median(np.diff(stamps_s))) + 1e-5 / rate_hz
        )


@pytest.mark.parametrize("start_s", [0.0, 1.7e9])
@pytest.mark.parametrize("every", [1, 4])
def test_a_clock_that_jitters_has_each_sample_at_its_own_tick(start_s: float, every: int) -> None:
    rng = np.random.default_rng(0)
    stamps_s = start_s + np.arange(4000) / 1000 + rng.uniform(-2e-4, 2e-4, 4000) / 2
    ticks_s = ticks_of(stamps_s, 1000 / every)
    taken = held(stamps_s, np.arange(4000.0), ticks_s)
    assert set(np.diff(taken)) == {every}


def test_the_filter_is_scipys_butterworth_and_passes_a_constant() -> None:
    stamps_s = np.arange(8000) / 4000
    values = np.sin(40 * stamps_s) + np.random.default_rng(0).normal(0, 1, 8000)
    ticks_s = np.arange(0, 799) / 400
    sos = butter(2, 80.0, fs=4000, output="sos")
    rest = np.concatenate([np.full(4000, values[0]), values])  # long at rest before it begins
    wanted = sosfilt(sos, rest - values[0])[4000:][::10] + values[0]
    np.testing.assert_allclose(low_passed(stamps_s, values, ticks_s, 80.0), wanted[:799], atol=1e-9)
    np.testing.assert_allclose(low_passed(stamps_s, np.full(8000, 3.5), ticks_s, 80.0), 3.5)


def test_the_filter_keeps_what_is_below_its_cut_off_from_folding() -> None:
    stamps_s = np.arange(20_000) / 4000
    hum = np.sin(2 * np.pi * 390.0 * stamps_s)  # at 400 Hz it would be seen as 10 Hz
    ticks_s = np.arange(1900) / 400
    assert held(stamps_s, hum, ticks_s).std() > 0.7
    assert low_passed(stamps_s, hum, ticks_s, 40.0)[100:].std() < 0.01


def test_the_mean_over_a_tick_is_that_of_a_sine_and_keeps_hum_from_folding() -> None:
    """The mean of a sine over a step is the sine at its middle, times sin(x) / x."""
    stamps_s = np.arange(20_000) / 1000
    ticks_s = 1.0 + np.arange(300) / 20
    for hz, most in ((1.3, 0.02), (90.0, 0.02)):
        x = np.pi * hz / 20
        wanted = np.sin(2 * np.pi * hz * ticks_s) * np.sin(x) / x
        found = averaged(stamps_s, np.sin(2 * np.pi * hz * stamps_s), ticks_s)
        assert np.abs(found - wanted).max() < most * 0.1 + 1e-5
    assert held(stamps_s, np.sin(2 * np.pi * 90.7 * stamps_s), ticks_s).std() > 0.7


@given(logs(), st.floats(1.0, 200.0))
def test_the_mean_over_a_tick_is_the_area_under_straight_lines(
    log: tuple[Vector, Vector], rate_hz: float
) -> None:
    stamps_s, values = log
    ticks_s = ticks_of(stamps_s, rate_hz)
    if len(ticks_s) < 2:
        return
    found = averaged(stamps_s, values, ticks_s)
    scale = np.abs(values).max() + 1e-9
    assert found.min() >= values.min() - 1e-6 * scale
    assert found.max() <= values.max() + 1e-6 * scale
    np.testing.assert_allclose(
        averaged(stamps_s, 2.0 * stamps_s + 1.0, ticks_s)[1:-1], 2.0 * ticks_s[1:-1] + 1.0,
        rtol=1e-5, atol=1e-4,
    )  # fmt: skip


def test_a_slow_force_is_nearer_to_the_truth_on_straight_lines_than_held() -> None:
    slow_s, ticks_s = np.arange(120) / 4, np.arange(580) / 20
    truth = np.sin(2 * np.pi * 0.3 * ticks_s)
    seen = np.sin(2 * np.pi * 0.3 * slow_s)
    on_lines = interpolated(slow_s, seen, ticks_s)
    np.testing.assert_array_equal(on_lines, np.interp(ticks_s, slow_s, seen))
    rms_held = np.sqrt(np.mean((held(slow_s, seen, ticks_s) - truth) ** 2))
    rms_on_lines = np.sqrt(np.mean((on_lines - truth) ** 2))
    assert rms_on_lines < 0.15 * rms_held
