"""New values go into a rig file without touching anything else in it."""

import datetime
import re
import threading
import time

import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.units import unit_of
from wakedeploy.rig import update
from wakedeploy.rig.file import default_rig, default_rig_text, parse_rig, read_rig
from wakedeploy.rig.update import Calibrated, update_rig

DATE = "2026-01-31"
TRIP = {"latency.round_trip_s": Calibrated(0.0212345678, 0.0004, "s")}


@pytest.fixture
def rig_file(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(default_rig_text())
    return path


def test_one_line_changes_and_keeps_its_comment(rig_file):
    after, kept = update_rig(rig_file, TRIP, DATE)
    assert kept
    before, now = default_rig_text().splitlines(), rig_file.read_text().splitlines()
    (changed,) = [(a, b) for a, b in zip(before, now, strict=True) if a != b]
    assert changed[0].startswith("round_trip_s = 0.018")
    assert changed[1] == (
        'round_trip_s = { value = 0.0212346, spread = 0.0004, unit = "s", date = "2026-01-31" }'
        "  # read in the paper: communication and sensing together"
    )
    again = read_rig(rig_file)
    assert again == after
    assert again.latency.round_trip_s == 0.0212346
    known = again.calibration["latency.round_trip_s"]
    assert (known.spread, known.unit, known.date) == (0.0004, "s", DATE)
    assert datetime.date.fromisoformat(known.date)


def test_a_calibration_is_renewed_and_curves_bias_and_lags_find_their_places(rig_file):
    update_rig(rig_file, TRIP, "2025-12-24")
    thrust_n = tuple(1.05 * n for n in default_rig().thrust.sufferer.thrust_n)
    several = TRIP | {
        "thrust.sufferer.thrust_n": Calibrated(thrust_n, 0.03, "N"),
        "range_sensor.bias_m": Calibrated(0.031, 0.0002, "m"),
        "range_sensor.scale": Calibrated(1.01, 0.001),
        "spool.sufferer.down_s": Calibrated(0.12, 0.004, "s"),
        "stepper.steps_per_m": Calibrated(4100.0, 7.0, "steps/m"),
    }
    after, kept = update_rig(rig_file, several, DATE)
    assert kept
    assert "# read in the paper: communication" in rig_file.read_text()
    assert "2025-12-24" not in rig_file.read_text()
    assert after.thrust.sufferer.thrust_n == pytest.approx(thrust_n, rel=1e-5)
    assert after.thrust.source == default_rig().thrust.source
    assert after.spool.source.down_s == default_rig().spool.source.down_s
    assert (after.range_sensor.bias_m, after.range_sensor.scale) == (0.031, 1.01)
    assert after.calibration["range_sensor.scale"].unit is None


def test_a_constant_whose_whole_name_is_a_unit_has_that_unit():
    assert unit_of("steps_per_m") == "steps/m"
    assert unit_of("range_m") == "m"
    assert unit_of("scale") == "1"
    assert unit_of("has_divider") is None


def test_what_stands_in_other_units_stays_so_beside_what_is_calibrated(rig_file):
    text = rig_file.read_text()
    text = text.replace("mass_kg = 0.45\n", 'mass_kg = { value = 450, unit = "g" }\n')
    text = text.replace("[range_sensor]\n", '[range_sensor]\nbias_m = { value = 3, unit = "mm" }\n')
    rig_file.write_text(text)
    before = read_rig(rig_file)
    assert (before.sufferer.mass_kg, before.range_sensor.bias_m) == (0.45, 0.003)
    bias = {"range_sensor.bias_m": Calibrated(0.0042, 0.0002, "m")}
    after, kept = update_rig(rig_file, bias, DATE)
    assert kept
    assert 'mass_kg = { value = 450, unit = "g" }' in rig_file.read_text()
    assert 'bias_m = { value = 0.0042, spread = 0.0002, unit = "m"' in rig_file.read_text()
    again = read_rig(rig_file)
    assert again == after
    assert (again.sufferer.mass_kg, again.range_sensor.bias_m) == (0.45, 0.0042)


SIZES = "parameters.gain = { value = 0.1, unit = '1' }\n"
SIZES += "parameters.height_m = { value = 0.1, unit = 'm' }\n"


def test_a_section_that_is_missing_is_added_and_a_list_over_lines_is_replaced(tmp_path):
    text = default_rig().without("spool").text
    path = tmp_path / "rig.toml"
    path.write_text(text + "\n[[effect]]\nname = 'ground-effect'\n# the end\n" + SIZES)
    several = {
        "thrust.sufferer.thrust_n": Calibrated(default_rig().thrust.sufferer.thrust_n, 0.03, "N"),
        "spool.sufferer.up_s": Calibrated(0.05, 0.004, "s"),
    }
    after, kept = update_rig(path, several, DATE)
    assert kept
    assert "# the end" in path.read_text()
    assert read_rig(path) == after
    assert after.spool.sufferer.up_s == 0.05
    assert after.effect[0].name == "ground-effect"


def test_a_list_over_very_many_lines_is_replaced_in_time(rig_file):
    """The time must not grow with their square."""
    text = rig_file.read_text()
    rig_file.write_text(text.replace("thrust_n = [0.0, ", "thrust_n = [" + 40_000 * "\n" + "0.0, "))
    thrust = default_rig().thrust.sufferer.thrust_n
    began_s = time.process_time()
    after, kept = update_rig(
        rig_file, {"thrust.sufferer.thrust_n": Calibrated(thrust, 0.03, "N")}, DATE
    )
    assert time.process_time() - began_s < 5.0
    assert not kept
    assert read_rig(rig_file) == after


def test_an_unusual_file_is_written_anew_and_that_is_told(tmp_path):
    text = default_rig_text()
    at, end = text.index("[latency]"), text.index("[limits]")
    path = tmp_path / "rig.toml"
    path.write_text(
        text[:at].replace("schema = 1", "schema = 1\nlatency.round_trip_s = 0.018", 1) + text[end:]
    )
    before = read_rig(path)
    after, kept = update_rig(path, TRIP, DATE)
    assert not kept
    assert before.latency.round_trip_s == 0.018
    assert read_rig(path) == after
    assert after.latency.round_trip_s == 0.0212346


def test_a_value_out_of_bounds_leaves_the_file_as_it_was(rig_file):
    with pytest.raises(UnusableInput, match="bias_m"):
        update_rig(rig_file, TRIP | {"range_sensor.bias_m": Calibrated(0.5, 0.001, "m")}, DATE)
    assert rig_file.read_text() == default_rig_text()


def test_a_rig_without_bias_and_scale_keeps_its_hash_and_one_with_them_has_another():
    rig = default_rig()
    assert "bias_m" not in rig.text
    assert "scale" not in rig.text
    biased = rig.changed(range_sensor={"bias_m": 0.01})
    assert biased.sha256 != rig.sha256
    assert parse_rig(biased.text) == biased
    dated = rig.changed(range_sensor={"scale": {"value": 1.0, "spread": 0.001, "date": DATE}})
    assert parse_rig(dated.text).calibration["range_sensor.scale"].date == DATE


def test_a_rig_without_a_divider_keeps_its_hash_and_one_with_it_has_another():
    rig = default_rig()
    assert "battery" not in rig.text
    measured = rig.changed(battery={"has_divider": True})
    assert parse_rig(measured.text) == measured != rig
    assert measured.changed(battery={"has_divider": False}).sha256 == rig.sha256


def test_another_file_to_write_begins_as_the_first_and_keeps_what_it_was_given(rig_file) -> None:
    text, desk = rig_file.read_text(), rig_file.with_name("desk.toml")
    bias = {"range_sensor.bias_m": Calibrated(0.02, 0.001, "m")}
    update_rig(rig_file, bias, DATE, desk)
    after, kept = update_rig(rig_file, TRIP, DATE, desk)
    assert kept
    assert rig_file.read_text() == text
    assert read_rig(desk) == after
    assert {*bias, *TRIP} <= set(after.calibration)


def test_of_two_calibrations_that_end_at_once_neither_loses_its_value(rig_file, monkeypatch):
    bias = {"range_sensor.bias_m": Calibrated(0.031, 0.0002, "m")}
    other = threading.Thread(target=update_rig, args=(rig_file, bias, DATE))
    change = update.updated

    def change_late(*given):
        monkeypatch.setattr(update, "updated", change)
        other.start()
        other.join(0.5)  # one that does not wait for its turn is done by then
        return change(*given)

    monkeypatch.setattr(update, "updated", change_late)
    update_rig(rig_file, TRIP, DATE)
    other.join(60)
    assert {"latency.round_trip_s", "range_sensor.bias_m"} <= set(read_rig(rig_file).calibration)
    assert [*rig_file.parent.iterdir()] == [rig_file]


def test_a_name_that_is_another_stands_beside_the_one_that_is_missing() -> None:
    text = default_rig_text().replace("mass_kg = 0.45", "mass_g = 450")
    with pytest.raises(UnusableInput, match="mass_kg is missing, and mass_g is not known"):
        parse_rig(text, "rig.toml")


@pytest.mark.parametrize(
    ("added", "sentence"),
    [
        ('\n[[effect]]\nname = "ground-effect"\ngain = 0.3\n',
         "effect.0.gain is not known; there are name, expression, parameters, "),
        ("\n[batery]\n", "batery is not known; there are schema, source, sufferer, "),
        ("\n[thrust.carriage]\npulse_us = [1000, 2000]\n",
         "thrust.carriage is not known; there are source, sufferer."),
    ],
)  # fmt: skip
def test_a_name_that_is_not_known_is_answered_with_those_that_are(added, sentence) -> None:
    with pytest.raises(UnusableInput, match=re.escape(sentence)):
        parse_rig(default_rig_text() + added, "rig.toml")
