"""A first columns.toml: the clock, the rate and what blanks mean, guessed and then read."""

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.domains.tables.columns import Delimited, Encoding, parse_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.guess_asked import Asked
from wakedeploy.domains.tables.guess_rate import usual_hz
from wakedeploy.domains.tables.reading import read_recordings

ROLES = {"cmd": "input", "q": "output"}


def table(path: Path, **columns: Any) -> Path:
    header = ",".join(columns)
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, "%.6f", ",", header=header, comments="")
    return path


def read(path: Path, guessed: str) -> tuple[Recording, ...]:
    """What a guess gives once its columns have the roles of their names."""
    for name, role in ROLES.items():
        head, found, tail = guessed.partition(f"[columns.{name}]")
        guessed = head + found + tail.replace('"unused"', f'"{role}"', 1)
    return read_recordings([path], parse_columns(guessed)).recordings


@pytest.mark.parametrize(
    ("unit", "end", "step"),
    [("us", 2**32, 10_000), ("ms", 2**16, 10), ("s", 2**32 / 1e6, 0.01), ("us", 2**31, 10_000)],
)
def test_guess_sees_a_counter_that_begins_again(
    unit: str, end: float, step: float, tmp_path: Path
) -> None:
    """A recording of 20 s, as long as it is; 32 bits may have a sign, and begin again below 0."""
    low = -(2**31) if end == 2**31 else 0
    stamps = [low + (end - low - 7.5 * 100 * step + step * k) % (end - low) for k in range(2000)]
    rows = [f"{t:.6f},{k % 7}" for k, t in enumerate(stamps)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([f"t_{unit},x", *rows]) + "\n")
    guessed = guess_columns(path)
    assert f"wraps_at = {end - low:.16g}  # ?" in guessed
    assert "# about 100 Hz, 19.99 s" in guessed
    assert "falling" not in guessed
    given = guessed.replace('"unused"', '"output"')
    (one,) = read_recordings([path], parse_columns(given)).recordings
    assert len(one.time_s) == 2000


def test_a_clock_that_is_set_back_begins_another_recording(tmp_path: Path) -> None:
    t = np.arange(1000) / 50
    t[600:] -= 5.0
    path = table(tmp_path / "log.csv", t=t, q=np.arange(1000))
    plain = 'version = 1\n[time]\ncolumn = "t"\n[columns.q]\ncolumn = "q"\nrole = "output"\n'
    with pytest.raises(UnusableInput, match='falling = "split" where the clock was set back'):
        read(path, f'{plain}unit = "1"\n')
    guessed = guess_columns(path)
    assert 'falling = "split"  # ? set back by 4.98 s, it goes on' in guessed
    first, second = read(path, guessed)
    assert first.columns["q"].tolist() == list(range(600))
    assert second.columns["q"].tolist() == list(range(600, 1000))


def test_messages_that_swap_places_are_sorted_and_it_is_said_how_far(tmp_path: Path) -> None:
    t = np.arange(1000) / 50
    t[[100, 101, 102, 700, 701]] = t[[102, 101, 100, 701, 700]]
    path = table(tmp_path / "log.csv", t=t, q=50 * t)
    guessed = guess_columns(path)
    assert 'falling = "sort"  # ? messages swapped places, by up to 0.04 s' in guessed
    (one,) = read(path, guessed)
    assert one.columns["q"].tolist() == list(range(1000))
    roles = guessed.replace('"unused"', '"output"')
    (note,) = read_recordings([path], parse_columns(roles)).notes
    assert note.endswith("3 stamps fell and were sorted, by up to 0.04 s")


@pytest.mark.parametrize("is_sorted", [True, False])
def test_streams_in_one_table_are_told_from_lost_samples(is_sorted: bool, tmp_path: Path) -> None:
    """States at 50 Hz and commands at 20 Hz, a row for each message: every state is measured."""
    pandas = pytest.importorskip("pandas")
    t, command_t = np.arange(500) / 50, np.arange(200) / 20
    commands = pandas.DataFrame({"t": command_t, "cmd": np.sin(command_t)})
    states = pandas.DataFrame({"t": t, "q": np.cos(t)})
    both = pandas.concat([commands, states])
    path = tmp_path / "log.csv"
    (both.sort_values("t", kind="stable") if is_sorted else both).to_csv(path, index=False)
    guessed = guess_columns(path)
    assert guessed.count('missing = "hold"') == 2
    assert "rate_hz = 50  # ? that of q; inputs are held" in guessed
    assert ('falling = "sort"  # ? one stream stands after' in guessed) == (not is_sorted)
    (one,) = read(path, guessed)
    assert np.array_equal(one.columns["q"], states["q"][: len(one.time_s)])


