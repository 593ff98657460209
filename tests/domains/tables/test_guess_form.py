"""Tables of text as instruments write them: no header, units below it, lines before it."""

from pathlib import Path

import numpy as np
import pytest

from tests.domains.tables.written import ROWS, read, text
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.reading import read_recordings


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_a_table_without_a_header_keeps_its_first_row(delimiter: str, tmp_path: Path) -> None:
    """Two columns that rise and fall: a first row of numbers was taken for names, and lost."""
    path = tmp_path / "log.txt"
    path.write_text(text(ROWS[:, 1:], delimiter))
    guessed, columns = read(path)
    assert "header = false" in guessed
    assert 'column = "#1"' in guessed
    assert columns == pytest.approx(ROWS[:, 1:], abs=1e-5)


def test_a_first_row_of_numbers_that_is_read_as_names_is_told(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text(ROWS[:, 1:], ","))
    plain = (
        'version = 1\n[time]\nrate_hz = 20\n[columns.q]\ncolumn = {}\nrole = "output"\nunit = "1"\n'
    )
    by_place, by_name = (parse_columns(plain.format(name)) for name in ('"#2"', '"q"'))
    (note,) = read_recordings([path], by_place).notes
    assert "its first row, which holds numbers, was taken for names and left out" in note
    with pytest.raises(UnusableInput, match=r"first row holds numbers.*header = false"):
        read_recordings([path], by_name)


@pytest.mark.parametrize("name", ["flight.log", "nameless", "run.2024-01-02"])
def test_a_table_of_text_is_one_under_any_name(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text("t,x,v\n" + text(ROWS, ","))
    _, columns = read(path)
    assert columns == pytest.approx(ROWS[:, 1:], abs=1e-5)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.xlsx", b"PK\x03\x04 a sheet", "is a spreadsheet; save its sheet as CSV"),
        ("a.bag", b"#ROSBAG V2.0\n\x00\x01", "rosbags-convert --src .*a.bag --dst FOLDER"),
        ("a.jsonl", b'{"t": 0}\n', "is JSON; write it as CSV"),
        ("a.pkl", b"\x80\x04\x95", "is a pickle, which is a program"),
        ("a.strange", b'{"t": 0}\n', "is no log of a kind that is known"),
        ("a.strange", b"<log>\n</log>\n", "is no log of a kind that is known"),
        ("a.strange", b"\x00\x01\x02\n", "is no log of a kind that is known"),
    ],
)
def test_a_file_of_another_kind_says_how_to_convert_it(
    name: str, content: bytes, said: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UnusableInput, match=said):
        guess_columns(tmp_path / name)


