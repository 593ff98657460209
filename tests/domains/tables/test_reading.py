"""Logs with gaps, doubles, blanks and clocks of their own: handled and said, or refused by name."""

import json
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.domains.tables.columns import parse_columns, read_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.guess_asked import Asked
from wakedeploy.domains.tables.reading import Reading, read_recordings

BASE = 'version = 1\n[time]\ncolumn = "t"\n'
U = '[columns.u]\ncolumn = "u"\nrole = "input"\nunit = "V"\n'


def write(path: Path, stamps: list[object], values: list[object]) -> Path:
    rows = [f"{t},{u}" for t, u in zip(stamps, values, strict=True)]
    path.write_text("\n".join(["t,u", *rows]) + "\n", "utf-8")
    return path


def reading(path: Path | list[Path], text: str, **units: str) -> Reading:
    return read_recordings(path if isinstance(path, list) else [path], parse_columns(text), units)


def one(path: Path, text: str, **units: str) -> Recording:
    (only,) = reading(path, text, **units).recordings
    return only


def tenths(count: int) -> list[object]:
    return [k / 10 for k in range(count)]


@pytest.mark.parametrize(
    ("unit", "more", "wanted", "value"),
    [
        ("mV", "", None, 1.5e-3), ("mV", "", "V", 1.5e-3), ("V", "", "mV", 1500.0),
        ("deg", "", None, np.deg2rad(1.5)), ("rpm", "", "rad/s", 1.5 * np.pi / 30),
        ("gf", "", "N", 1.5 * 9.80665e-3), ("m/s^2", "scale = 9.80665", None, 1.5 * 9.80665),
        ("K", "offset = 273.15", None, 274.65), ("V", 'to = "mV"', None, 1500.0),
        ("mA", "scale = 2\noffset = -1", "A", 2e-3), ("g", "", "kg", 0.0015),
    ],
)  # fmt: skip
def test_numbers_come_in_the_unit_that_is_wanted(
    unit: str, more: str, wanted: str | None, value: float, tmp_path: Path
) -> None:
    path = write(tmp_path / "log.csv", tenths(3), [1.5] * 3)
    text = BASE + U.replace('"V"', f'"{unit}"') + more
    read = one(path, text, **({"u": wanted} if wanted else {}))
    np.testing.assert_allclose(read.columns["u"], value, rtol=1e-15)


@pytest.mark.parametrize(
    ("unit", "wanted", "sentence"),
    [
        ("V", "N", "columns.u.unit: 'V' is of another dimension; give N"),
        ("furlong", None, "columns.u.unit: 'furlong' is not known; give one such as m"),
        ("rpm", "Hz", "'rpm' counts angle and 'Hz' does not"),
        ("degC", None, "'degC' is not known"),
    ],
)
def test_a_unit_of_another_dimension_is_refused(
    unit: str, wanted: str | None, sentence: str, tmp_path: Path
) -> None:
    path = write(tmp_path / "log.csv", tenths(3), [1.5] * 3)
    with pytest.raises(UnusableInput) as told:
        one(path, BASE + U.replace('"V"', f'"{unit}"'), **({"u": wanted} if wanted else {}))
    assert sentence in str(told.value)


@pytest.mark.parametrize(
    ("role", "is_measured"),
    [
        ("output", False),
        ('["output"]', False),
        ('["output", "observation"]', True),
    ],
)
def test_what_a_silent_sensor_said_last_is_not_measured_again(
    role: str, is_measured: bool, tmp_path: Path
) -> None:
    stamps = [k / 100 for k in range(400) if not 200 < k < 250]
    path = write(tmp_path / "log.csv", stamps, stamps)
    text = BASE + U.replace('"input"', role if role[0] == "[" else f'"{role}"')
    read = reading(path, text + "[resample]\nrate_hz = 100\n")
    (recording,) = read.recordings
    silent = recording.columns["u"][205:248]
    assert np.isfinite(silent).all() if is_measured else np.isnan(silent).all()
    assert np.isfinite(recording.columns["u"][:201]).all()
    (note,) = read.notes
    assert "silent for 0.5 s" in note
    assert ("not measured" in note) != is_measured


def test_an_input_that_changed_while_nobody_looked_ends_a_recording(tmp_path: Path) -> None:
    """Half a second of a motor's voltage is not known; where it is the same afterwards, it is."""
    stamps = [k / 100 for k in range(400) if not 200 < k < 250]
    path = write(tmp_path / "log.csv", stamps, stamps)
    text = BASE + "[resample]\nrate_hz = 100\n" + U
    with pytest.raises(UnusableInput, match=r"silent for 0\.5 s .* gap_s = 0\.1, or event = true"):
        one(path, text)
    assert len(reading(path, text + "[split]\ngap_s = 0.1\n").recordings) == 2
    path = write(tmp_path / "log.csv", stamps, [float(t > 3.0) for t in stamps])
    read = reading(path, text)
    assert np.isfinite(read.recordings[0].columns["u"]).all()
    assert "the last sample is held" in read.notes[0]


def test_a_gap_and_a_missing_number_are_refused_with_what_helps(tmp_path: Path) -> None:
    stamps = [k / 100 for k in range(400) if not 200 < k < 250]
    path = write(tmp_path / "log.csv", stamps, stamps)
    with pytest.raises(UnusableInput, match=r"\[split\] gap_s = 0.1; \[resample\]"):
        one(path, BASE + U)
    with pytest.raises(UnusableInput, match=r"gap_s = 0.1 \(the one given, 1, is longer\)"):
        one(path, BASE + "[split]\ngap_s = 1.0\n" + U)
    assert len(reading(path, BASE + "[split]\ngap_s = 0.1\n" + U).recordings) == 2
    path = write(tmp_path / "log.csv", tenths(9), [1.5] * 8 + [""])
    with pytest.raises(UnusableInput, match='missing = "nan", which ignores it'):
        one(path, BASE + U.replace("input", "output"))
    with pytest.raises(UnusableInput, match='missing = "split", or "hold"'):
        one(path, BASE + U)


