"""What cells hold: numbers, dates and units as the world's programs write them."""

import time
from pathlib import Path

import numpy as np
import pytest

from tests.domains.tables.written import ROWS, read, text
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.reading import read_recordings


@pytest.mark.parametrize(
    ("delimiter", "mark", "decimal"),
    [(",", ",", "."), (";", ".", ","), (";", "'", "."), (";", ",", ".")],
)
def test_marks_between_thousands_are_seen(
    delimiter: str, mark: str, decimal: str, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    forces = 2000.0 + 1500.0 * ROWS[:, 1]
    swap = str.maketrans({",": mark, ".": decimal})
    rows = [
        (f"{t:.2f}".translate(swap), f'"{w:,.2f}"'.translate(swap))
        for t, w in zip(ROWS[:, 0], forces, strict=True)
    ]
    path.write_text(f"t{delimiter}w\n" + "\n".join(map(delimiter.join, rows)) + "\n")
    guessed, columns = read(path)
    assert f'thousands = "{mark}"  # ? 1{mark}000 is read as a thousand' in guessed
    assert columns[:, 0] == pytest.approx(forces, abs=0.006)


@pytest.mark.parametrize("cells", [("1,234", "5,678"), ("0,234", "12,5"), ("1,234.5", "1,2")])
def test_a_comma_before_three_digits_alone_says_nothing_of_thousands(
    cells: tuple[str, str], tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    rows = [f'{t:.2f};"{cells[k % 2]}";{x:.5f}' for k, (t, x) in enumerate(ROWS[:, :2])]
    path.write_text("t;w;x\n" + "\n".join(rows) + "\n")
    assert "thousands" not in guess_columns(path)


def test_a_number_with_parted_thousands_is_refused_with_what_to_write(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text('t,w\n0.0,"1,234.5"\n0.1,"1,230.5"\n0.2,"990.5"\n')
    stated = 'version = 1\n[time]\ncolumn = "t"\nunit = "s"\n{}[columns.w]\ncolumn = "w"\n'
    stated += 'role = "output"\nunit = "N"\n'
    with pytest.raises(UnusableInput, match=r'line 2.*write \[csv\] thousands = "," in columns'):
        read_recordings([path], parse_columns(stated.format("")))
    columns = parse_columns(stated.format('[csv]\nthousands = ","\n'))
    (recording,) = read_recordings([path], columns).recordings
    assert list(recording.columns["w"]) == [1234.5, 1230.5, 990.5]


@pytest.mark.parametrize(
    ("stamp", "form"),
    [
        ("01/13/2024 10:00:{:06.3f} AM", "%m/%d/%Y %I:%M:%S.%f %p"),
        ("13/01/2024 22:00:{:06.3f}", "%d/%m/%Y %H:%M:%S.%f"),
        ("13.01.2024 22:00:{:06.3f}", "%d.%m.%Y %H:%M:%S.%f"),
        ("2024/01/13 22:00:{:06.3f}", "%Y/%m/%d %H:%M:%S.%f"),
        ("10:00:{:06.3f} PM", "%I:%M:%S.%f %p"),
    ],
)
def test_stamps_are_seen_as_the_worlds_programs_write_them(
    stamp: str, form: str, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{stamp.format(t)},{x:.5f}" for t, x in ROWS[:, :2]]
    path.write_text("Timestamp,x\n" + "\n".join(rows) + "\n")
    guessed = guess_columns(path)
    assert f'format = "{form}"  # ?' in guessed
    columns = parse_columns(guessed.replace('"unused"', '"output"'))
    (recording,) = read_recordings([path], columns).recordings
    assert recording.time_s - recording.time_s[0] == pytest.approx(ROWS[:, 0], abs=1e-6)


@pytest.mark.parametrize(
    "cell", ["#N/A", "-", "--", "1.#QNAN", "-1.#IND00", "1.#QNAN0", "-nan(ind)", "-nan", "#DIV/0!"]
)
def test_what_programs_write_for_no_number_is_missing(cell: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = text(ROWS, ",").splitlines()
    rows[7] = rows[7].rpartition(",")[0] + f",{cell}"
    path.write_text("t,x,w\n" + "\n".join(rows) + "\n")
    stated = guess_columns(path).replace('"unused"', '"output"').replace('"split"', '"nan"')
    (recording,) = read_recordings([path], parse_columns(stated)).recordings
    assert np.flatnonzero(np.isnan(recording.columns["w"])).tolist() == [7]


@pytest.mark.parametrize("odd", [None, "0.30 min", "soon"])
def test_units_may_stand_behind_numbers(odd: str | None, tmp_path: Path) -> None:
    """A timetable as MATLAB writes it; another unit further down is no number."""
    path = tmp_path / "log.csv"
    rows = [f"{t:.2f} sec,{x:.5f} mm" for t, x in ROWS[:, :2]]
    path.write_text("Time,x\n" + "\n".join(rows) + "\n")
    guessed, columns = read(path)
    assert "units_in_cells = true" in guessed
    assert 'column = "Time"\nunit = "sec"' in guessed
    assert columns[:, 0] == pytest.approx(ROWS[:, 1] * 1e-3, abs=1e-8)
    if odd:
        path.write_text("Time,x\n" + "\n".join([*rows, f"{odd},0.0 mm"]) + "\n")
        stated = parse_columns(guessed.replace('"unused"', '"output"'))
        with pytest.raises(UnusableInput, match=f"holds '{odd}' in line 62, and others end in sec"):
            read_recordings([path], stated)


def test_units_behind_stamps_are_compared_between_files(tmp_path: Path) -> None:
    """A timetable has seconds or minutes, as its writer chose for that one."""
    paths = [tmp_path / f"{name}.csv" for name in ("first", "second", "bare")]
    for path, unit in zip(paths, (" sec", " min", ""), strict=True):
        rows = [f"{t:.2f}{unit},{x:.5f}{' mm' if unit else ''}" for t, x in ROWS[:, :2]]
        path.write_text("Time,x\n" + "\n".join(rows) + "\n")
    columns = parse_columns(guess_columns(paths[0]).replace('"unused"', '"output"'))
    with pytest.raises(UnusableInput, match=r"second.*'Time' has numbers in min, and .* says sec"):
        read_recordings(paths[:2], columns)
    with pytest.raises(UnusableInput, match=r"bare.*no unit behind a number"):
        read_recordings([paths[0], paths[2]], columns)


def test_a_factor_makes_another_unit_of_what_stands_behind_a_number(tmp_path: Path) -> None:
    """A load cell that is logged in millivolts."""
    path = tmp_path / "log.csv"
    path.write_text("t,x\n" + "".join(f"{t:.2f} s,{x:.5f} mV\n" for t, x in ROWS[:, :2]))
    stated = guess_columns(path).replace('"unused"', '"output"')
    with pytest.raises(UnusableInput, match=r"'x' has numbers in mV, and columns.toml says N"):
        read_recordings([path], parse_columns(stated.replace('"mV"', '"N"')))
    columns = parse_columns(stated.replace('"mV"', '"N"\nscale = 2.0'))
    (recording,) = read_recordings([path], columns).recordings
    assert recording.columns["x"] == pytest.approx(2.0 * ROWS[:, 1], abs=1e-4)


@pytest.mark.parametrize("stamp", ["2024-01-13 10:00:{:06.3f}", "13/01/2024 10:00:{:06.3f}"])
def test_dates_stand_beside_units_behind_numbers(stamp: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{stamp.format(t)},{x:.5f} mm,7-8,0x1F,71.7W,6S" for t, x in ROWS[:, :2]]
    path.write_text("when,x,id,flags,place,cells\n" + "\n".join(rows) + "\n")
    guessed, columns = read(path)
    assert 'column = "when"\nformat = ' in guessed
    assert columns[:, 0] == pytest.approx(ROWS[:, 1] * 1e-3, abs=1e-8)
    assert columns.shape[1] == 1  # the others are texts


def test_units_behind_numbers_hinder_no_table_without_a_header(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("".join(f"{t:.2f} s,{x:.5f} mm\n" for t, x in ROWS[:, :2]))
    guessed, columns = read(path)
    assert "header = false" in guessed
    assert len(columns) == len(ROWS)


@pytest.mark.parametrize("cells", ["100,200,300", "192.168.100.200", "1.100.200"])
def test_lists_and_addresses_part_no_thousands(cells: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f'{t:.2f},{k},"{cells}"' for k, t in enumerate(ROWS[:, 0])]
    path.write_text("t,n,which\n" + "\n".join(rows) + "\n")
    assert "[csv]" not in guess_columns(path)


@pytest.mark.parametrize(
    ("stamps", "form"),
    [
        (("03/04/2024 23:59:{:02d}", "03/05/2024 00:00:{:02d}"), "%m/%d/%Y %H:%M:%S"),
        (("04/03/2024 23:59:{:02d}", "05/03/2024 00:00:{:02d}"), "%d/%m/%Y %H:%M:%S"),
        (("10:00:00:{:02d}", "10:00:01:{:02d}"), None),  # frames, or hundredths, or milliseconds
    ],
)
def test_day_month_and_frames_are_not_taken_for_each_other(stamps, form, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    texts = [stamp.format(k) for stamp in stamps for k in range(20)]
    path.write_text("when,x\n" + "\n".join(f"{text},{k * k}" for k, text in enumerate(texts)))
    guessed = guess_columns(path)
    assert (f'format = "{form}"' in guessed) if form else ("format" not in guessed)


@pytest.mark.parametrize("cell", ["9" * 16_000, "(" + "a" * 16_000])
def test_long_cells_take_no_time(cell: str, tmp_path: Path) -> None:
    """The search for a unit must not try every length at every place."""
    path = tmp_path / "log.csv"
    path.write_text(f"t,x,{cell}\n" + "".join(f"{t},{x},{cell}\n" for t, x in ROWS[:, :2]))
    begun = time.process_time()
    guess_columns(path)
    assert time.process_time() - begun < 2.0


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", ", "])
def test_quoted_numbers_are_numbers_and_empty_quotes_are_missing(
    delimiter: str, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    rows = [("t_s", "w_n", "x"), *((f"{t:.2f}", f"{w:.5f}", "1.5") for t, w in ROWS[:, :2])]
    for k in (1, 7, 8):
        rows[k] = (rows[k][0], "", "")
    path.write_text("\n".join(delimiter.join(f'"{cell}"' for cell in row) for row in rows) + "\n")
    stated = '[time]\ncolumn = "t_s"\nunit = "s"\n[columns.w_n]\ncolumn = "w_n"\nunit = "N"\n'
    stated = parse_columns(f'version = 1\n{stated}role = "output"\nmissing = "nan"\n')
    (recording,) = read_recordings([path], stated).recordings
    wanted = ROWS[:, 1].copy()
    wanted[[0, 6, 7]] = np.nan
    np.testing.assert_allclose(recording.columns["w_n"], wanted, atol=6e-6)
    assert 'missing = "split"' in guess_columns(path)