def test_a_table_without_a_header_may_have_words_and_dates(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "".join(f"2020-01-01T10:00:{k:02d},ON,{k / 7:.3f}\n" for k in range(50))
    path.write_text(rows)
    guessed, columns = read(path)
    assert "header = false" in guessed
    assert columns[:, -1] == pytest.approx(np.arange(50) / 7, abs=1e-3)
    path.write_text("when,state,x\n" + rows)
    assert "header" not in guess_columns(path)


def test_without_a_header_and_with_decimal_commas(tmp_path: Path) -> None:
    path = tmp_path / "log.txt"
    path.write_text(text(ROWS[:, 1:], ";", ","))
    guessed, columns = read(path)
    assert "header = false" in guessed
    assert 'decimal = ","' in guessed
    assert columns == pytest.approx(ROWS[:, 1:], abs=1e-5)


@pytest.mark.parametrize("header", ["0,1,2", "1,2,3", "t,x,2024"])
def test_columns_may_be_called_by_numbers(header: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(header + "\n" + text(ROWS, ","))
    assert "header = false" not in guess_columns(path)


@pytest.mark.parametrize(
    "units", ["s,m,rad/s", "[s],[m],[rad/s]", "(s),(m),(rad/s)", "s,m,-", "s,m,"]
)
def test_units_below_the_header_are_the_columns_units(units: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"t,x,w\n{units}\n" + text(ROWS, ","))
    guessed, columns = read(path)
    assert "units_row = true" in guessed
    assert 'column = "t"\nunit = "s"' in guessed
    assert 'column = "x"\nrole = "unused"\nunit = "m"' in guessed
    assert ('unit = "rad/s"' in guessed) is ("rad/s" in units)
    assert columns == pytest.approx(ROWS[:, 1:], abs=1e-5)


def test_words_below_the_header_that_are_no_units_are_none(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,x,state\n0,1.5,m\n0.05,1.6,m\n0.1,1.7,s\n")
    assert "units_row" not in guess_columns(path)


@pytest.mark.parametrize(
    ("before", "skipped"),
    [
        (
            "Instrument 7\nDate 2024/01/02\nOperator,Bob\n\n",
            "4  # ? the last line before the table: 'Operator,Bob'",
        ),
        ("Rate:;20\nChannels:;2\n", 2),
        ("A test of the arm\n", 1),
        ("\n\nA test, of the arm\n", 3),
    ],
)
@pytest.mark.parametrize("header", ["Time (s),Pos (mm),Speed (m/s)\n", ""])
def test_lines_before_a_table_are_skipped(
    before: str, skipped: int, header: str, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(before + header + text(ROWS, ","))
    guessed, columns = read(path)
    assert f"skip_rows = {skipped}" in guessed
    in_si = [1e-3, 1.0] if header else 1.0
    assert columns[:, -2:] == pytest.approx(ROWS[:, 1:] * in_si, abs=1e-5)
    assert ("header = false" in guessed) is not bool(header)


@pytest.mark.parametrize(
    "content",
    [
        "name,state,x\n" + "arm,ok,nan\n" * 30 + "1,2,3\n3,4,5\n",  # numbers far below
        "t,x\n" + text(ROWS[:, :2], ","),
        "t,list\n0,[1 2]\n1,[3 4]\n",
    ],
)
def test_a_table_that_begins_in_the_first_line_loses_none(content: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(content)
    assert "skip_rows" not in guess_columns(path)


NUMBERS = text(ROWS, ",")


@pytest.mark.parametrize(
    ("content", "skipped", "names"),
    [
        # Excel pads the lines before a table to its width.
        ("Device,ABC,\nSerial,123,\nTime,q,u\n", 2, "Time,q,u"),
        # An oscilloscope: a line of the same width, without a number, above the names.
        ("Model,X\nVertical,V,V\nTIME,CH1,CH2\n", 2, "TIME,CH1,CH2"),
        ("Rate,100\nt,q,u\n", 1, "t,q,u"),
        (",,\nt,q,u\n", 1, "t,q,u"),
        # Motion capture: two lines before the names, units below.
        ("Trajectories\n100\n,,robot\nFrame,X,Y\n,mm,mm\n", 3, "Frame,X,Y"),
        ("a word of a long account\n" * 150 + "t,q,u\n", 150, "t,q,u"),
    ],
)
def test_the_header_is_the_line_above_the_numbers(content, skipped, names, tmp_path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(content + NUMBERS)
    guessed = guess_columns(path)
    assert f"skip_rows = {skipped}  # ? the last line before the table: " in guessed
    for name in names.split(","):
        assert f'column = "{name}"' in guessed
    known = guessed.replace("rate_hz = 0 ", "rate_hz = 20 ").replace('"unused"', '"output"')
    (recording,) = read_recordings([path], parse_columns(known)).recordings
    assert len(recording.time_s) == len(ROWS)


@pytest.mark.parametrize(
    "content",
    [
        "t,q\n" + text(ROWS[:30, :2], ",") + "t,q,u\n" + text(ROWS[30:], ","),
        text(ROWS[:30, :2], ",") + text(ROWS[30:], ","),
    ],
)
def test_a_log_that_grew_wider_is_refused_and_not_cut(content: str, tmp_path: Path) -> None:
    """Its first part was left out as if it stood before the table."""
    path = tmp_path / "log.csv"
    path.write_text(content)
    with pytest.raises(UnusableInput, match=r"line 3[12]: has 3 fields, but the header 2"):
        guess_columns(path)


def test_names_that_are_fewer_than_the_columns_are_no_header_and_shown(tmp_path: Path) -> None:
    """A date and a time of day below one name; every row is read."""
    path = tmp_path / "log.txt"
    rows = "".join(f"2020-01-01 10:00:{k:02d} {k / 10} {k / 7:.3f}\n" for k in range(50))
    path.write_text("time x y\n" + rows)
    guessed, columns = read(path)
    assert "header = false  # ? its first row holds numbers" in guessed
    assert "skip_rows = 1  # ? the last line before the table: 'time x y'" in guessed
    assert len(columns) == 50


@pytest.mark.parametrize(
    "header", [",0,1,2", ",0.0,0.5,1.0", '"","1","2","3"', "2019,2020,2021,2022", "10,20,30,40"]
)
def test_numbers_that_are_names_stay_names(header: str, tmp_path: Path) -> None:
    """As pandas writes a table without names, or one by years."""
    path = tmp_path / "log.csv"
    path.write_text(header + "\n" + text(np.column_stack([ROWS, ROWS[:, 1]]), ","))
    guessed, columns = read(path)
    assert "header" not in guessed
    assert len(columns) == len(ROWS)


@pytest.mark.parametrize("units", ["s,m,gauss", "s,V,hPa", "s,m,Deg C"])
def test_a_unit_that_is_not_known_hinders_no_other(units: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"t,x,w\n{units}\n" + NUMBERS)
    guessed, columns = read(path)
    assert "units_row = true" in guessed
    assert columns[:, 0] == pytest.approx(ROWS[:, 1], abs=1e-5)


@pytest.mark.parametrize("parting", ["-,-,-", "---,---,---", "float,float,double", "=,=,="])
def test_what_parts_names_from_numbers_is_passed_over(parting: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"t,x,w\n{parting}\n" + NUMBERS)
    guessed, columns = read(path)
    assert 'column = "x"\nrole = "unused"\nunit = "1"' in guessed
    assert columns == pytest.approx(ROWS[:, 1:], abs=1e-5)


def test_a_row_of_states_is_no_row_of_units(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("state,x,y\nN,,\nD,1.5,2.5\nN,1.6,2.5\n")
    assert "units_row" not in guess_columns(path)


def test_first_bytes_come_before_a_name_that_others_use(tmp_path: Path) -> None:
    """A log of PX4 as .bin, and a sheet that is text, as instruments write .xls."""
    path = tmp_path / "flight.bin"
    path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8))
    with pytest.raises(UnusableInput) as told:
        guess_columns(path)
    assert "convert" not in str(told.value)
    path = tmp_path / "scope.xls"
    path.write_text("t\tx\tv\n" + text(ROWS, "\t"))
    assert read(path)[1] == pytest.approx(ROWS[:, 1:], abs=1e-5)
    path = tmp_path / "greek.log"
    path.write_text("t,φ,ω\n" + NUMBERS, "utf-8")
    assert read(path)[1] == pytest.approx(ROWS[:, 1:], abs=1e-5)


LOGGER = (
    '"TOA5","tunnel","CR1000","17","CR1000.Std.32","CPU:fan.CR1","42","fast"\n'
    '"TIMESTAMP","RECORD","Fan","Force"\n"TS","RN","V","mN"\n"","","Smp","Avg"\n'
)
LOGGED = "".join(
    f'"2024-01-01 10:00:{t:05.2f}",{k},{q:.5f},{u:.5f}\n' for k, (t, q, u) in enumerate(ROWS)
)


def test_a_data_logger_says_below_the_units_how_each_column_was_sampled(tmp_path: Path) -> None:
    path = tmp_path / "tunnel.dat"
    path.write_text(LOGGER + LOGGED)
    guessed, columns = read(path)
    for line in ("skip_rows = 1", "units_row = true", "more_rows = 1", 'column = "TIMESTAMP"'):
        assert line in guessed
    assert columns[:, 1:] == pytest.approx(ROWS[:, 1:] * [1.0, 1e-3], abs=1e-5)
    assert len(columns) == len(ROWS)


@pytest.mark.parametrize("below", ["", "s,m,N\n"])
@pytest.mark.parametrize("begin", ["0.0,init,1.0\n", "0.0,0.1,OVLD\n", "0.0,-,-\n0.05,OVLD,1\n"])
def test_a_row_that_has_a_number_is_data(below: str, begin: str, tmp_path: Path) -> None:
    """A sensor that begins late, whose first cells are texts; no row is lost."""
    path = tmp_path / "log.csv"
    path.write_text("t,x,w\n" + below + begin + text(ROWS[begin.count("\n") :], ","))
    guessed, columns = read(path)
    assert "more_rows" not in guessed
    assert ("units_row = true" in guessed) == bool(below)
    assert len(columns) == len(ROWS) - ("-,-" in begin)


def test_a_row_of_data_that_more_rows_leaves_out_is_said(tmp_path: Path) -> None:
    path = tmp_path / "tunnel.dat"
    path.write_text(LOGGER + LOGGED)
    guessed = guess_columns(path)
    assert "more_rows = 1  # ? left out: ',,Smp,Avg'" in guessed
    columns = parse_columns(guessed.replace('"unused"', '"output"'))
    assert not read_recordings([path], columns).notes
    path.write_text(LOGGER.replace('"","","Smp","Avg"\n', "") + LOGGED)
    notes = read_recordings([path], columns).notes
    assert any("line 4 holds numbers and was left out, as more_rows" in note for note in notes)


@pytest.mark.parametrize("names", ["t,x,w", "t,V,A", "time,rpm,volts", "Time,T,N"])
@pytest.mark.parametrize("units", ["", "s,m,kPa\n"])
def test_names_that_read_as_units_are_names(names: str, units: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"Logger X\n{names}\n{units}{NUMBERS}")
    guessed, columns = read(path)
    assert "skip_rows = 1" in guessed
    assert all(f'column = "{name}"' in guessed for name in names.split(","))
    assert ("units_row = true" in guessed) == bool(units)
    if units:
        assert columns == pytest.approx(ROWS[:, 1:] * [1.0, 1e3], rel=1e-3, abs=1e-2)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("ax (m/s^2)", "m/s^2"), ("I [mm^4]", "mm^4"), ("p [kg m2]", "kg m2"), ("u[0]", "1")],
)
def test_a_unit_in_a_name_may_end_in_a_digit(name: str, unit: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"t,{name},w\n" + NUMBERS)
    assert f'column = "{name}"\nrole = "unused"\nunit = "{unit}"' in guess_columns(path)


CAPTURE = (
    "Format Version,1.23,Take Name,t1,\n\n,Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body\n"
    ',Name,R1,R1,R1,R1\n,ID,"A1","A1","A1","A1"\n,,Rotation,Rotation,Position,Position\n'
    "Frame,Time (Seconds),X,Y,X,Y\n"
)


def test_names_stand_above_every_column_of_numbers(tmp_path: Path) -> None:
    """Motion capture: what a body is called may read as a unit; columns are called alike."""
    path = tmp_path / "take.csv"
    rows = [f"{k},{t:.5f},{q:.5f},{u:.5f},{u:.5f},1" for k, (t, q, u) in enumerate(ROWS)]
    path.write_text(CAPTURE + "\n".join(rows) + "\n")
    guessed, columns = read(path)
    assert "skip_rows = 6" in guessed
    assert 'column = "Time (Seconds)"\nunit = "Seconds"' in guessed
    assert 'column = "#3"' in guessed
    assert columns[:, 1:3] == pytest.approx(ROWS[:, 1:], abs=1e-5)


@pytest.mark.parametrize("before", ["", "Logger X\nserial 7\n"])
@pytest.mark.parametrize(("header", "row"), [("", ","), (",", ""), (",", ",")])
def test_a_delimiter_at_the_end_makes_no_column(
    before: str, header: str, row: str, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"{before}t,x,w{header}\n" + text(ROWS, ",").replace("\n", row + "\n"))
    guessed, columns = read(path)
    assert 'column = "w"' in guessed
    assert columns == pytest.approx(ROWS[:, 1:], abs=1e-5)


def test_a_line_that_ends_before_its_last_delimiter_is_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,x,w\n" + text(ROWS, ",").replace("\n", ",\n") + "3.0,0.5,")
    columns = parse_columns(guess_columns(path).replace('"unused"', '"output"'))
    result = read_recordings([path], columns)
    assert [len(each.time_s) for each in result.recordings] == [len(ROWS)]
    assert any("its last line is cut off" in note for note in result.notes)


@pytest.mark.parametrize("units", ["", "s,mm,N\n"])
def test_a_header_that_stands_again_begins_a_recording(units: str, tmp_path: Path) -> None:
    """A logger that was switched on twice, into one file."""
    path = tmp_path / "log.csv"
    path.write_text(2 * ("t,x,w\n" + units + text(ROWS, ",")))
    columns = parse_columns(guess_columns(path).replace('"unused"', '"output"'))
    result = read_recordings([path], columns)
    assert [len(each.time_s) for each in result.recordings] == [len(ROWS)] * 2
    line = len(ROWS) + 2 + bool(units)
    assert any(f"its header stands again in line {line}" in note for note in result.notes)


def test_a_row_that_equals_a_header_of_numbers_is_data(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("0,1\n" + "0.5,1.5\n0,1\n" * 10)
    stated = '[columns.q]\ncolumn = "1"\nrole = "output"\nunit = "1"\n'
    columns = parse_columns("version = 1\n[time]\nrate_hz = 20\n" + stated)
    (recording,) = read_recordings([path], columns).recordings
    assert len(recording.time_s) == 20


@pytest.mark.parametrize("begin", [b"FMT, 128, 89, FMT, BBnNZ, Type\n", b"\xa3\x95\x80\x80"])
def test_a_log_of_a_known_autopilot_says_how_to_convert_it(begin: bytes, tmp_path: Path) -> None:
    path = tmp_path / "flight.log"
    path.write_bytes(begin + b"IMU, 1, 2\n")
    with pytest.raises(UnusableInput, match=r"ArduPilot; convert .* mavlogdump\.py --format csv"):
        guess_columns(path)


@pytest.mark.parametrize(("rows", "few"), [("", "no row"), ("0.0,1.5\n", "only one row")])
def test_a_table_without_rows_to_guess_from_says_so(rows: str, few: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"t_s,force_n\n{rows}")
    with pytest.raises(
        UnusableInput, match=rf"log\.csv: has {few} below its header; give a longer"
    ):
        guess_columns(path)