def test_the_gap_that_is_advised_covers_all_holes_of_a_log(tmp_path: Path) -> None:
    lost = [*range(100, 150), 200, 201, *range(300, 310)]
    stamps = [k / 100 for k in range(400) if k not in lost]
    path = write(tmp_path / "log.csv", stamps, stamps)
    with pytest.raises(UnusableInput, match=r"steps by 0\.51 s .* \[split\] gap_s = 0\.02;"):
        one(path, BASE + U)
    assert len(reading(path, BASE + "[split]\ngap_s = 0.02\n" + U).recordings) == 4


@pytest.mark.parametrize("header", ["Tiefe [cm]", "Tiefe (cm)"])
def test_a_unit_that_the_header_contradicts_is_said(header: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"t,{header}\n" + "\n".join(f"{k / 10},{k}" for k in range(20)) + "\n")
    text = BASE + U.replace('column = "u"', f'column = "{header}"')
    for unit in ("m", "1", "V"):
        said = reading(path, text.replace('"V"', f'"{unit}"')).notes[0]
        assert said.endswith(f"read as {unit}, and the log says cm; check `unit`")
    assert not reading(path, text.replace('"V"', '"cm"')).notes
    assert not reading(path, text.replace('"V"', '"m"') + "scale = 0.01\n").notes


@pytest.mark.parametrize("ending", ["parquet", "npz", "h5"])
def test_a_unit_in_a_name_counts_in_every_format(ending: str, tmp_path: Path) -> None:
    """A depth in cm was taken for metres, and `--guess` said that the log does not say."""
    path = tmp_path / f"log.{ending}"
    columns = {"t": np.arange(20) / 10, "Tiefe [cm]": np.arange(20.0)}
    if ending == "parquet":
        pq = pytest.importorskip("pyarrow.parquet")
        pq.write_table(pytest.importorskip("pyarrow").table(columns), path)
    elif ending == "h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            file.update(columns)
    else:
        np.savez(path, **columns)
    asked = [Asked("tiefe_m", "output", "m")]
    assert 'unit = "cm"' in guess_columns(path, asked)
    text = BASE + U.replace('column = "u"', 'column = "Tiefe [cm]"')
    said = reading(path, text.replace('"V"', '"m"')).notes[0]
    assert said.endswith("read as m, and the log says cm; check `unit`")


@pytest.mark.parametrize("header", ["temp_degC", "Temperatur [°C]", "celsius"])
def test_degrees_celsius_need_an_offset(header: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"t,{header}\n" + "\n".join(f"{k / 10},{k}" for k in range(20)) + "\n")
    text = BASE + U.replace('column = "u"', f'column = "{header}"').replace('"V"', '"K"')
    said = "read as K, and the log says °C; offset = 273.15 is missing"
    assert one_note(path, text).endswith(said)
    assert not reading(path, text + "offset = 273.15\n").notes
    with pytest.raises(UnusableInput, match=r'give unit = "K" and offset = 273\.15'):
        reading(path, text.replace('"K"', '"degC"'))


@pytest.mark.parametrize("address", ["arm/q", "/arm/q"])
def test_a_dataset_that_states_another_unit_is_doubted_by_either_address(
    address: str, tmp_path: Path
) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["t"] = np.arange(20) / 10
        file["arm/q"] = np.arange(20.0)
        file["arm/q"].attrs["unit"] = "deg"
    text = BASE + U.replace('column = "u"', f'column = "{address}"').replace('"V"', '"rad"')
    said = f"column {address!r}: read as rad, and the log says deg; check `unit`"
    assert one_note(path, text).endswith(said)


@pytest.mark.parametrize("mark", [-999.0, 65535.0, 2147483647.0, -999.9])
def test_a_number_that_stands_for_no_reading(mark: float, tmp_path: Path) -> None:
    values = 20.0 + np.sin(np.arange(200) / 9.0)
    values[[17, 60, 61, 150]] = mark
    path = write(tmp_path / "log.csv", list(np.arange(200) / 100), list(values))
    (note,) = reading(path, BASE + U).notes
    assert f"4 of 200 numbers are {mark:.10g}, and all others 19 to 21" in note
    advised = note.rpartition("say ")[2]
    marked = BASE + U + advised + "\n"
    wrong = one_note(path, BASE + U + "absent = [-1]\n")
    assert wrong.endswith("absent = -1 stands nowhere in it")
    with pytest.raises(UnusableInput, match="has no number in line 19"):
        reading(path, marked)
    held = reading(path, marked + 'missing = "hold"\n')
    assert all("absent" not in note for note in held.notes)
    assert held.recordings[0].columns["u"].max() < 22.0