def test_files_with_clocks_of_their_own_are_brought_to_the_rate_of_what_is_measured(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    t, command_t = np.arange(500) / 50, np.arange(2000) / 200
    table(folder / "cmd.csv", t=command_t, cmd=np.sin(command_t))
    table(folder / "state.csv", stamp_ms=1000 * t, q=np.arange(500))
    guessed = guess_columns(folder)
    assert "rate_hz = 50  # ? that of state.csv q; inputs are held" in guessed
    assert 'file = "state.csv"\ntime = "stamp_ms"\ntime_unit = "ms"' in guessed
    assert "[columns.stamp_ms]" not in guessed
    (one,) = read(folder, guessed)
    assert one.columns["q"].tolist() == list(range(len(one.time_s)))
    assert len(one.time_s) > 490
    table(folder / "state.csv", t=command_t, q=np.arange(2000))
    assert "[resample]" not in guess_columns(folder)  # one clock


def test_files_of_one_layout_are_recordings_of_one_kind(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    t = np.arange(100) / 50
    for k in range(24):
        table(folder / f"run_{k:02}.csv", t=t, q=np.full(100, k), cmd=np.sin(t + k))
    guessed = guess_columns(folder)
    assert guessed.count("[columns.") == 2
    assert "# All 24 files have these columns" in guessed
    assert "# Ranges below are those of run_00.csv; other files may go further." in guessed
    assert "runs/*.csv" in guessed
    assert "\nfile = " not in guessed
    roles = guessed.replace('"unused"', '"output"')
    read_back = read_recordings(sorted(folder.iterdir()), parse_columns(roles)).recordings
    assert [one.columns["q"][0] for one in read_back] == list(range(24))
    with pytest.raises(UnusableInput, match="or give files"):
        read(folder, roles)


@pytest.mark.parametrize("encoding", ["cp1252", "latin-1", "utf-16"])
def test_a_table_in_another_encoding_is_guessed_and_read(encoding: str, tmp_path: Path) -> None:
    odd = "\x8d" if encoding == "latin-1" else ""
    header = f"Zeit [s];{odd}Wärme [°C]"
    rows = "".join(f"{k / 10};{20 + k}\n" for k in range(50))
    path = tmp_path / "log.csv"
    path.write_bytes(f"{header}\n{rows}".encode(encoding))
    guessed = guess_columns(path)
    assert f'encoding = "{encoding}"' in guessed
    columns = parse_columns(guessed.replace('"unused"', '"output"'))
    (recording,) = read_recordings([path], columns).recordings
    assert [column[1] for column in recording.columns.values()] == [21.0 + 273.15]
    wrong = columns.model_copy(update={"csv": Delimited(encoding="ascii")})
    with pytest.raises(UnusableInput, match=rf'encoding = "{encoding}" in columns\.toml'):
        read_recordings([path], wrong)


@pytest.mark.parametrize(
    ("first", "step", "rate_hz", "unit"),
    [
        (0.0, 2.0, None, "ms"),
        (0.0, 2.0, 0.5, "s"),  # of a furnace
        (0.0, 2.0, 100.0, "ms"),
        (0.0, 2.0, 3000.0, "ms"),  # no unit fits
        (1.7e12, 10.0, 0.005, "ms"),  # a date says what it counts in, whatever the system's rate
    ],
)
def test_a_clock_counts_in_what_the_system_s_rate_says(
    first: float, step: float, rate_hz: float | None, unit: str, tmp_path: Path
) -> None:
    np.savez(tmp_path / "log.npz", t=first + step * np.arange(2400.0), x=np.arange(2400.0))
    guessed = guess_columns(tmp_path / "log.npz", (), rate_hz)
    assert f'unit = "{unit}"' in guessed.split("[columns")[0]
    assert ("about 0.5 Hz, 4798 s" in guessed) == (unit == "s")


@pytest.mark.parametrize(("unit", "begins"), [("K", 20.0 + 273.15), ("°C", 20.0)])
def test_degrees_celsius_are_seen_in_a_name(unit: str, begins: float, tmp_path: Path) -> None:
    """A file without units, as of MATLAB, says them in names alone."""
    np.savez(tmp_path / "log.npz", t=np.arange(50) / 10, plate_degC=20.0 + np.arange(50))
    guessed = guess_columns(tmp_path / "log.npz", [Asked("plate", "output", unit)])
    (recording,) = read_recordings(
        [tmp_path / "log.npz"], parse_columns(guessed), {"plate": unit}
    ).recordings
    assert recording.columns["plate"][0] == pytest.approx(begins)


@pytest.mark.parametrize("encoding", ["cp1252", "latin-1"])
@pytest.mark.parametrize("kept", [0.02, 0.5, 0.98])
def test_a_packed_table_that_was_cut_and_is_no_unicode_is_refused_in_a_sentence(
    encoding: Encoding, kept: float, tmp_path: Path
) -> None:
    """A copy that broke off; its begin still shows how it is encoded."""
    odd = "\x8d" if encoding == "latin-1" else ""
    numbers = np.random.default_rng(0).random(3000)
    rows = "".join(f"{k / 10},{x:.6f}\n" for k, x in enumerate(numbers))
    packed = gzip.compress(f"Zeit [s],{odd}Wärme [°C]\n{rows}".encode(encoding))
    path = tmp_path / "log.csv.gz"
    path.write_bytes(packed[: int(kept * len(packed))])
    columns = parse_columns(
        'version = 1\n[time]\nrate_hz = 10\n[columns.t]\ncolumn = "#2"\nunit = "1"\n'
        'role = "output"\n'
    )
    if kept > 0.02:  # less of it has no line
        with pytest.raises(UnusableInput, match=rf'encoding = "{encoding}" in columns\.toml\.$'):
            read_recordings([path], columns)
    stated = columns.model_copy(update={"csv": Delimited(encoding=encoding)})
    for fails in (lambda: read_recordings([path], stated), lambda: guess_columns(path)):
        with pytest.raises(UnusableInput) as error:
            fails()
        said = str(error.value)
        assert said.startswith(f"{path}: ")
        assert said.endswith(".")
        assert "\n" not in said
    with pytest.raises(UnusableInput, match=r"end-of-stream marker was reached.*; copy it again"):
        read_recordings([path], stated)


def test_a_name_that_says_its_unit_keeps_it(tmp_path: Path) -> None:
    path = table(
        tmp_path / "log.csv", t=np.arange(50) / 10, cmd_percent=np.arange(50), x_mm=np.ones(50)
    )
    guessed = guess_columns(path)
    assert guessed.count('to = "%"') == guessed.count('to = "mm"') == 1
    read_recordings([path], parse_columns(guessed.replace('"unused"', '"output"')))


@pytest.mark.parametrize(
    ("header", "name", "unit", "to"),
    [
        ("Kraft [mN]", "kraft_mn", "mN", "mN"),
        ("kraft_kN", "kraft_kn", "kN", "kN"),
        ("Drehmoment [Nmm]", "drehmoment_nmm", "Nmm", "Nmm"),
        ("v [km/h]", "v_km_h", "km/h", "km/h"),
        ("gyro [deg/s]", "gyro_deg_s", "deg/s", "deg/s"),
        ("v [m/s]", "v_m_s", "m/s", None),
        ("airspeed_m_s", "airspeed_m_s", "m/s", None),
        ("accelerometer_m_s2", "accelerometer_m_s2", "m/s^2", None),
        ("tau_n_m", "tau_n_m", "N m", None),
        ("load_MN", "load_mn", "MN", None),
        ("Temp [degC]", "temp_k", "K", None),
        ("Stellgröße [mN]", "stellgrosse_mn", "mN", "mN"),
        ("Tête é [mN]", "tete_e_mn", "mN", "mN"),
        ("Størrelse [mN]", "storrelse_mn", "mN", "mN"),
        ("Siła [mN]", "sila_mn", "mN", "mN"),
        ("Đường Œuvre Ære Ǿ [mN]", "duong_oeuvre_aere_o_mn", "mN", "mN"),
    ],
)
def test_a_column_keeps_the_unit_that_its_name_ends_in(
    header: str, name: str, unit: str, to: str | None, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"t,{header}\n" + "".join(f"{k / 10},{k}.5\n" for k in range(50)))
    guessed = guess_columns(path)
    assert f"[columns.{name}]" in guessed
    assert f'unit = "{unit}"' in guessed
    assert (f'to = "{to}"' in guessed) if to else ("to = " not in guessed)
    read_recordings([path], parse_columns(guessed.replace('"unused"', '"output"')))


def test_a_name_in_millinewtons_that_is_read_in_newtons_is_doubted(tmp_path: Path) -> None:
    path = table(tmp_path / "log.csv", t=np.arange(50) / 10, kraft_mN=np.arange(50.0))
    text = guess_columns(path).replace('"unused"', '"output"').replace('unit = "mN"', 'unit = "N"')
    text = text.replace('to = "mN"', 'to = "N"').replace("columns.kraft_mn", "columns.force")
    (note,) = read_recordings([path], parse_columns(text)).notes
    assert "read as N, and its name says mN; check `unit`" in note


def test_the_folder_that_one_stands_in_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "one.csv").write_text("t,x\n" + "".join(f"{k / 10},{k}\n" for k in range(50)))
    monkeypatch.chdir(tmp_path)
    assert guess_columns(".").startswith(f"# What the columns of {tmp_path.name} mean")


def test_files_of_other_columns_are_said_to_be_taken_for_parts_of_one_recording(
    tmp_path: Path,
) -> None:
    folder, t = tmp_path / "runs", np.arange(100) / 50
    folder.mkdir()
    table(folder / "cmd.csv", t=t, cmd=np.sin(t))
    assert "parts of one recording" not in guess_columns(folder)
    table(folder / "state.csv", t=t, q=np.cos(t))
    guessed = guess_columns(folder)
    assert "# Its files have other columns each: they are taken for parts of one rec" in guessed
    assert len(read(folder, guessed)) == 1


def test_files_of_two_layouts_are_listed_once_for_each(tmp_path: Path) -> None:
    folder, t = tmp_path / "runs", np.arange(100) / 50
    folder.mkdir()
    for k in range(3):
        table(folder / f"cmd_{k}.csv", t=t, cmd=np.sin(t))
        table(folder / f"state_{k}.csv", t=t, q=np.cos(t))
    guessed = guess_columns(folder)
    assert guessed.count("[columns.") == 2
    assert guessed.count("\nfile = ") == 2
    assert "# cmd_0.csv has the columns of 2 more, which are not listed:\n#   cmd_1.csv" in guessed
    (one,) = read(folder, guessed)
    assert np.array_equal(one.columns["q"], np.round(np.cos(t), 6))


def test_topics_are_brought_to_the_rate_of_the_fastest_that_is_measured(tmp_path: Path) -> None:
    import json

    from mcap.writer import Writer

    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, rate_hz in (
            ("/arm_cmd", 200),
            ("/state", 125),
            ("/battery", 20),
            ("/home", 1000),
        ):
            channel = writer.register_channel(topic, "json", 0)
            for k in range(2 * rate_hz if rate_hz < 1000 else 3):
                stamp_ns = k * 10**9 // rate_hz
                content = json.dumps({"x": 0.1 * k}).encode()
                writer.add_message(channel, stamp_ns, content, stamp_ns)
        writer.finish()
    assert "rate_hz = 125  # ? that of /state" in guess_columns(path)


def archive(path: Path, arrays: dict[str, Any]) -> Path:
    """The arrays in the format that a name ends in."""
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    elif path.suffix == ".mat":
        pytest.importorskip("scipy").io.savemat(path, arrays)
    else:
        with pytest.importorskip("h5py").File(path, "w") as file:
            for name, array in arrays.items():
                file[name] = array
    return path


def arrays(q_t: str, cmd_t: str, q: str = "q", cmd: str = "cmd") -> dict[str, Any]:
    """A state at 50 Hz that its command at 20 Hz drives; stamps of the command in ms."""
    t, command_t = np.arange(500) / 50, np.arange(200) / 20
    return {q_t: t, q: np.arange(500.0), cmd_t: 1000 * command_t, cmd: np.sin(command_t)}


NAMED = [("t", "cmd_time_ms"), ("t_q", "t_cmd_ms"), ("time", "x"), ("q_t", "cmd_t")]


@pytest.mark.parametrize(
    ("kind", "q_t", "cmd_t"),
    [
        *((kind, *names) for kind in ("npz", "mat") for names in NAMED),
        *(  # each reading of HDF5 starts a process
            pytest.param("h5", *names, marks=mark)
            for names, mark in zip(
                NAMED,
                (pytest.mark.slow, pytest.mark.slow, pytest.mark.whole, pytest.mark.whole),
                strict=True,
            )
        ),
    ],
)
def test_clocks_of_several_lengths_in_one_file_are_those_of_their_columns(
    kind: str, q_t: str, cmd_t: str, tmp_path: Path
) -> None:
    path = archive(tmp_path / f"log.{kind}", arrays(q_t, cmd_t))
    guessed = guess_columns(path)
    assert f"[columns.{q_t}]" not in guessed
    assert f"[columns.{cmd_t}]" not in guessed
    assert "rate_hz = 50  # ? that of q; inputs are held" in guessed
    (one,) = read(path, guessed)
    assert one.columns["q"].tolist() == list(range(len(one.time_s)))
    assert len(one.time_s) > 470
    np.testing.assert_allclose(  # the newest command at each tick
        one.columns["cmd"], np.sin(np.floor(one.time_s * 20 + 1e-9) / 20), atol=1e-12
    )


@pytest.mark.whole
def test_a_column_has_the_clock_of_its_group_and_of_its_words(tmp_path: Path) -> None:
    """Three clocks, two of one length that tell other times."""
    t = np.arange(400) / 40
    grouped = {"arm/time": t, "arm/q": 40 * t, "base/time": t + 3.0, "base/cmd": np.sin(t)}
    guessed = guess_columns(archive(tmp_path / "log.h5", grouped | {"slow/time": t[::4]}))
    assert 'column = "base/cmd"\ntime = "base/time"' in guessed
    assert 'column = "arm/q"\nrole' in guessed
    lengths = {"t": t, "q": 40 * t, "t_a": t[::2], "a": t[::2] ** 2, "t_b": t[1::2], "b": t[::2]}
    guessed = guess_columns(archive(tmp_path / "log.npz", lengths))
    assert 'column = "a"\ntime = "t_a"' in guessed
    assert 'column = "b"\ntime = "t_b"' in guessed


@pytest.mark.parametrize("kind", ["npz", "csv"])
def test_a_column_has_the_stamps_with_its_word_though_the_first_clock_is_as_long(
    kind: str, tmp_path: Path
) -> None:
    t = np.arange(500) / 100
    columns = {"t": t, "q": np.sin(t), "t_cmd": t + 0.083, "cmd": np.cos(t)}
    path = tmp_path / f"log.{kind}"
    guessed = guess_columns(table(path, **columns) if kind == "csv" else archive(path, columns))
    assert 'column = "cmd"\ntime = "t_cmd"  # ? by its name' in guessed
    assert 'column = "q"\nrole' in guessed
    assert "[columns.t_cmd]" not in guessed
    (one,) = read(path, guessed)
    late = np.floor((one.time_s - 0.083) * 100 + 1e-6) / 100
    np.testing.assert_allclose(one.columns["cmd"], np.cos(late), atol=1e-6)


@pytest.mark.parametrize("other", [lambda t: t, lambda t: 0.01 * t])
def test_a_column_of_the_same_times_or_of_a_short_time_is_no_other_clock(
    other: Callable[[np.ndarray], np.ndarray], tmp_path: Path
) -> None:
    """A time that a motor has run, say, is no stamp."""
    t = np.arange(500) / 100
    path = table(tmp_path / "log.csv", t=t, motor_time=other(t), motor_cmd=np.sin(t))
    assert "\ntime = " not in guess_columns(path)


@pytest.mark.parametrize(
    ("name", "other", "line"),
    [
        ("x_t", "u_t", 'column = "x_t"  # ? it rises; a position may, too'),
        ("t_robot", "pose", 'column = "t_robot"  # ? it rises; a position may, too'),
        ("t_pose", "pose", 'column = "t_pose"\n'),
        ("pose_t", "pose", 'column = "pose_t"\n'),
    ],
)
def test_what_rises_is_the_clock_of_a_column_with_its_word_or_a_guess(
    name: str, other: str, line: str, tmp_path: Path
) -> None:
    """In a log of x_t and u_t the t may say: at that time."""
    rng = np.random.default_rng(0)
    columns = {name: np.cumsum(rng.uniform(0.01, 0.1, 300)), other: rng.standard_normal(300)}
    assert line in guess_columns(table(tmp_path / "log.csv", **columns))


def test_a_rate_that_a_log_has_comes_before_a_column_that_may_be_a_position(tmp_path: Path) -> None:
    x = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.1, 300))
    guessed = guess_columns(archive(tmp_path / "log.npz", {"x_t": x, "u_t": -x, "fs": 50.0}))
    assert "rate_hz = 50  # ? from" in guessed
    assert "[columns.x_t]" in guessed


