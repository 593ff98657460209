"""Columns of logs that a system asks for: by name, by unit, and not where it could be another."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.guess_asked import Asked, matched
from wakedeploy.domains.tables.reading import read_recordings

VOLTAGE = Asked("motor_v", "input", "V")
PLACE = Asked("cart_m", "output", "m")
ANGLE = Asked("left_hip_pitch_1_rad", "output", "rad")
SPEED = Asked("speed_radps", "output", "rad/s")


def found(asked: list[Asked], columns: dict[str, str | None]) -> dict[str, str]:
    """Names of columns by the names of what they were taken for."""
    places = {("", name): unit for name, unit in columns.items()}
    return {match.asked.name: name for (_, name), match in matched(asked, places).items()}


@pytest.mark.parametrize(
    ("asked", "column", "unit"),
    [
        (VOLTAGE, "motor_mV", "mV"),
        (VOLTAGE, "Motor (V)", "V"),
        (VOLTAGE, "motorVoltage", None),
        (VOLTAGE, "/drive/motor", None),
        (ANGLE, "left hip/pitch-1", None),
        (ANGLE, "LeftHipPitch1 [deg]", "deg"),
        (PLACE, "encoder_mm", "mm"),
        (Asked("position_m", "output", "m"), "pos", None),
        (SPEED, "gyro", "deg/s"),
    ],
)
def test_a_column_is_known_by_its_name_or_its_unit(asked: Asked, column: str, unit) -> None:
    assert found([asked], {column: unit, "temperature": "K"}) == {asked.name: column}


@pytest.mark.parametrize(
    ("asked", "columns"),
    [
        (VOLTAGE, {"motor_rpm": "rpm"}),  # another quantity of the same thing
        (VOLTAGE, {"left_motor": "V", "right_motor": "V"}),
        (ANGLE, {"ratio": "1"}),  # an angle is no pure number
        (PLACE, {"x": None, "y": None}),
        (Asked("share", "input", "1"), {"load": "%"}),
        (PLACE, {}),
    ],
)
def test_what_could_be_two_or_has_another_quantity_is_neither(asked: Asked, columns) -> None:
    assert found([asked], columns) == {}


def test_names_come_before_units_and_the_likest_first() -> None:
    cart, load = PLACE, Asked("load_m", "output", "m")
    columns = {"cart_ref_m": "m", "cart_m": "m", "hook": "m", "hook_mps": "m/s"}
    assert found([load, cart], columns) == {"cart_m": "cart_m"}
    del columns["cart_ref_m"]
    assert found([load, cart], columns) == {"cart_m": "cart_m", "load_m": "hook"}


@given(
    st.lists(st.sampled_from("abcdef"), unique=True),
    st.dictionaries(st.text(max_size=8), st.sampled_from([None, "m", "mm", "V"]), max_size=6),
)
def test_nothing_is_found_twice_and_the_order_does_not_matter(names, columns) -> None:
    asked = [Asked(f"{name}_m", "output", "m") for name in names]
    forth = found(asked, columns)
    assert len(set(forth.values())) == len(forth)
    assert forth == found(asked[::-1], dict(reversed(columns.items())))


def log(path: Path, header: str) -> Path:
    t = np.arange(500) / 100.0
    rows = [t, 3.0 * np.sin(t), 1e3 * np.cos(t), np.where(t < 2.0, t, np.nan)]
    np.savetxt(path, np.column_stack(rows), "%.5f", ",", header=header, comments="")
    return path


def test_what_is_written_is_read_in_the_systems_names_and_units(tmp_path: Path) -> None:
    path = log(tmp_path / "log.csv", "t,motor,encoder_mm,note")
    text = guess_columns(path, [VOLTAGE, PLACE, SPEED])
    assert 'unit = "V"  # ? the log does not say; taken as the system has it' in text
    assert 'column = "encoder_mm"  # ? the only one left in such a unit' in text
    assert "# Not found: speed_radps, an output in rad/s." in text
    (one,) = read_recordings([path], parse_columns(text), {"cart_m": "m"}).recordings
    assert set(one.columns) == {"motor_v", "cart_m"}
    assert one.columns["cart_m"] == pytest.approx(np.cos(np.arange(500) / 100.0), abs=1e-4)


def test_no_other_column_takes_a_name_that_is_asked_for(tmp_path: Path) -> None:
    """A column that is called as an output, in another quantity, is left to the person."""
    path = log(tmp_path / "log.csv", "t,motor (V),cart_m (V),note")
    text = guess_columns(path, [VOLTAGE, PLACE])
    assert "[columns.cart_m_2]" in text
    assert "# Not found: cart_m, an output in m." in text