def test_a_single_number_far_from_all_others_is_said_and_may_be_left_out(tmp_path: Path) -> None:
    """A glitch of a bus; a motion that has a tail or a step is none."""
    rng = np.random.default_rng(0)
    values = rng.normal(size=400)
    values[[120, 300]] = 9e7, -40.0
    path = write(tmp_path / "log.csv", list(np.arange(400) / 100), list(values))
    note = one_note(path, BASE + U)
    assert "2 numbers, such as 90000000 in line 122, far from all others" in note
    marked = BASE + U + note.rpartition("say ")[2] + '\nmissing = "hold"\n'
    (recording,) = reading(path, marked).recordings
    assert np.abs(recording.columns["u"]).max() < 5.0
    values[[120, 300]], values[::50] = 0.0, 1e3 * np.arange(1.0, 9.0)
    glitches = write(tmp_path / "many.csv", list(np.arange(400) / 100), list(values))
    assert not reading(glitches, BASE + U).notes  # too many to be single
    values[:] = np.repeat([1.6e308, 1.7e308], 200)
    path = write(tmp_path / "absurd.csv", list(np.arange(400) / 100), list(values))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(UnusableInput, match="is too large for a measurement"):
            reading(path, BASE + U)
    for motion in (rng.standard_t(3, 400), np.sin(np.arange(400) / 9) + 9 * (np.arange(400) > 390)):
        path = write(tmp_path / "log.csv", list(np.arange(400) / 100), list(motion))
        assert not reading(path, BASE + U).notes


def one_note(path: Path, text: str) -> str:
    (note,) = reading(path, text).notes
    return note


def test_a_mark_in_single_precision_is_the_same(tmp_path: Path) -> None:
    values = np.sin(np.arange(200) / 9.0).astype(np.float32)
    values[[17, 60]] = -999.9
    np.savez(tmp_path / "log.npz", t=np.arange(200) / 100, u=values)
    text = BASE + U + 'missing = "hold"\nabsent = [-999.9]\n'
    assert np.abs(one(tmp_path / "log.npz", text).columns["u"]).max() < 2.0