EPOCH_S = 1_700_000_000


@pytest.mark.parametrize("rate_hz", [10, 50, 200, 1000])
@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_stamps_since_1970_tell_their_unit(unit: str, rate_hz: int, tmp_path: Path) -> None:
    per_s = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    step = per_s / rate_hz if unit == "s" else per_s // rate_hz
    stamp = EPOCH_S * per_s + step * np.arange(500)
    path = tmp_path / "log.csv"
    path.write_text("stamp,q\n" + "".join(f"{s},{i}\n" for i, s in enumerate(stamp.tolist())))
    guessed = guess_columns(path)
    assert f'unit = "{unit}"  # ?\n# about {rate_hz} Hz' in guessed


@pytest.mark.parametrize(
    ("step", "unit", "about"),
    [
        (1.0, "s", "1 Hz"),  # a slow log of an hour
        (0.02, "s", "50 Hz"),
        (20, "ms", "50 Hz"),
        (1000, "us", "1000 Hz"),
        (20_000, "us", "50 Hz"),
        (20_000_000, "ns", "50 Hz"),
        (1_000_000, "ns", "1000 Hz"),
    ],
)
def test_stamps_since_a_start_have_the_unit_of_a_likely_log(
    step: float, unit: str, about: str, tmp_path: Path
) -> None:
    count = np.arange(4000)
    path = table(tmp_path / "log.csv", t=step * count, q=count)
    assert f'unit = "{unit}"  # ?\n# about {about}' in guess_columns(path)


