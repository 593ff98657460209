"""Movable constants: read from a rig, written into one, and how uncertain each of them is."""

from importlib.resources import files

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.physics.constants import (
    DEFAULT_SPREAD,
    NEUTRAL,
    Spread,
    constants_of,
    moved_thrust,
    spreads_of,
    with_constants,
)
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.motor import Motor
from wakedeploy.rig.file import default_rig, parse_rig

RIG = default_rig()
TEXT = files("wakedeploy.rig").joinpath("default_rig.toml").read_text("utf-8")
HOVER_N = RIG.sufferer.mass_kg * 9.81


def rig_with(line: str, instead: str):
    """The default rig with one line of its text replaced."""
    assert line in TEXT
    return parse_rig(TEXT.replace(line, instead, 1))


def test_constants_are_the_rig_files_numbers() -> None:
    known = constants_of(RIG)
    assert known["wake.speed_mps"] == RIG.wake.speed_mps
    assert known["spool.source.down_s"] == RIG.spool.source.down_s
    assert known["rail.stiction_n"] == RIG.rail.stiction_n
    assert {name: known[name] for name in NEUTRAL} == NEUTRAL


def test_every_constant_that_an_effect_or_a_spread_names_exists() -> None:
    known = constants_of(RIG)
    named = {p.constant for effect in LIBRARY.values() for p in effect.parameters}
    assert named - {None} <= set(known)
    assert set(DEFAULT_SPREAD) <= set(known)


def test_constants_written_into_a_rig_are_read_back() -> None:
    moved = {
        "wake.speed_mps": 5.1,
        "wake.speed_exponent": 0.2,
        "spool.sufferer.up_s": 0.08,
        "rail.coulomb_n": 0.07,
        "disturbance.esc_frame_s": 0.01,
    }
    rig = with_constants(RIG, constants_of(RIG) | moved)
    assert constants_of(rig) == pytest.approx(constants_of(RIG) | moved)
    assert rig.sha256 != RIG.sha256


def test_unchanged_constants_leave_the_rig_as_it_is() -> None:
    assert with_constants(RIG, constants_of(RIG)) is RIG


def test_a_moved_thrust_curve_turns_about_hover() -> None:
    constants = {"thrust.sufferer.scale": 1.05, "thrust.sufferer.exponent": 0.9}
    old, new = (
        Motor(r.thrust.sufferer, r.spool.sufferer).curve
        for r in (RIG, with_constants(RIG, constants))
    )
    for pulse_us in (1100.0, 1400.0, 1900.0):  # in the table: no interpolation between
        expected = 1.05 * HOVER_N * (old.thrust(pulse_us) / HOVER_N) ** 0.9
        assert new.thrust(pulse_us) == pytest.approx(expected, rel=1e-9)
    untouched = with_constants(RIG, constants).thrust.source
    assert untouched == RIG.thrust.source


def test_thrust_at_hover_moves_by_the_scale_alone() -> None:
    moved = moved_thrust(np.array([0.0, HOVER_N]), 1.1, 0.7, HOVER_N)
    assert moved == pytest.approx([0.0, 1.1 * HOVER_N])


def test_a_stated_spread_replaces_the_default() -> None:
    line = "speed_mps = 6.0 "
    stated = 'speed_mps = { value = 6.0, spread = 0.9, unit = "m/s", date = "2026-01-01" } '
    spreads = spreads_of(rig_with(line, stated))
    assert spreads_of(RIG)["wake.speed_mps"] == pytest.approx(0.05 * 6.0)
    assert spreads["wake.speed_mps"] == pytest.approx(0.9)
    assert spreads["wake.strength"] == spreads_of(RIG)["wake.strength"]


def test_a_constant_stated_without_uncertainty_is_not_free() -> None:
    line = "speed_mps = 6.0 "
    stated = 'speed_mps = { value = 6.0, spread = 0.0, unit = "m/s", date = "2026-01-01" } '
    assert "wake.speed_mps" not in spreads_of(rig_with(line, stated))


def test_a_thrust_curves_spread_in_newtons_is_taken_at_hover() -> None:
    head, tail = TEXT.split("[thrust.sufferer]")
    curve = tail.split("thrust_n = ")[1].split("\n")[0]
    table = f'{{ value = {curve}, spread = 0.1, unit = "N", date = "2026-01-01" }}'
    rig = parse_rig(head + "[thrust.sufferer]" + tail.replace(curve, table, 1))
    assert spreads_of(rig)["thrust.sufferer.scale"] == pytest.approx(0.1 / HOVER_N)


def test_a_spread_is_the_larger_of_share_and_least() -> None:
    assert Spread(relative=0.1, absolute=0.02).of(-1.0) == pytest.approx(0.1)
    assert Spread(relative=0.1, absolute=0.02).of(0.05) == pytest.approx(0.02)


def test_a_constant_beyond_the_rigs_bounds_is_refused() -> None:
    with pytest.raises(UnusableInput, match="speed_mps"):
        with_constants(RIG, {"wake.speed_mps": -1.0})