@pytest.mark.parametrize("values", [[0.0, 1.0] * 50, [0.0] * 98 + [5.0, 5.0], [3.0] * 100])
def test_a_command_of_few_levels_has_no_mark(values: list[float], tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", list(np.arange(100) / 100), values)
    assert not any("absent" in note for note in reading(path, BASE + U).notes)


def test_times_of_day_go_on_behind_midnight(tmp_path: Path) -> None:
    stamps = [f"23:59:59.{k}" for k in range(5, 10)] + [f"00:00:00.{k}" for k in range(10)]
    path = write(tmp_path / "log.csv", list(stamps), list(range(15)))
    text = BASE + 'format = "%H:%M:%S.%f"\n' + U
    assert np.ptp(one(path, text).time_s) == pytest.approx(1.4)
    late = [*stamps[:4], "00:00:00.0", "23:59:59.9", *stamps[6:]]
    path = write(tmp_path / "late.csv", list(late), list(range(len(late))))
    in_order = text.replace("[columns", 'falling = "sort"\n[columns')
    assert np.ptp(one(path, in_order).time_s) == pytest.approx(1.4)
    back = write(tmp_path / "back.csv", ["10:00:01.0", "10:00:02.0", "10:00:00.0"], [1, 2, 3])
    with pytest.raises(UnusableInput, match="falls by 2 s"):
        reading(back, text)


def of_day(seconds: float) -> str:
    """Seconds since midnight as a time of day, the same on the next day."""
    tenths = round(10.0 * seconds) % 864_000
    return f"{tenths // 36_000:02}:{tenths // 600 % 60:02}:{tenths // 10 % 60:02}.{tenths % 10}"


@pytest.mark.parametrize("first", ["u", "x"])
def test_a_part_of_a_recording_that_begins_behind_midnight_is_of_the_next_day(
    first: str, tmp_path: Path
) -> None:
    """One file begins two seconds before midnight, the other one second behind it."""
    folder = tmp_path / "run"
    folder.mkdir()
    before, behind = 86_398.0 + np.arange(80) / 10, 86_401.0 + np.arange(80) / 10
    write(folder / "u.csv", list(map(of_day, before)), list(before))
    write(folder / "x.csv", list(map(of_day, behind)), list(behind))
    form = BASE + 'format = "%H:%M:%S.%f"\n[resample]\nrate_hz = 10\n'
    parts = {"u": U + 'file = "u.csv"\n', "x": U.replace(".u]", ".x]") + 'file = "x.csv"\n'}
    read = reading(folder, form + parts.pop(first) + "".join(parts.values()))
    (recording,) = read.recordings
    np.testing.assert_allclose(recording.columns["x"], recording.columns["u"])
    assert recording.columns["u"][0] == pytest.approx(86_401.0)
    assert [note for note in read.notes if "x.csv: its times of day begin after midnight" in note]


def test_a_form_of_stamps_that_are_not_there_is_not_asked_for(tmp_path: Path) -> None:
    """Rows at a rate have no clock that could pass midnight."""
    path = tmp_path / "log.csv"
    path.write_text("u\n" + "\n".join(map(str, range(20))) + "\n")
    text = BASE.replace('column = "t"\n', "rate_hz = 10\n") + 'format = "%H:%M:%S.%f"\n' + U
    (recording,) = reading(path, text).recordings
    assert recording.time_s[-1] == pytest.approx(1.9)


def test_a_part_that_was_recorded_on_its_own_stays_where_it_is(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    for name, begin_s in (("u", 36_000.0), ("x", 80_000.0)):
        stamps_s = begin_s + np.arange(80) / 10
        write(folder / f"{name}.csv", list(map(of_day, stamps_s)), list(stamps_s))
    text = BASE + 'format = "%H:%M:%S.%f"\n[resample]\nrate_hz = 10\n' + U + 'file = "u.csv"\n'
    with pytest.raises(UnusableInput, match="shift_s = -44000"):
        reading(folder, text + U.replace(".u]", ".x]") + 'file = "x.csv"\n')


def test_a_remark_in_a_header_is_no_unit(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,x (filtered)\n" + "\n".join(f"{k / 10},{k}" for k in range(20)) + "\n")
    assert not reading(path, BASE + U.replace('column = "u"', 'column = "x (filtered)"')).notes


def test_a_unit_that_the_column_s_name_contradicts_is_said(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,encoder_mm\n" + "\n".join(f"{k / 10},{k}" for k in range(20)) + "\n")
    text = BASE + U.replace('column = "u"', 'column = "encoder_mm"')
    said = reading(path, text.replace('"V"', '"m"')).notes[0]
    assert said.endswith("read as m, and its name says mm; check `unit`")
    assert not reading(path, text.replace('"V"', '"mm"')).notes
    assert not reading(path, text).notes  # of another dimension: the name is no unit
    called = BASE + U.replace("columns.u", "columns.rel_vx_mps").replace('"V"', '"T"')
    called = called.replace('column = "u"', 'column = "encoder"')
    scaled = text.replace('"V"', '"m"') + "scale = 0.001\n"
    assert not reading(path, scaled).notes  # a factor of one's own
    path.write_text(path.read_text().replace("encoder_mm", "encoder"))
    assert "read as T, and its name says m/s" in reading(path, called).notes[0]
    plain = called.replace("rel_vx_mps", "rel_vx_s")
    assert not reading(path, plain).notes  # of another dimension such an end is no unit


def test_one_lost_sample_splits_a_log_in_two_as_advised(tmp_path: Path) -> None:
    """Stamps in whole milliseconds; whichever sample is lost, the advice makes two recordings."""
    for lost in range(100, 120):
        stamps = [round(k / 100, 3) for k in range(400) if k != lost]
        path = write(tmp_path / "log.csv", stamps, stamps)
        with pytest.raises(UnusableInput) as told:
            one(path, BASE + U)
        (gap_s,) = re.findall(r"\[split\] gap_s = ([\d.]+)", str(told.value))
        assert len(reading(path, BASE + f"[split]\ngap_s = {gap_s}\n" + U).recordings) == 2


def test_a_sensor_that_sends_in_bursts_is_not_silent(tmp_path: Path) -> None:
    stamps = [0.32 * burst + 0.0005 * k for burst in range(20) for k in range(32)]
    path = write(tmp_path / "log.csv", stamps, stamps)
    text = BASE + U.replace('"input"', '"output"') + "[resample]\nrate_hz = 100\n"
    read = one(path, text)
    arrived = {int(np.ceil(stamp * 100 - 1e-9)) for stamp in stamps}
    measured = np.flatnonzero(np.isfinite(read.columns["u"]))
    assert set(measured) == {tick for tick in arrived if tick < len(read.time_s)}


@pytest.mark.parametrize(
    ("name", "to", "is_refused"),
    [("u_v", "mV", True), ("u_v", "V", False), ("u_mv", "mV", False), ("u", "mV", False)],
)
def test_a_name_does_not_say_another_unit_than_its_numbers_have(
    name: str, to: str, is_refused: bool, tmp_path: Path
) -> None:
    text = BASE + U.replace("columns.u", f"columns.{name}")
    path = write(tmp_path / "log.csv", tenths(3), [1.5] * 3)
    if is_refused:
        with pytest.raises(UnusableInput, match="becomes mV, but its name says V; delete the line"):
            one(path, text + f'to = "{to}"\n')
    else:
        number = one(path, text + f'to = "{to}"\n').columns[name][0]
        assert number == (1500.0 if to == "mV" else 1.5)
    if name == "u_mv":  # without `to` it would be volts; where a system asks, its unit counts
        with pytest.raises(UnusableInput, match='its name says mV; give to = "mV", or rename it'):
            one(path, text)
        assert one(path, text, u_mv="mV").columns[name][0] == 1500.0


@pytest.mark.parametrize(
    ("stamps", "values", "more", "sentence"),
    [
        ([0, 0.1, "", 0.3], [1, 2, 3, 4], "", "column 't' has no stamp in line 4"),
        ([0, 0.2, 0.1, 0.3], [1, 2, 3, 4], "", "column 't' falls by 0.1 s at line 4"),
        ([0, 0.1, 0.1, 0.2], [1, 2, 3, 4], 'repeated = "refuse"', "'t' repeats a stamp at line 4"),
        ([0, 0.1, 0.2, 0.5], [1, 2, 3, 4], "", "steps by 0.3 s at line 5, where 0.1 s is usual"),
        (tenths(4), [1, "", 3, 4], "", "column 'u' has no number in line 3"),
        (tenths(4), [1, "nan", 3, 4], "", "column 'u' has no number in line 3"),
        (tenths(4), [1, "inf", 3, 4], "", "'u' is too large for a measurement in line 3"),
        (tenths(4), [1, "1_0", 3, 4], "", "column 'u' holds '1_0' in line 3, which is no number"),
        (tenths(4), [1, "off", 3, 4], "", "column 'u' holds 'off' in line 3, which is no number"),
        (tenths(4), [1, "2,9", 3, 4], "", "line 3: has 3 fields, but the header 2"),
        (["2024-01-01 00:00:00", "x"], [1, 2], "", "'t' holds texts, '2024-01-01 00:00:00' the"),
        (["2024-01-01", "x"], [1, 2], 'format = "iso"', "'t' holds 'x' in line 3, which is not"),
        (tenths(4), [1, 2, 3, 4], 'unit = "V"', "'t' has no unit of time: 'V' is of another"),
        ([0], [1], "", "column 'u' has fewer than two samples"),
        ([], [], "", "has no row below its header"),
        (
            [0, 0.1, 0.2, 5.0], [1, 2, 3, 4], "\n[resample]\nrate_hz = 10",
            "column 'u' is silent for 4.8 s from 0.2 s on",
        ),
    ],
)  # fmt: skip
def test_what_is_no_log_is_refused_by_file_column_row_and_reason(
    stamps: list[object], values: list[object], more: str, sentence: str, tmp_path: Path
) -> None:
    path = write(tmp_path / "log.csv", stamps, values)
    with pytest.raises(UnusableInput) as told:
        one(path, BASE + more + "\n" + U)
    assert sentence in str(told.value)
    assert str(told.value).startswith(str(path))


@pytest.mark.parametrize(
    ("repeated", "kept"), [("last", [1.0, 3.0, 4.0, 5.0]), ("first", [1.0, 2.0, 4.0, 5.0])]
)
def test_of_doubled_stamps_one_is_kept_and_it_is_said(
    repeated: str, kept: list[float], tmp_path: Path
) -> None:
    path = write(tmp_path / "log.csv", [0, 0.1, 0.1, 0.2, 0.3], [1, 2, 3, 4, 5])
    read = reading(path, BASE + f'repeated = "{repeated}"\n' + U)
    assert read.recordings[0].columns["u"].tolist() == kept
    assert read.notes == (
        f"{path}, column 't': 1 stamp was there twice; the {repeated} row of each was kept",
    )


def test_a_table_of_several_robots_is_told_what_was_kept(tmp_path: Path) -> None:
    times = np.repeat(0.1 * np.arange(20), 3).round(1)
    path = write(tmp_path / "log.csv", times.tolist(), list(range(60)))
    read = reading(path, BASE + U)
    assert read.recordings[0].columns["u"].tolist() == list(range(2, 60, 3))
    assert read.notes == (
        f"{path}, column 't': 20 stamps were there up to 3 times; the last row of each was kept. "
        "Where these are several robots or runs in one table, make a log of each",
    )


ONE_TABLE = BASE + U + 'missing = "hold"\n[columns.q]\ncolumn = "q"\nrole = "output"\n'
ONE_TABLE += 'unit = "rad"\nmissing = "hold"\n'


def two_streams(folder: Path) -> tuple[Any, Any, Path]:
    """Commands at 20 Hz and states at 50 Hz as one table, a row for each message."""
    pandas = pytest.importorskip("pandas")
    commands = pandas.DataFrame({"t": np.arange(200) / 20, "u": np.sin(np.arange(200))})
    states = pandas.DataFrame({"t": np.arange(500) / 50, "q": np.cos(0.1 * np.arange(500))})
    path = folder / "log.csv"
    pandas.concat([commands, states]).sort_values("t", kind="stable").to_csv(path, index=False)
    return commands, states, path


def test_rows_of_one_stamp_that_fill_different_columns_are_one(tmp_path: Path) -> None:
    """Against pandas: each tick has the newest command, and every state is there."""
    commands, states, path = two_streams(tmp_path)
    read = reading(path, ONE_TABLE + "[resample]\nrate_hz = 50\n")
    (recording,) = read.recordings
    assert recording.columns["q"].tolist() == states["q"][: len(recording.time_s)].tolist()
    ticks = states["t"][: len(recording.time_s)] + 1e-9
    of_ticks = np.searchsorted(commands["t"], ticks, side="right") - 1
    assert recording.columns["u"].tolist() == commands["u"][of_ticks].tolist()
    assert read.notes[0] == (
        f"{path}, column 't': 100 stamps have rows that fill different columns; they were merged"
    )
    assert not any("twice" in note for note in read.notes)


@pytest.mark.parametrize(("repeated", "kept"), [("last", 3.0), ("first", 2.0)])
def test_of_merged_rows_those_of_one_column_still_contradict(
    repeated: str, kept: float, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,u,q\n0,1,5\n0.1,2,\n0.1,,6\n0.1,3,\n0.2,4,7\n", "utf-8")
    text = ONE_TABLE.replace(BASE, f'{BASE}repeated = "{repeated}"\n')
    read = reading(path, text)
    assert read.recordings[0].columns["u"].tolist() == [1.0, kept, 4.0]
    assert read.recordings[0].columns["q"].tolist() == [5.0, 6.0, 7.0]
    assert [note.partition(": ")[2] for note in read.notes] == [
        "1 stamps have rows that fill different columns; they were merged",
        f"1 stamp was there twice; the {repeated} row of each was kept",
    ]
    with pytest.raises(UnusableInput, match="'t' repeats a stamp at line 5"):
        reading(path, text.replace(repeated, "refuse"))
    path.write_text("t,u,q\n0,1,5\n0.1,2,\n0.1,,6\n0.2,4,7\n", "utf-8")
    assert len(one(path, text.replace(repeated, "refuse")).time_s) == 3


@pytest.mark.parametrize("how", ["npz", "hold", "nan"])
@pytest.mark.parametrize("method", ["hold", "low-pass"])
def test_an_output_is_measured_where_a_number_came_and_an_input_is_held(
    how: str, method: str, tmp_path: Path
) -> None:
    """A sensor at 20 Hz, ticks at 100 Hz: one tick in five is a measurement."""
    t, slow_t = np.arange(500) / 100, np.arange(100) / 20
    u, q = np.sin(t), np.cos(3 * slow_t)
    if how == "npz":
        path = tmp_path / "log.npz"
        np.savez(path, t=t, u=u, q=q, slow_t=slow_t)
        more = 'time = "slow_t"\n'
    else:
        path, more = tmp_path / "log.csv", f'missing = "{how}"\n'
        cells = [repr(float(q[k // 5])) if k % 5 == 0 else "" for k in range(500)]
        rows = [f"{a!r},{b!r},{c}" for a, b, c in zip(t.tolist(), u.tolist(), cells, strict=True)]
        path.write_text("\n".join(["t,u,q", *rows]) + "\n", "utf-8")
    text = BASE + U + f'[columns.q]\ncolumn = "q"\nrole = "output"\nunit = "1"\n{more}'
    text += f'[resample]\nrate_hz = 100\nmethod = "{method}"\n'
    if (how, method) == ("nan", "low-pass"):
        with pytest.raises(UnusableInput, match='"split", or "hold" where other columns have rows'):
            reading(path, text)
        return
    read = reading(path, text)
    (recording,) = read.recordings
    measured = np.isfinite(recording.columns["q"])
    assert np.array_equal(measured, np.arange(len(measured)) % 5 == 0)
    assert np.isfinite(recording.columns["u"]).all()
    if method == "hold":
        assert np.array_equal(recording.columns["q"][measured], q[: measured.sum()])
    of = f"{int(measured.sum())} of {len(measured)} ticks have a new sample; the others are not"
    assert sum(of in note for note in read.notes) == 1
    held = reading(path, text.replace('"output"', '["output", "observation"]'))
    if how != "nan":
        assert np.isfinite(held.recordings[0].columns["q"]).all()
        assert any("counts as measured at the others" in note for note in held.notes)
    assert not any("at the others" in n for n in reading(path, text + "[split]\n").notes)


def test_an_output_that_is_written_when_it_changes_shows_at_every_tick(tmp_path: Path) -> None:
    np.savez(
        tmp_path / "log.npz", t=np.arange(100) / 100, u=np.arange(100.0),
        slow_t=[0.0, 0.5], q=[1.0, 2.0],
    )  # fmt: skip
    text = BASE + "[resample]\nrate_hz = 100\n" + U
    text += '[columns.q]\ncolumn = "q"\nrole = "output"\nunit = "1"\ntime = "slow_t"\n'
    read = one(tmp_path / "log.npz", text + "event = true\n")
    assert read.columns["q"].tolist() == [1.0] * 50 + [2.0] * 50


def test_an_output_without_a_rate_is_measured_in_its_own_rows(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", tenths(6), [1, "", 2, "", 3, ""])
    read = reading(path, BASE + U.replace("input", "output") + 'missing = "hold"\n')
    np.testing.assert_array_equal(
        read.recordings[0].columns["u"], [1, np.nan, 2, np.nan, 3, np.nan]
    )
    assert "3 of 6 samples have a number; the others are not measured" in read.notes[0]


def test_a_log_in_pieces_is_told_of_once(tmp_path: Path) -> None:
    t = np.concatenate([k * 100 + np.arange(1000) / 100 for k in range(3)])
    slow_t = np.delete(t[::10], np.s_[20:35])
    np.savez(tmp_path / "log.npz", t=t, u=np.sin(t), slow_t=slow_t, battery=slow_t)
    text = BASE + "[resample]\nrate_hz = 100\n[split]\ngap_s = 3.0\n" + U
    text += '[columns.battery]\ncolumn = "battery"\nrole = "input"\nunit = "V"\n'
    read = reading(tmp_path / "log.npz", text + 'time = "slow_t"\n')
    assert len(read.recordings) == 3
    assert [note.partition(": ")[2] for note in read.notes] == [
        "silent for 1.6 s and less; the last sample is held"
    ]


def test_falling_stamps_are_sorted_or_begin_another_recording(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", [0, 0.2, 0.1, 0.3], [1, 3, 2, 4])
    assert one(path, BASE + 'falling = "sort"\n' + U).columns["u"].tolist() == [1, 2, 3, 4]
    path = write(tmp_path / "two.csv", [*tenths(3), *tenths(4)], [1, 2, 3, 4, 5, 6, 7])
    read = reading(path, BASE + 'falling = "split"\n' + U).recordings
    assert [(r.name, r.columns["u"].tolist()) for r in read] == [
        ("two", [1, 2, 3]), ("two-2", [4, 5, 6, 7]),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("stamps", "is_blank", "is_mixed"),
    [
        ([*range(5, 305), *range(2, 302)], False, True),  # a board that was started again
        ([*range(300), *range(300)], True, False),  # two streams, one below the other
        ([*range(100), 98, 97, *range(101, 300)], False, False),  # messages that swap places
    ],
)
def test_runs_that_are_sorted_into_each_other_are_told(
    stamps: list[int], is_blank: bool, is_mixed: bool, tmp_path: Path
) -> None:
    path, half = tmp_path / "log.csv", len(stamps) // 2
    rows = [
        f"{t / 100 + 1e-3 * (k >= half):.3f},{'' if is_blank and k >= half else k},"
        f"{'' if is_blank and k < half else k}"
        for k, t in enumerate(stamps)
    ]
    path.write_text("\n".join(["t,u,v", *rows]) + "\n")
    more = 'missing = "hold"\n' if is_blank else ""
    text = BASE + 'falling = "sort"\n[resample]\nrate_hz = 100\n' + U + more
    text += U.replace("[columns.u]", "[columns.v]").replace('"u"', '"v"') + more
    assert any("rows of two times are mixed" in n for n in reading(path, text).notes) == is_mixed


def test_gaps_end_recordings_and_short_pieces_are_left_out(tmp_path: Path) -> None:
    stamps = [*tenths(5), *(2 + k / 10 for k in range(2)), *(4 + k / 10 for k in range(6))]
    path = write(tmp_path / "log.csv", stamps, list(range(13)))
    read = reading(path, BASE + "[split]\ngap_s = 0.5\nshortest_s = 0.3\n" + U).recordings
    assert [(r.name, r.columns["u"].tolist()) for r in read] == [
        ("log", [0, 1, 2, 3, 4]), ("log-2", [7, 8, 9, 10, 11, 12]),
    ]  # fmt: skip
    assert read[1].time_s[0] == pytest.approx(4.0)  # in the log's own time


def test_missing_numbers_are_held_kept_or_end_a_recording(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", tenths(7), ["", 1, "", "", 4, 5, ""])
    held = reading(path, BASE + U + 'missing = "hold"\n')
    assert held.recordings[0].columns["u"].tolist() == [1, 1, 1, 4, 5, 5]
    assert "4 samples have no number; the last one is held" in held.notes[0]
    kept = one(path, BASE + U + 'missing = "nan"\n').columns["u"]
    assert np.isnan(kept).tolist() == [True, False, True, True, False, False, True]
    split = one(path, BASE + U + 'missing = "split"\n')
    assert (split.columns["u"].tolist(), split.time_s[0]) == ([4, 5], pytest.approx(0.4))


def test_two_clocks_meet_at_a_rate_and_one_of_events_holds_to_the_end(tmp_path: Path) -> None:
    np.savez(
        tmp_path / "log.npz",
        t=np.arange(100) / 100, u=np.arange(100.0), slow_t=[0.1, 0.9], mode=[3.0, 4.0],
    )  # fmt: skip
    mode = '[columns.mode]\ncolumn = "mode"\nrole = "input"\nunit = "1"\ntime = "slow_t"\n'
    with pytest.raises(
        UnusableInput, match=r"'mode' has another clock than 'u'; give \[resample\]"
    ):
        one(tmp_path / "log.npz", BASE + U + mode)
    text = BASE + "[resample]\nrate_hz = 10\n" + U + mode
    read = one(tmp_path / "log.npz", text)
    assert read.columns["mode"].tolist() == [3] * 8 + [4]
    assert read.columns["u"].tolist() == list(range(10, 91, 10))
    read = one(tmp_path / "log.npz", text + "event = true\n")
    assert (read.columns["mode"].tolist(), read.time_s[-1]) == ([3] * 8 + [4], pytest.approx(0.9))


@pytest.mark.parametrize(("unit", "per_s"), [("ns", 10**9), ("us", 10**6), ("ms", 1000)])
def test_stamps_since_1970_lose_no_digit(unit: str, per_s: int, tmp_path: Path) -> None:
    start = 1_700_000_000 * per_s
    stamps: list[object] = [start + k * per_s // 1000 for k in range(1000)]
    path = write(tmp_path / "log.csv", stamps, list(range(1000)))
    read = one(path, BASE + f'unit = "{unit}"\n[resample]\nrate_hz = 1000\n' + U)
    assert read.columns["u"].tolist() == list(range(1000))
    assert read.time_s[0] == pytest.approx(0.0, abs=1e-9)


def test_a_folder_of_files_is_one_recording_and_a_path_in_it_leads_nowhere_else(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    write(folder / "cmd.csv", tenths(5), [0, 1, 2, 3, 4])
    write(folder / "arm.csv", tenths(5), [5, 6, 7, 8, 9])
    q = '[columns.q]\ncolumn = "u"\nrole = "output"\nunit = "V"\nfile = "arm.csv"\n'
    read = one(folder, BASE + U + 'file = "cmd.csv"\n' + q)
    assert (read.name, read.columns["q"].tolist()) == ("run", [5, 6, 7, 8, 9])
    for file, reason in (("../x.csv", "no name of a file"), ("none.csv", "cannot be read")):
        with pytest.raises(UnusableInput, match=reason):
            one(folder, BASE + U + f'file = "{file}"\n')
    with pytest.raises(UnusableInput, match="is a folder; say in which of its files"):
        one(folder, BASE + U)
    (tmp_path / "empty").mkdir()
    with pytest.raises(UnusableInput, match="is an empty folder; give files"):
        one(tmp_path / "empty", BASE + U)


def test_names_of_recordings_are_distinct(tmp_path: Path) -> None:
    paths = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        paths.append(write(tmp_path / name / "log.csv", tenths(3), [1, 2, 3]))
    assert [r.name for r in reading(paths, BASE + U).recordings] == ["a-log", "b-log"]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "version is missing; write version = 1 above its first section"),
        ("version = 2\n" + U, "version 2 is newer than this wakedeploy reads (1); upgrade it"),
        ("version = 1\n[columns]\n", "columns: Dictionary should have at least 1 item"),
        (BASE + U.replace("input", "inputs"), "columns.u.role = 'inputs'"),
        (BASE + U + "colour = 3\n", "columns.u.colour is not known"),
        (BASE + U + "untis = 3\n", "columns.u.untis is not known (unit?); known are column"),
        (
            BASE + "[training]\nwindows_s = 1\n" + U,
            "training.windows_s is not known (window_s?); known are name",
        ),
        (BASE + "[split]\nx = 1\n" + U, "split.x is not known; known are gap_s, shortest_s."),
        (
            BASE + "[resample]\nrate_hz = 1\ncut = 1\n" + U,
            "resample.cut is not known; known are rate_hz, method, cutoff_hz.",
        ),
        ("version = 1\n[tiem]\n" + U, "tiem is not known (time?); known are version"),
        (BASE + "rate_hz = 3\n" + U, "give either a column of stamps or a rate_hz, not both"),
        (BASE + "[resample]\nrate_hz = 10\ncutoff_hz = 1\n" + U, 'is of method = "low-pass"'),
        (
            BASE + '[resample]\nrate_hz = 10\nmethod = "low-pass"\ncutoff_hz = 5\n' + U,
            "cutoff_hz has to lie below 0.45 of rate_hz",
        ),
        (BASE + U.replace('"input"', '"unused"'), "no column has a role yet"),
        ("version = 1\n[time]\nrate_hz = 0\n" + U, "rate_hz is still 0"),
        ("=", "not valid TOML"),
        (
            BASE + U.replace("[columns.u]", '[columns."rel x"]'),
            "columns.rel x = 'rel x': a name is a letter, then up to 63 letters, digits and _.",
        ),
        (
            BASE + '[training]\nname = "Two boats"\n' + U,
            "training.name = 'Two boats': a name is a small letter, then up to 40 small letters,"
            " digits and -.",
        ),
    ],
)
def test_a_columns_file_is_refused_by_entry_and_bound(
    text: str, sentence: str, tmp_path: Path
) -> None:
    path = tmp_path / "columns.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(UnusableInput) as told:
        read_columns(path)
    assert sentence in str(told.value)
    assert str(told.value).startswith(str(path))


def test_a_column_that_is_not_there_is_answered_with_the_near_ones(tmp_path: Path) -> None:
    path = tmp_path / "log.strange"
    path.write_text(json.dumps([1]), "utf-8")
    with pytest.raises(UnusableInput, match="is no log of a kind that is known; give CSV"):
        one(path, BASE + U)
    path = write(tmp_path / "log.csv", tenths(3), [1, 2, 3])
    with pytest.raises(UnusableInput, match="column 'T ime' is not there; it has 't', 'u'"):
        one(path, BASE.replace('"t"', '"T ime"') + U)
    with pytest.raises(UnusableInput, match="has no clock of its own"):
        one(path, "version = 1\n" + U)


FOLDER = (
    BASE
    + 'unit = "us"\n{time}[resample]\nrate_hz = 100\n'
    + U.replace('"input"', '"output"')
    + 'file = "u.csv"\n'
    + U.replace("[columns.u]", "[columns.v]")
    + 'file = "v.csv"\n'
)


@pytest.mark.parametrize("starts_us", [(3_000_000, 3_000_000), (5, -5), (-5, 5)])
def test_a_counter_that_begins_again_goes_on_in_all_files_of_a_recording(
    starts_us: tuple[int, int], tmp_path: Path
) -> None:
    """Also where it begins again between the first row of one file and that of another."""
    folder = tmp_path / "log"
    folder.mkdir()
    for name, start_us in zip("uv", starts_us, strict=True):
        stamps = [(2**32 - start_us + 10_000 * k) % 2**32 for k in range(500)]
        write(folder / f"{name}.csv", stamps, [k / 100 for k in range(500)])
    with pytest.raises(UnusableInput, match=r"counter that .* give \[time\] wraps_at = 4294967296"):
        one(folder, FOLDER.format(time=""))
    read = one(folder, FOLDER.format(time="wraps_at = 4294967296\n"))
    assert read.time_s[-1] - read.time_s[0] == pytest.approx(4.99, abs=0.02)
    for column in read.columns.values():
        np.testing.assert_allclose(np.diff(column), 0.01)


def test_a_clock_that_was_set_back_is_no_counter_that_begins_again(tmp_path: Path) -> None:
    """A reboot late in the counter's round, and not at its end."""
    path = write(tmp_path / "log.csv", [4e9, 4.01e9, 4.02e9, 10_000, 20_000, 30_000], [*range(6)])
    text = BASE + 'unit = "us"\nwraps_at = 4294967296\n'
    with pytest.raises(UnusableInput, match=r"falls by 4\.02e\+03 s at line 5"):
        one(path, text + U)
    read = reading(path, text + 'falling = "split"\n' + U).recordings
    assert [r.columns["u"].tolist() for r in read] == [[0, 1, 2], [3, 4, 5]]


def test_a_recording_of_several_files_is_split_where_their_clocks_begin_again(
    tmp_path: Path,
) -> None:
    """A board that was started twice: both files have both runs, at rates of their own."""
    folder = tmp_path / "log"
    folder.mkdir()
    for name, step_us in (("u", 10_000), ("v", 20_000)):
        runs = [range(5_000_000, 7_000_000, step_us), range(1_000_000, 4_000_000, step_us)]
        values = [t / 1e6 + run for run, stamps in enumerate(runs) for t in stamps]
        write(folder / f"{name}.csv", [t for stamps in runs for t in stamps], values)
    text = FOLDER.format(time='falling = "split"\n')
    first, second = reading(folder, text).recordings
    for read, begin_s, run in ((first, 5.0, 0), (second, 1.0, 1)):
        assert read.time_s[0] == pytest.approx(begin_s)
        np.testing.assert_allclose(read.columns["u"], read.time_s + run)
        np.testing.assert_allclose(read.columns["v"][::2], read.time_s[::2] + run)
    write(folder / "v.csv", [*range(1_000_000, 9_000_000, 20_000)], [0] * 400)
    with pytest.raises(UnusableInput, match=r"u.csv:t has 2 runs, v.csv:t 1; cut the files"):
        reading(folder, text)


@pytest.mark.parametrize("kind", ["format = '%H:%M:%S'", 'nanoseconds = "n"'])
def test_what_a_counter_counts_is_for_stamps_that_count(kind: str) -> None:
    with pytest.raises(UnusableInput, match="wraps_at is of stamps in one column that count"):
        parse_columns(BASE + f"wraps_at = 65536\n{kind}\n" + U)