def test_a_start_that_looks_like_a_date_in_another_unit_is_none(tmp_path: Path) -> None:
    """Uptime of half an hour in microseconds: the same number in seconds is the year 2028."""
    count = np.arange(4000)
    path = table(tmp_path / "log.csv", t=1_830_000_000 + 20_000 * count, q=count)
    assert 'unit = "us"  # ?\n# about 50 Hz' in guess_columns(path)


def test_the_clock_of_a_column_tells_its_unit_as_well(tmp_path: Path) -> None:
    slow, fast = np.arange(300), np.arange(3000)
    np.savez(
        tmp_path / "log.npz",
        t=0.02 * fast,
        u=fast,
        pose_stamp=EPOCH_S * 10**9 + 20_000_000 * slow,
        pose_x=slow,
    )
    guessed = guess_columns(tmp_path / "log.npz")
    assert 'time = "pose_stamp"\ntime_unit = "ns"' in guessed


RATES_HZ = (10, 20, 32, 50, 100, 125, 200, 250, 1000)


@pytest.mark.parametrize("rate_hz", [*RATES_HZ, 19.2, 47.6, 31.25, 62.5])
@pytest.mark.parametrize("jitter", [0.0, 0.1, 0.2])
def test_a_rate_is_the_one_that_a_person_means(
    rate_hz: float, jitter: float, tmp_path: Path
) -> None:
    """Stamps off by up to a share of the interval, each on its own, and 3 % of the samples lost."""
    draw = np.random.default_rng(7)
    t = (np.arange(600) + draw.uniform(-jitter, jitter, 600)) / rate_hz
    t = t[draw.random(600) > 0.03]
    guessed = guess_columns(table(tmp_path / "log.csv", t=t, q=np.sin(t)))
    assert f"# about {rate_hz:g} Hz, " in guessed
    assert f"\nrate_hz = {rate_hz:g}  # ? that of q" in guessed


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_a_short_log_and_stamps_whose_jitter_is_normal_have_their_rate_too(rate_hz: int) -> None:
    for seed in range(20):
        draw = np.random.default_rng(seed)
        for count, jitter in ((60, 0.1), (3000, 0.2)):
            t = np.sort(np.arange(count) + jitter * draw.standard_normal(count)) / rate_hz
            assert usual_hz(t[draw.random(count) > 0.03]) == rate_hz


