"""Lines whose numbers have their names before them, as a board prints for a serial plotter."""

import contextlib
import time
from pathlib import Path

import numpy as np
import pytest

from tests.domains.tables.written import read
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.formats.named_cells import lines_before, named_rows
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.reading import read_recordings

COUNT = 300
AT_S = 0.02 * np.arange(COUNT)
VALUES = np.round(np.column_stack([np.sin(3.0 * AT_S), 40.0 * np.cos(AT_S)]), 3)
FORMS = {
    "plotter": "t_ms:{:.0f},cmd:{:.3f},angle_deg:{:.3f}\n",
    "plotter with blanks": "t_ms: {:.0f}, cmd: {:.3f}, angle_deg: {:.3f}\r\n",
    "tabs": "t_ms:{:.0f}\tcmd:{:.3f}\tangle_deg:{:.3f}\n",
    "equals": "t_ms={:.0f} cmd={:.3f} angle_deg={:.3f}\n",
    "blanks alone": "t_ms: {:.0f} cmd: {:.3f} angle_deg: {:.3f}\n",
    "stamped by the terminal": "12:00:01.523 -> t_ms:{:.0f},cmd:{:.3f},angle_deg:{:.3f}\n",
    "logged": "INFO: t_ms={:.0f}; cmd={:.3f}; angle_deg={:.3f}\n",
}


def lines(form: str) -> list[str]:
    rows = zip(AT_S, VALUES, strict=True)
    return [FORMS[form].format(1e3 * t, *values) for t, values in rows]


def columns_for(path: Path) -> str:
    return guess_columns(path).replace('role = "unused"', 'role = "output"')


@pytest.mark.parametrize("form", FORMS)
def test_numbers_are_read_by_the_names_before_them(form: str, tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    path.write_text("".join(lines(form)), newline="")
    guessed, columns = read(path)
    assert "names_in_cells = true" in guessed
    assert "[columns.angle_deg]" in guessed
    assert 'unit = "deg"' in guessed
    assert columns == pytest.approx(VALUES)


def test_what_stands_before_the_names_is_said_to_be_left_out(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    path.write_text("".join(lines("stamped by the terminal")))
    notes = read_recordings([path], parse_columns(columns_for(path))).notes
    (note,) = [note for note in notes if "first name" in note]
    assert "as '12:00:01.523 ->', is left out" in note


def test_a_begin_and_an_end_that_are_torn_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    whole = "".join(lines("plotter"))
    path.write_text("Sensor ready.\n" + whole[9:-14])
    assert "skip_rows = 2" in guess_columns(path)
    reading = read_recordings([path], parse_columns(columns_for(path)))
    (recording,) = reading.recordings
    assert recording.columns["cmd"] == pytest.approx(VALUES[1:-1, 0])
    assert any("last line is cut off" in note for note in reading.notes)


def test_a_name_that_a_line_lacks_is_a_missing_number(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    made = lines("plotter")
    made[200] = made[200].partition(",angle")[0] + "\n"
    path.write_text("".join(made))
    text = columns_for(path)
    pieces = read_recordings([path], parse_columns(text)).recordings
    assert [len(piece.time_s) for piece in pieces] == [200, 99]
    text = text.replace('missing = "split"', 'missing = "nan"')
    (recording,) = read_recordings([path], parse_columns(text)).recordings
    assert np.flatnonzero(np.isnan(recording.columns["angle_deg"])).tolist() == [200]


def test_a_name_that_the_first_line_lacks_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    made = lines("plotter")
    made[250] = "rmse:0.1\n"
    path.write_text("".join(made))
    with pytest.raises(
        UnusableInput, match=r"line 251: has 'rmse', which none of the first 200 lines has"
    ):
        read_recordings([path], parse_columns(columns_for(path)))


def test_a_table_with_texts_like_names_is_a_table_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = zip(AT_S, VALUES, strict=True)
    path.write_text(
        "t,cmd,angle,note\n" + "".join(f"{t:.2f},{v[0]},{v[1]},gain:2\n" for t, v in rows)
    )
    assert "names_in_cells" not in guess_columns(path)


HOSTILE = {
    "letters": "a" * 400_000,
    "words": "a " * 200_000,
    "names": "a:" * 200_000,
    "cells": "a:1" * 130_000,
    "blanks": "x:1 " + "a " * 60 + " " * 400_000,
    "blanks before a colon": ("abc" + " " * 50) * 8_000,
}


@pytest.mark.parametrize("name", HOSTILE)
def test_long_lines_take_no_time(name: str, tmp_path: Path) -> None:
    """Cut to what a guess looks at, and whole where a person says that names stand in cells."""
    began_s = time.process_time()
    short = HOSTILE[name][:4000] + "\n"
    assert lines_before((n, short) for n in range(1, 300)) is None
    assert lines_before((n, HOSTILE[name]) for n in range(1, 300)) is None
    for length in (4000, None):
        with contextlib.suppress(UnusableInput):
            list(named_rows(tmp_path, iter([(1, HOSTILE[name][:length])]), []))
    assert time.process_time() - began_s < 5.0


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("t_ms:5000,cmd:2t_ms:5020,cmd:25.10,angle_deg:2.5\n", "has a name twice, or more between"),
        ("t_ms:5000,cmd:25,7,angle_deg:2.5\n", "has a name twice, or more between"),
        ("t_ms:5000,cmd:25 V,angle_deg:2.5\n", "has a name twice, or more between"),
        ("t_ms:5000,cmd:ovf,angle_deg:2.5\n", "'ovf' in line 251, which is no number"),
    ],
)
def test_a_line_that_holds_something_else_is_refused_with_its_number(
    line: str, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "serial.log"
    made = lines("plotter")
    path.write_text("".join(made))
    columns = parse_columns(columns_for(path))
    made[250] = line
    path.write_text("".join(made))
    with pytest.raises(UnusableInput, match=said) as refused:
        read_recordings([path], columns)
    assert "line 251" in str(refused.value)


def test_lines_of_words_among_them_are_left_out_and_said(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    made = lines("plotter")
    made.insert(100, "Sensor ready\n")
    path.write_text("".join(made) + "Done.\n")
    reading = read_recordings([path], parse_columns(columns_for(path)))
    (recording,) = reading.recordings
    assert recording.columns["cmd"] == pytest.approx(VALUES[:, 0])
    assert any("line 101 and 1 more has no number with its name" in n for n in reading.notes)


def test_a_number_that_only_some_lines_have_is_a_column_with_gaps(tmp_path: Path) -> None:
    """A slow sensor, printed in every fifth line."""
    path = tmp_path / "serial.log"
    made = [
        line.replace("\n", f",temp:{20 + k % 7}\n") if k % 5 == 0 else line
        for k, line in enumerate(lines("plotter"))
    ]
    path.write_text("".join(made))
    text = columns_for(path).replace('missing = "split"', 'missing = "nan"')
    (recording,) = read_recordings([path], parse_columns(text)).recordings
    temperature = recording.columns["temp"]
    assert np.flatnonzero(np.isfinite(temperature)).tolist() == list(range(0, COUNT, 5))
    assert temperature[::5] == pytest.approx(20 + np.arange(0, COUNT, 5) % 7)


@pytest.mark.parametrize("key", ['decimal = ","', 'thousands = ","', "units_row = true",
                                 "header = false", "units_in_cells = true"])  # fmt: skip
def test_what_names_in_cells_cannot_be_beside_is_refused(key: str) -> None:
    with pytest.raises(UnusableInput, match=f"names_in_cells goes without {key.split()[0]}"):
        parse_columns(f"version = 1\n[csv]\nnames_in_cells = true\n{key}\n")
