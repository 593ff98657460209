"""Angles that begin again after a turn go on; what never does so, or truly jumps, stays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wakedeploy.core.angles import turn_in, unwrapped

STAMPS_S = np.arange(600) / 50.0
LOWEST = pytest.mark.parametrize("low", [-0.5, 0.0])  # ±180 or 0 to 360


def begun_again(angle, low, turn):
    """As a sensor shows it that knows one turn, which begins at `low` turns."""
    return np.mod(angle - low * turn, turn) + low * turn


def driven(turn):
    """A robot that turns on, back and on again, and shakes."""
    shakes = 0.002 * turn * np.random.default_rng(1).standard_normal(600)
    return turn * (1.4 * np.sin(0.5 * STAMPS_S) + 0.2 * STAMPS_S) + shakes


def offset(found, true):
    """By how much two readings differ, if that is always the same."""
    apart = found - true
    assert np.ptp(apart) < 1e-9 * (1.0 + np.abs(true).max())
    return apart[0]


@LOWEST
@pytest.mark.parametrize(("unit", "turn"), [("rad", 2 * np.pi), ("deg", 360.0), ("turns", 1.0)])
def test_the_motion_comes_back_whatever_the_unit_and_where_a_turn_begins(unit, turn, low) -> None:
    true = driven(turn)
    shown = begun_again(true, low, turn)
    known = turn_in(unit)
    assert known == pytest.approx(turn, rel=1e-15)
    found = unwrapped(shown, known, STAMPS_S)
    jumps = np.abs(np.diff(shown)) > 0.5 * turn
    assert (found.places, found.doubtful) == (jumps.sum(), 0)
    assert found.places > 3
    assert offset(found.values, true) == pytest.approx(shown[0] - true[0])


@LOWEST
@given(st.lists(st.floats(-0.2, 0.2), min_size=3, max_size=80))
def test_any_slow_motion_is_numpys(low, steps) -> None:
    """Where every step is small as against a turn, the shorter way is the only one."""
    true = low + 0.4 + np.cumsum([0.0, 0.2, -0.2, *steps])  # it is as fast within a turn
    shown = begun_again(true, low, 1.0)
    found = unwrapped(shown, 1.0, np.arange(len(true)) / 10.0)
    np.testing.assert_allclose(found.values, np.unwrap(shown, period=1.0), atol=1e-12)


def test_rows_that_are_lost_in_a_jump_are_crossed_the_shorter_way() -> None:
    true = 40.0 * STAMPS_S
    shown = begun_again(true, 0.0, 360.0)
    at = int(np.argmax(shown > 359.0))
    for lost in (1, 5, 100):
        holed = shown.copy()
        holed[at - lost // 2 : at + lost // 2 + 1] = np.nan
        found = unwrapped(holed, 360.0, STAMPS_S)
        assert (found.places, found.doubtful) == (1, 0)
        there = np.isfinite(holed)
        np.testing.assert_allclose(found.values[there], true[there], atol=1e-9)
        np.testing.assert_array_equal(np.isnan(found.values), ~there)
        kept = unwrapped(holed[there], 360.0, STAMPS_S[there])  # the rows are not there at all
        np.testing.assert_allclose(kept.values, true[there], atol=1e-9)


def test_a_slow_sensor_that_repeats_is_unwrapped() -> None:
    true = np.repeat(driven(360.0)[::10], 10)
    found = unwrapped(begun_again(true, -0.5, 360.0), 360.0, STAMPS_S)
    offset(found.values, true)
    assert found.places > 3


def test_one_that_stands_where_a_turn_begins_shakes_there_and_no_more() -> None:
    true = 180.0 + 0.3 * np.random.default_rng(2).standard_normal(600)
    found = unwrapped(begun_again(true, -0.5, 360.0), 360.0, STAMPS_S)
    assert found.places > 200
    assert np.ptp(found.values) < 3.0


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("a joint", 170.0 * np.sin(STAMPS_S)),
        ("an encoder of many turns", 900.0 * np.sin(STAMPS_S)),
        ("one that is set back after many turns", np.mod(100.0 * STAMPS_S, 700.0)),
        ("nothing measured", np.full(600, np.nan)),
        ("one reading", np.where(np.arange(600) == 7, 1.0, np.nan)),
    ],
)
def test_what_does_not_begin_again_stays(name, shown) -> None:
    found = unwrapped(shown, 360.0, STAMPS_S)
    assert (found.places, found.doubtful) == (0, 0), name
    np.testing.assert_array_equal(found.values, shown)


def test_a_jump_that_no_motion_explains_stays_and_is_counted() -> None:
    """A reading that fails, and a joint that a program sets from one end to the other."""
    failed = 20.0 * STAMPS_S
    failed[550] = 0.0  # at 220 degrees
    found = unwrapped(failed, 360.0, STAMPS_S)
    assert (found.places, found.doubtful) == (0, 2)
    np.testing.assert_array_equal(found.values, failed)
    ends = np.where(STAMPS_S < 6.0, -150.0, 150.0)
    found = unwrapped(ends, 360.0, STAMPS_S)
    assert (found.places, found.doubtful) == (0, 1)
    np.testing.assert_array_equal(found.values, ends)


def test_one_that_turns_very_fast_is_unwrapped_where_a_person_is_certain() -> None:
    true = 0.4 * np.arange(600.0)
    shown = begun_again(true, 0.0, 1.0)
    assert unwrapped(shown, 1.0, STAMPS_S).places == 0
    found = unwrapped(shown, 1.0, STAMPS_S, is_certain=True)
    offset(found.values, true)
    assert found.doubtful == 0


@pytest.mark.parametrize("unit", ["m", "1", "rad/s", "Hz", "N m/rad", "furlong", "%"])
def test_only_an_angle_has_a_turn(unit) -> None:
    assert turn_in(unit) is None