def test_jitter_that_adds_up_leaves_a_rate_within_what_it_leaves_open() -> None:
    """Steps of a sleeping loop, each on its own: 19.2 Hz may be said as 19, and never as 20."""
    draw = np.random.default_rng(1)
    for _ in range(50):
        t = np.cumsum((1.0 + draw.uniform(-0.2, 0.2, 2000)) / 19.2)
        told = usual_hz(t)
        assert told is not None
        assert abs(told / 19.2 - 1.0) < 0.02


def test_bursts_come_at_the_rate_of_bursts_and_wild_stamps_at_their_median() -> None:
    bursts = np.array([0.32 * burst + 0.0005 * k for burst in range(100) for k in range(32)])
    assert usual_hz(bursts) == pytest.approx(1 / 0.3045, rel=0.01)
    wild = np.cumsum(np.random.default_rng(0).uniform(0.0, 0.02, 2000))
    assert usual_hz(wild) == pytest.approx(100.0, rel=0.1)
    assert usual_hz(np.zeros(5)) is None
    with_holes = np.concatenate([np.arange(500) / 50 + 1e4 * k * k for k in range(4)])
    assert usual_hz(with_holes) == 50.0
    assert usual_hz(np.concatenate([np.arange(500) / 50 for _ in range(4)])) == 50.0


