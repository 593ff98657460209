"""Columns of an angle that begins again after a turn: as outputs they go on, and it is said."""

from pathlib import Path

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.reading import Reading, read_recordings

YAW = '[columns.yaw]\ncolumn = "yaw"\nunit = "{}"\nrole = {}\n{}'
STAMPS_S = np.arange(400) / 20.0
TRUE = 1.5 * STAMPS_S  # rad: nearly five turns


def reading(
    folder: Path,
    values: np.ndarray,
    unit: str = "rad",
    role: str = '"output"',
    more: str = "",
    below: str = "",
) -> Reading:
    path = folder / "log.csv"
    rows = [f"{t},{'' if np.isnan(v) else v}" for t, v in zip(STAMPS_S, values, strict=True)]
    path.write_text("\n".join(["t,yaw", *rows]) + "\n")
    text = 'version = 1\n[time]\ncolumn = "t"\n' + below + YAW.format(unit, role, more)
    return read_recordings([path], parse_columns(text))


def wrapped(true: np.ndarray = TRUE) -> np.ndarray:
    return np.arctan2(np.sin(true), np.cos(true))


@pytest.mark.parametrize(
    ("unit", "shown", "places"),
    [
        ("rad", wrapped(), 5),
        ("deg", np.rad2deg(np.mod(TRUE, 2 * np.pi)), 4),
        ("rev", np.mod(TRUE / (2 * np.pi), 1.0), 4),
        ("mrad", 1000.0 * wrapped(), 5),
    ],
)
def test_an_output_goes_on_and_it_is_said(
    unit: str, shown: np.ndarray, places: int, tmp_path: Path
) -> None:
    read = reading(tmp_path, shown, unit)
    np.testing.assert_allclose(read.recordings[0].columns["yaw"], TRUE, atol=1e-9)
    (note,) = read.notes
    assert note.endswith(f"column 'yaw': unwrapped at {places} places")


def test_rows_that_are_lost_and_a_rate_of_its_own_change_nothing(tmp_path: Path) -> None:
    shown = wrapped()
    shown[40:44] = np.nan  # in the first jump
    at = "[resample]\nrate_hz = 40\n"
    for missing in ("nan", "hold"):
        read = reading(tmp_path, shown, more=f'missing = "{missing}"\n', below=at)
        (recording,) = read.recordings
        there = np.isfinite(recording.columns["yaw"])
        np.testing.assert_allclose(
            recording.columns["yaw"][there], 1.5 * recording.time_s[there], atol=0.04
        )
        assert "unwrapped at 5 places" in read.notes[0]


def test_a_filter_sees_no_jump(tmp_path: Path) -> None:
    """What is filtered first and unwrapped then has values that were never there."""
    read = reading(
        tmp_path, wrapped(), below='[resample]\nrate_hz = 20\nmethod = "low-pass"\ncutoff_hz = 4\n'
    )
    values = read.recordings[0].columns["yaw"]
    np.testing.assert_allclose(np.diff(values[40:]), 0.075, atol=1e-3)


@pytest.mark.parametrize("role", ['"input"', '["output", "observation"]', '"observation"'])
def test_what_is_commanded_or_learnt_from_stays_unless_a_person_says(
    role: str, tmp_path: Path
) -> None:
    read = reading(tmp_path, wrapped(), role=role)
    np.testing.assert_array_equal(read.recordings[0].columns["yaw"], wrapped())
    assert "jumps by a turn at 5 places" in read.notes[0]
    assert "wraps = true in [columns.yaw] lets it go on" in read.notes[0]
    told = reading(tmp_path, wrapped(), role=role, more="wraps = true\n")
    np.testing.assert_allclose(told.recordings[0].columns["yaw"], TRUE, atol=1e-9)
    assert not reading(tmp_path, wrapped(), role=role, more="wraps = false\n").notes


def test_a_person_keeps_an_output_as_it_is(tmp_path: Path) -> None:
    read = reading(tmp_path, wrapped(), more="wraps = false\n")
    np.testing.assert_array_equal(read.recordings[0].columns["yaw"], wrapped())
    assert not read.notes


def test_counts_of_a_sensor_of_one_turn_are_an_angle_by_their_scale(tmp_path: Path) -> None:
    counts = np.floor(np.mod(TRUE / (2 * np.pi), 1.0) * 4096)
    read = reading(tmp_path, counts, "deg", more=f"scale = {360 / 4096}\n")
    np.testing.assert_allclose(read.recordings[0].columns["yaw"], TRUE, atol=2 * np.pi / 4096)


def test_jumps_that_are_no_whole_turn_are_said_and_left(tmp_path: Path) -> None:
    shown = np.rad2deg(TRUE) % 360.0
    glitch = int(np.argmax(shown > 200.0))
    shown[glitch] = 0.0
    (note,) = reading(tmp_path, shown, "deg").notes
    assert "unwrapped at 4 places; it jumps by more than half a turn at 2 places" in note
    fast = np.rad2deg(wrapped(50.0 * STAMPS_S))  # 0.4 turns between two readings
    (note,) = reading(tmp_path, fast, "deg").notes
    assert "if it turns so fast give wraps = true in [columns.yaw], else wraps = false" in note
    read = reading(tmp_path, fast, "deg", more="wraps = true\n")
    np.testing.assert_allclose(read.recordings[0].columns["yaw"], 50.0 * STAMPS_S, atol=1e-6)


def test_what_is_no_angle_has_no_turn(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match=r"columns\.yaw\.wraps: 'm' is no unit of an angle"):
        reading(tmp_path, wrapped(), "m", more="wraps = true\n")
    assert not reading(tmp_path, wrapped(), "m").notes
