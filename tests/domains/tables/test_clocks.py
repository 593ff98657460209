"""Clocks that are wrong, apart, late or set back: refused with what helps, shifted, or split."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import Delimited, parse_columns
from wakedeploy.domains.tables.formats.delimited import DelimitedLog
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.guess_clock import timing_of
from wakedeploy.domains.tables.log_kinds import open_log
from wakedeploy.domains.tables.reading import Reading, read_recordings

TIME = 'version = 1\n[time]\ncolumn = "t"\n'
U = '[columns.u]\ncolumn = "u"\nrole = "input"\nunit = "V"\n'
Q = '[columns.q]\ncolumn = "q"\nrole = "output"\nunit = "rad"\n'
RATE = "[resample]\nrate_hz = 100\n"
GAP = "[split]\ngap_s = 0.5\n"


def read(path: Path, text: str) -> Reading:
    return read_recordings([path], parse_columns(text))


def two_clocks(folder: Path, start_s: float) -> Path:
    """A command from 0 s on, and a sensor whose clock shows `start_s` then; 5 s at 100 Hz."""
    run = folder / "run"
    run.mkdir()
    t = np.arange(500) / 100
    for name, stamps, column in (("cmd", t, "u"), ("arm", start_s + t, "q")):
        table = np.column_stack([stamps, np.sin(t)])
        np.savetxt(run / f"{name}.csv", table, "%.6f", ",", header=f"t,{column}", comments="")
    return run


FILES = U + 'file = "cmd.csv"\n' + Q + 'file = "arm.csv"\n'


@pytest.mark.parametrize("more", [RATE, RATE + GAP, GAP, GAP + "shortest_s = 1\n"])
@pytest.mark.parametrize("unit", ["ms", "ns"])
def test_a_unit_of_time_that_is_wrong_is_said_whatever_else_is_asked_for(
    unit: str, more: str, tmp_path: Path
) -> None:
    """Microseconds read as milliseconds tear each sample from the next; as nanoseconds, too few."""
    if (unit, more) == ("ns", GAP):
        return  # a log of 10 ms at 100 kHz: the system's rate refuses it
    path = tmp_path / "log.csv"
    k = np.arange(1000)
    np.savetxt(path, np.column_stack([10_000 * k, np.sin(k)]), "%d", ",", header="t,u", comments="")
    lasts_s = {"ms": "9990", "ns": "0.00999"}[unit]
    said = f"column 't' .* lasts {lasts_s} s, and .*; if it did not last {lasts_s} s, the time's"
    with pytest.raises(UnusableInput, match=f"{said} unit is wrong: it is '{unit}'; correct unit"):
        read(path, TIME + f'unit = "{unit}"\n' + more + U)
    (one,) = read(path, TIME + 'unit = "us"\n' + more + U).recordings
    assert one.rate_hz == pytest.approx(100.0)


@pytest.mark.parametrize("start_s", [37_000.0, -37_000.0, 1.7e9])
@pytest.mark.parametrize("more", [RATE, RATE + GAP])
def test_clocks_apart_are_named_and_shifted_as_advised(
    start_s: float, more: str, tmp_path: Path
) -> None:
    folder = two_clocks(tmp_path, start_s)
    with pytest.raises(UnusableInput) as told:
        read(folder, TIME + more + FILES)
    late, early = ("q", "u") if start_s > 0 else ("u", "q")
    assert f"column '{late}' begins at" in str(told.value)
    assert f"when '{early}' has ended" in str(told.value)
    (shift,) = re.findall(rf"\[columns.{late}\]: (shift_s = -?[\d.e+]+)", str(told.value))
    entry = FILES.replace(f'column = "{late}"', f'column = "{late}"\n{shift}')
    (one,) = read(folder, TIME + more + entry).recordings
    np.testing.assert_array_equal(one.columns["u"], one.columns["q"])


def test_two_clocks_in_one_table_are_apart_and_not_silent(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{k / 100},{k}," for k in range(500)] + [f"{37000 + k / 100},,{k}" for k in range(500)]
    path.write_text("\n".join(["t,u,q", *rows]) + "\n", "utf-8")
    for missing in ('missing = "hold"\n', 'missing = "split"\n'):
        with pytest.raises(
            UnusableInput, match=r"'q' begins at 37000 s, when 'u' has ended at 4.99 s"
        ):
            read(path, TIME + RATE + U + missing + Q + missing)
    held = 'missing = "hold"\n'
    text = TIME + RATE + U + held + Q + held + "shift_s = -37000\n"
    (one,) = read(path, text).recordings
    np.testing.assert_array_equal(one.columns["u"], one.columns["q"])


def test_columns_that_have_little_in_common_are_remarked_on(tmp_path: Path) -> None:
    folder = two_clocks(tmp_path, 4.0)
    (note,) = read(folder, TIME + RATE + FILES).notes
    assert "'q': begins 4 s after 'u', and both cover only 0.99 s" in note
    assert note.endswith("if their clocks differ, give shift_s in [columns.q]")


def test_a_sensor_that_is_known_to_be_late_is_shifted_to_its_time(tmp_path: Path) -> None:
    t = np.arange(500) / 100
    path = tmp_path / "log.npz"
    np.savez(path, t=t, u=np.sin(t), q=np.sin(t - 0.08))
    (one,) = read(path, TIME + RATE + U + Q + "shift_s = -0.08\n").recordings
    np.testing.assert_allclose(one.columns["q"], one.columns["u"], atol=1e-12)
    with pytest.raises(UnusableInput, match=r"'q' has another clock than 'u'; give \[resample\]"):
        read(path, TIME + U + Q + "shift_s = -0.08\n")
    for bad in ("1e11", "nan", '"late"'):
        with pytest.raises(UnusableInput, match=r"columns\.q\.shift_s"):
            read(path, TIME + RATE + U + Q + f"shift_s = {bad}\n")


def test_ticks_begin_at_a_reading_and_not_at_the_input_beside_it(tmp_path: Path) -> None:
    t, slow_t = np.arange(500) / 50, 0.013 + np.arange(190) / 20
    path = tmp_path / "log.npz"
    np.savez(path, t=t, q=np.sin(t), slow_t=slow_t, u=np.cos(slow_t))
    text = TIME + "[resample]\nrate_hz = 50\n" + U + 'time = "slow_t"\n' + Q
    (one,) = read(path, text).recordings
    np.testing.assert_allclose(one.columns["q"], np.sin(one.time_s), atol=1e-12)


def test_a_column_of_messages_is_stamped_by_its_own_header(tmp_path: Path) -> None:
    """A message was recorded 0.1 s after it was stamped; the command has no header."""
    from mcap.writer import Writer

    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, late_ns in (("/cmd", 0), ("/joint_states", 100_000_000)):
            channel = writer.register_channel(topic, "json", 0)
            for k in range(500):
                stamp_ns = 1_700_000_000_000_000_000 + k * 10_000_000
                stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
                content = {"x": float(k), "header": {"stamp": stamp}, "position": [-1.0, float(k)]}
                at_ns = stamp_ns + late_ns
                writer.add_message(channel, at_ns, json.dumps(content).encode(), at_ns)
        writer.finish()
    text = "version = 1\n" + RATE + U.replace('"u"', '"/cmd.x"')
    text += Q.replace('"q"', '"/joint_states.position[1]"')
    (late,) = read(path, text).recordings
    assert (late.columns["u"] - late.columns["q"]).tolist() == [10.0] * len(late.time_s)
    for own in ('time = "/joint_states.header.stamp"\n', "shift_s = -0.1\n"):
        (one,) = read(path, text + own).recordings
        assert np.array_equal(one.columns["u"], one.columns["q"])


def test_one_columns_file_reads_logs_of_several_formats_whose_columns_are_called_alike(
    tmp_path: Path,
) -> None:
    t = np.arange(300) / 100
    np.savez(tmp_path / "a.npz", t=t, u=np.sin(t))
    np.savetxt(tmp_path / "b.csv", np.column_stack([t, np.sin(t)]), "%.18g", ",", header="t,u")
    a, b = read_recordings(
        [tmp_path / "a.npz", tmp_path / "b.csv"], parse_columns(TIME + U)
    ).recordings
    assert np.array_equal(a.columns["u"], b.columns["u"])
    folder = tmp_path / "run"
    folder.mkdir()
    (tmp_path / "a.npz").rename(folder / "cmd.npz")
    table = np.column_stack([t, np.cos(t)])
    np.savetxt(folder / "arm.csv", table, "%.18g", ",", header="t,q")
    (one,) = read(folder, TIME + U + 'file = "cmd.npz"\n' + Q + 'file = "arm.csv"\n').recordings
    assert np.array_equal(one.columns["q"], np.cos(t))


def test_a_clock_that_stands_still_is_refused_by_its_name(tmp_path: Path) -> None:
    """A header that no node filled, and a date that single precision keeps to two minutes."""
    from mcap.writer import Writer

    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/js", "json", 0)
        for k in range(100):
            content = {"x": float(k), "header": {"stamp": {"sec": 0, "nanosec": 0}}}
            content["late_s"] = 0.01 * k if k != 7 else None
            writer.add_message(channel, k * 10_000_000, json.dumps(content).encode(), 0)
        writer.finish()
    text = 'version = 1\n[columns.x]\ncolumn = "/js.x"\nrole = "output"\nunit = "1"\n'
    said = r"'/js\.header\.stamp' stands still at 0; leave it out: /js\.log_time counts then"
    with pytest.raises(UnusableInput, match=said):
        read(path, text + 'time = "/js.header.stamp"\n')
    said = r"'/js\.late_s' has no stamp in message \d+; leave it out: /js\.log_time counts then"
    with pytest.raises(UnusableInput, match=said):
        read(path, text + 'time = "/js.late_s"\n')
    (one,) = read(path, text).recordings
    assert one.rate_hz == pytest.approx(100.0)
    dates_s = np.float32(1.73e9 + np.arange(300) / 100)
    np.savez(tmp_path / "log.npz", t=dates_s, q=np.sin(np.arange(300)))
    with pytest.raises(UnusableInput, match=r"'t' stands still at 17.*; give another column"):
        read(tmp_path / "log.npz", TIME + Q)


START_NS = 1_730_000_000_980_000_000
IN_TWO = '[time]\ncolumn = "stamp.sec"\nnanoseconds = "stamp.nanosec"\n'


def in_two(path: Path, header: str = "stamp.sec,stamp.nanosec,frame,q") -> Path:
    """Four seconds at 100 Hz as tools for ROS write a stamp: seconds, and nanoseconds beyond."""
    stamps_ns = [START_NS + 10_000_000 * k for k in range(400)]
    rows = [f"{ns // 10**9},{ns % 10**9},base,{np.sin(ns / 1e8):.6f}" for ns in stamps_ns]
    path.write_text("\n".join([header] * bool(header) + rows) + "\n")
    return path


def test_seconds_and_nanoseconds_are_one_clock(tmp_path: Path) -> None:
    path = in_two(tmp_path / "log.csv")
    reading = read_recordings([path], parse_columns("version = 1\n" + IN_TWO + Q))
    (one,) = reading.recordings
    assert (len(one.time_s), one.rate_hz) == (400, pytest.approx(100.0))
    assert not reading.notes
    for wrong, said in (
        (IN_TWO.replace("stamp.sec", "q"), r"'q' with nanoseconds: .* is no whole second"),
        (IN_TWO.replace("stamp.sec", "frame"), "with nanoseconds: 'base' is no number; mend it"),
        (IN_TWO.replace("stamp.nanosec", "frame"), "with nanoseconds: 'base' is no number"),
        (IN_TWO.replace(".nanosec", ".sec"), "17300.* in line 2 is no nanoseconds of one"),
        (IN_TWO + 'unit = "ms"\n', 'whole seconds in `column`: unit = "s"'),
        ('[time]\nrate_hz = 100\nnanoseconds = "q"\n', "are for whole seconds in `column`"),
    ):
        with pytest.raises(UnusableInput, match=said):
            read(path, "version = 1\n" + wrong + Q)


@pytest.mark.parametrize("stamp", ["{}", "{}e-3", "inf"])
def test_stamps_that_are_no_seconds_have_no_nanoseconds_beyond_them(
    tmp_path: Path, stamp: str
) -> None:
    """Whole stamps in ns or ms were taken for seconds: a log of 100 Hz was one of 1e-7 Hz."""
    rows = [f"{stamp.format(START_NS + 10_000_000 * k)},0,{k % 7}" for k in range(400)]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(["stamp.sec,stamp.nanosec,q", *rows]) + "\n")
    said = (
        "'stamp.sec' with nanoseconds: .* in line 2 is too large for seconds; give the column of "
        r"whole seconds, or leave \[time\] nanoseconds out and give the unit"
    )
    with pytest.raises(UnusableInput, match=said):
        read(log, "version = 1\n" + IN_TWO + Q)


def test_a_column_whose_own_clock_is_the_seconds_alone_leaves_the_others_theirs(
    tmp_path: Path,
) -> None:
    """All columns went onto the clock of the seconds, with five samples at 1 Hz."""
    log = tmp_path / "log.csv"
    in_two(log, "stamp.sec,stamp.nanosec,frame,q")
    text = "version = 1\n" + IN_TWO + 'repeated = "last"\n[resample]\nrate_hz = 100\n' + Q
    slow = '[columns.a_slow]\ncolumn = "q"\nrole = "output"\nunit = "1"\ntime = "stamp.sec"\n'
    text = text.replace("[columns.q", slow + "[columns.q", 1)
    (one,) = read(log, text).recordings
    numbers = one.columns["q"]
    assert len(np.unique(numbers)) > 100
    assert len(set(one.clocks.values())) == 2


@pytest.mark.parametrize("header", ["stamp.sec,stamp.nanosec,frame,q", "sec,nsec,frame,q", ""])
def test_guess_sees_seconds_and_nanoseconds(tmp_path: Path, header: str) -> None:
    """Nanoseconds alone were the clock, and ended a recording with each second."""
    whole, beyond, _, q = header.split(",") if header else ("#1", "#2", "", "#4")
    text = guess_columns(in_two(tmp_path / "log.csv", header))
    assert f'nanoseconds = "{beyond}"\n# about 100 Hz, 3.99 s\n' in text
    assert text.count(f'"{whole}"') == 1
    assert "falling" not in text
    given = text.replace('"unused"', '"output"')
    (one,) = read_recordings([tmp_path / "log.csv"], parse_columns(given)).recordings
    assert len(one.time_s) == 400
    assert f'column = "{q}"' in text


@pytest.mark.parametrize("end", ["", "1,2,3\n4,5,6,7\n"])
def test_a_table_without_a_header_is_not_read_again_for_each_of_its_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    """Nor is one that cannot be read, as its rows are of several widths."""
    reads: list[int] = []
    read_columns = DelimitedLog.read
    monkeypatch.setattr(
        DelimitedLog, "read", lambda *a: reads.append(len(a[1])) or read_columns(*a)
    )
    counts = []
    for width in (10, 60):
        rows = [[k % 7 + column for column in range(width)] for k in range(50)]
        path = tmp_path / f"{width}.csv"
        path.write_text("".join(",".join(map(str, row)) + "\n" for row in rows) + end)
        del reads[:]
        log = open_log(path, Delimited(header=False, delimiter=","))
        assert timing_of(log, log.fields()).column is None
        counts.append(len(reads))
    assert counts[1] <= counts[0] + 20


def test_guess_takes_no_counter_beside_whole_numbers_for_a_clock(tmp_path: Path) -> None:
    rows = (f"{mode},{20 * k},{k * k % 7}" for k, mode in enumerate([0] * 50 + [1] * 50))
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    assert "nanoseconds" not in guess_columns(tmp_path / "log.csv")


def test_guess_takes_the_time_of_a_simulation_and_lists_that_of_the_wall(tmp_path: Path) -> None:
    t = np.arange(400) / 100
    wall_s = np.cumsum(0.01 / (0.7 + 0.3 * np.sin(t)))
    np.savez(tmp_path / "log.npz", wall_time=wall_s, sim_time=t, q=np.sin(t))
    text = guess_columns(tmp_path / "log.npz")
    assert '[time]\ncolumn = "sim_time"\nunit = "s"  # ?\n# about 100 Hz' in text
    assert 'column = "wall_time"' in text
    assert "[resample]" not in text


def test_guess_gives_what_is_in_no_group_the_clock_beside_it(tmp_path: Path) -> None:
    """The clock of a group comes first in the order of letters, and begins five seconds later."""
    h5py = pytest.importorskip("h5py")
    t = np.arange(400) / 100
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, numbers in {"arm/t": t + 5.0, "arm/q": np.sin(t), "t": t, "u": np.cos(t)}.items():
            file[name] = numbers
    text = guess_columns(tmp_path / "log.h5")
    clocks = dict(re.findall(r'^column = "(.*)"\n(?:time = "(.*)".*\n)?', text, re.M))
    assert (clocks["arm/t"], clocks["arm/q"], clocks["u"]) == ("", "", "t")