def test_a_speed_that_its_name_says_in_other_units_is_guessed(tmp_path: Path) -> None:
    t = np.arange(100) / 50
    guessed = guess_columns(table(tmp_path / "log.csv", t=t, wind_kts=t, car_kmh=t, motor_kt=t))
    assert 'column = "wind_kts"\nrole = "unused"\nunit = "knots"' in guessed
    assert 'column = "car_kmh"\nrole = "unused"\nunit = "kmh"' in guessed
    assert 'column = "motor_kt"\nrole = "unused"\nunit = "1"' in guessed  # a motor's constant


def test_columns_that_hold_text_are_named_with_the_first_such_line(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{k / 10},{k},{k},{k},ok," for k in range(40)]
    rows[0] = "0.0,0,LATE,0,,"
    rows[7], rows[9] = "0.7,7,7,ERR,ok,", "0.9,9,9,ERR,ok,"
    path.write_text("\n".join(["t,q,once,often,note,blank", *rows]) + "\n")
    guessed = guess_columns(path)
    assert "[columns.q]" in guessed
    assert not any(f"[columns.{name}]" in guessed for name in ("once", "often", "note", "blank"))
    said = guessed.replace("\n#    ", "")
    for comment in (
        "#   once: one of 40 rows holds text, 'LATE' in line 2; mend that cell, or empty it",
        "#   often: 2 of 40 rows hold text, the first 'ERR' in line 9; mend those cells",
        "#   note: texts, as 'ok' in line 3",
        "#   blank: no number in any row",
    ):
        assert comment in said
    assert "#   t:" not in said
    read(path, guessed)


def test_a_column_with_blanks_says_that_nan_is_not_for_training(tmp_path: Path) -> None:
    t = np.arange(400) / 50
    path = table(tmp_path / "log.csv", t=t, q=np.where((t > 2) & (t < 3), np.nan, t))
    assert 'missing = "split"  # ? some have no number; "nan" for a sensor, not for training' in (
        guess_columns(path)
    )
