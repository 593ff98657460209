"""Every kind of log: what its own library wrote, or a public recording, is read to the digit."""

import builtins
import gzip
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from needs import recordings_of

from benchmarks.fuzz import logs
from benchmarks.fuzz.kind import put
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.guess_asked import Asked
from wakedeploy.domains.tables.reading import read_recordings

KINDS = {
    "csv": "numpy", "npz": "numpy", "mat": "scipy", "parquet": "pyarrow", "hdf5": "h5py",
    "mcap": "mcap", "rosbag": "rosbags", "ros-mcap": "rosbags", "ulog": "pyulog",
}  # fmt: skip


STAND = "Log_2019-11-07_175456.csv.gz"
MOTORS = "actuator_outputs"


def read(paths: Path | list[Path], text: str, **units: str) -> tuple[Recording, ...]:
    columns = parse_columns(text if "version" in text else f"version = 1\n{text}")
    several = paths if isinstance(paths, list) else [paths]
    return read_recordings(several, columns, units).recordings


def column(name: str, address: str, unit: str = "1", **more: str) -> str:
    extra = "".join(f"{key} = {value}\n" for key, value in more.items())
    told = f'column = "{address}"\nrole = "output"\nunit = "{unit}"\n'
    return f"[columns.{name}]\n{told}{extra}"


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("boot_us", 123_456.0 + 2e4 * np.arange(50), ('column = "boot_us"', 'unit = "us"')),
        ("minutes", np.arange(50) / 3000.0, ('column = "minutes"', 'unit = "min"')),
        ("odometer", np.cumsum(np.random.default_rng(0).random(50)), ("rate_hz = 0",)),
        ("n", np.arange(50.0), ("rate_hz = 0",)),  # counts samples
    ],
)
def test_a_clock_is_known_by_its_even_rise(name, values, said, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = np.column_stack([np.sin(values), values])
    np.savetxt(path, rows, "%.7f", ",", header=f"u,{name}", comments="")
    guessed = guess_columns(path)
    assert all(each in guessed for each in said)


def test_dates_of_numpy_are_a_clock_and_a_nan_that_signals_is_a_nan(tmp_path: Path) -> None:
    signalling = np.frombuffer(np.uint32(0x7F800001).tobytes(), np.float32)
    samples = np.r_[signalling, np.sin(np.arange(49.0)).astype(np.float32)]
    dates = np.datetime64("2026-01-01") + np.arange(50) * np.timedelta64(20_000, "us")
    path = tmp_path / "log.npz"
    np.savez(path, time=dates, u=samples)
    guessed = guess_columns(path)
    assert 'column = "time"\n# about 50 Hz' in guessed
    (log,) = read(path, guessed.replace('role = "unused"', 'role = "output"'))
    assert log.rate_hz == pytest.approx(50.0)


@pytest.mark.parametrize(
    ("kind", "step_ms"),
    [("s", 1000), ("ms", 20), ("us", 20), ("ns", 20)],
)
@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Berlin"])
def test_dates_of_parquet_are_a_clock_in_whatever_they_count(
    kind: str, step_ms: int, zone: str | None, tmp_path: Path
) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    when = pandas.date_range("2026-03-01", periods=200, freq=f"{step_ms}ms", tz=zone, unit=kind)
    path = tmp_path / "log.parquet"
    pandas.DataFrame({"when": when, "q": np.sin(np.arange(200))}).to_parquet(path)
    guessed = guess_columns(path)
    assert 'column = "when"' in guessed
    assert "no unit is needed" in guessed
    (one,) = read(path, guessed.replace('role = "unused"', 'role = "output"'))
    assert one.rate_hz == pytest.approx(1000.0 / step_ms)
    assert np.array_equal(one.columns["q"], np.sin(np.arange(200)))


def test_texts_and_missing_dates_of_parquet(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    when = pandas.date_range("2026-03-01", periods=200, freq="20ms", tz="UTC")
    path = tmp_path / "log.parquet"
    table = pandas.DataFrame({"when": [w.isoformat() for w in when], "q": np.arange(200.0)})
    table.to_parquet(path)
    guessed = guess_columns(path)
    assert 'column = "when"\nformat = "iso"' in guessed
    (one,) = read(path, guessed.replace('role = "unused"', 'role = "output"'))
    assert one.rate_hz == pytest.approx(50.0)
    table.to_csv(tmp_path / "log.csv", index=False)
    (other,) = read(tmp_path / "log.csv", '[time]\ncolumn = "when"\nformat = "iso"\n'
                    + column("q", "q"))  # fmt: skip
    assert np.array_equal(one.time_s, other.time_s)
    with pytest.raises(UnusableInput, match="'when' does not hold real numbers"):
        read(path, "[time]\nrate_hz = 50\n" + column("q", "when"))
    dates = table.assign(when=when.where(np.arange(200) != 7))
    dates.to_parquet(path)
    with pytest.raises(UnusableInput, match="column 'when' has no stamp in row 7"):
        read(path, '[time]\ncolumn = "when"\n' + column("q", "q"))
    with pytest.raises(UnusableInput, match="column 'when' holds dates"):
        read(path, "[time]\nrate_hz = 50\n" + column("q", "when"))


@pytest.mark.parametrize("kind", KINDS)
def test_what_its_library_wrote_is_read_to_the_digit(kind: str, tmp_path: Path) -> None:
    pytest.importorskip(KINDS[kind])
    made = logs.motion()
    put(tmp_path, logs.written(kind, made))
    for path in sorted(tmp_path.iterdir()):
        (one,) = read(path, logs.columns_of(kind))
        exact = np.float32(made["u"]) if kind == "ulog" else made["u"]  # PX4 logs single precision
        assert np.array_equal(one.columns["u"], exact)
        np.testing.assert_allclose(one.columns["q"], np.deg2rad(made["q"][:, 1]), rtol=1e-15)
        np.testing.assert_allclose(np.diff(one.time_s), 0.01, rtol=1e-9)
        assert one.rate_hz == pytest.approx(100.0, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_guess_runs_once_columns_have_a_role(kind: str, tmp_path: Path) -> None:
    pytest.importorskip(KINDS[kind])
    put(tmp_path, logs.written(kind, logs.motion()))
    path = sorted(tmp_path.iterdir())[0]
    guessed = guess_columns(path)
    with pytest.raises(UnusableInput, match="no column has a role yet"):
        parse_columns(guessed)
    (one,) = read(path, guessed.replace('role = "unused"', 'role = "output"'))
    assert len(one.columns) >= 3
    assert one.rate_hz == pytest.approx(100.0, rel=1e-6)


@pytest.mark.parametrize(
    ("kind", "module", "extra"),
    [("hdf5", "h5py", "hdf5"), ("rosbag", "rosbags", "rosbag"), ("ulog", "pyulog", "ulog"),
     ("parquet", "pyarrow", "tables")],
)  # fmt: skip
def test_a_library_that_is_absent_is_named_with_its_extra(
    kind: str, module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip(KINDS[kind])
    put(tmp_path, logs.written(kind, logs.motion()))
    ordinary = builtins.__import__
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)

    def absent(name: str) -> Any:
        if name.partition(".")[0] == module:
            raise ImportError(name)
        return ordinary(name)

    with monkeypatch.context() as patch:
        patch.setattr(
            "wakedeploy.domains.tables.log.importlib.import_module",
            lambda name: absent(name) if name.startswith(module) else imported(name),
        )
        with pytest.raises(UnusableInput, match=rf"needs {module}: .*\[{extra}\]"):
            read(sorted(tmp_path.iterdir())[0], logs.columns_of(kind))


def imported(name: str) -> Any:
    return __import__(name, fromlist=["_"])


@pytest.mark.parametrize("in_hdf5", [False, True])
def test_a_struct_of_matlab_is_columns_in_every_version(in_hdf5: bool, tmp_path: Path) -> None:
    t, path = np.arange(50) / 10, tmp_path / "log.mat"
    if in_hdf5:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            file["log/t"], file["log/arm/x"] = t[None], np.sin(t)[None]
    else:
        runs = np.array([(1.0,), (3.0,)], [("x", object)])
        log = {"t": t, "arm": {"x": np.sin(t)}, "runs": runs}
        pytest.importorskip("scipy.io").savemat(path, {"log": log, "gain": 2.0})
    guessed = guess_columns(path)
    assert '[time]\ncolumn = "log/t"' in guessed
    assert 'column = "log/arm/x"' in guessed
    assert ("# Not listed: log/runs is a struct array of 1 x 2; in MATLAB: " in guessed) != in_hdf5
    (one,) = read(path, guessed.replace('"unused"', '"output"'))
    assert np.array_equal(one.columns["log_arm_x"], np.sin(t))
    if not in_hdf5:
        with pytest.raises(UnusableInput, match=r"'log/runs' is a struct array .* save log"):
            read(path, '[time]\ncolumn = "log/t"\n' + column("x", "log/runs/x"))
        with pytest.raises(UnusableInput, match=r"'log\.arm\.x' is not there; it has 'log/arm/x'"):
            read(path, '[time]\ncolumn = "log/t"\n' + column("x", "log.arm.x"))


def test_a_file_that_has_nothing_but_objects_of_matlab_is_refused_with_what_helps(
    tmp_path: Path,
) -> None:
    runs = np.array([(1.0,), (3.0,)], [("x", object)])
    pytest.importorskip("scipy.io").savemat(tmp_path / "log.mat", {"runs": runs})
    with pytest.raises(UnusableInput, match=r"no column of numbers: runs is a struct array .*save"):
        guess_columns(tmp_path / "log.mat")


def test_matlab_7_3_is_read_by_its_hdf5(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    made, path = logs.motion(), tmp_path / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:  # MATLAB writes arrays the other way
        file["t"], file["u"], file["q"] = made["t"][None], made["u"][None], made["q"].T
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(512))
    (one,) = read(path, logs.columns_of("mat"))
    assert np.array_equal(one.columns["u"], made["u"])
    np.testing.assert_allclose(one.columns["q"], np.deg2rad(made["q"][:, 1]), rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "stated"),
    [
        ("t;u\n0,0;1,5\n0,1;2,5\n0,2;-3\n", 'delimiter = ";"'),
        ("t\tu\n0\t1,5\n0,1\t2,5\n0,2\t-3\n", 'delimiter = "\\t"'),
        ("t u\n0,0 1,5\n1e-1 2,5\n,2 -3\n", 'delimiter = " "'),
        ('"t","u"\n"0,0","1,5"\n"0,1","2,5"\n"0,2","-3"\n', 'delimiter = ","'),
        ("% a;b\nt;u\n0,0;1,5\n% no\n0,1;2,5\n0,2;-3\n", 'delimiter = ";"'),
        ("t;u\n0.0;1.5\n0.1;2.5\n0.2;-3\n", ""),
        ("t;n;u\n0.0;1,2;1.5\n0.1;3,4;2.5\n0.2;5,6;-3\n", ""),  # where a point is the decimals'
    ],
)
def test_a_guess_reads_decimal_commas(text: str, stated: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text, "utf-8")
    guessed = guess_columns(path)
    assert ('decimal = ","' in guessed) == bool(stated)
    assert stated in guessed
    (one,) = read(path, guessed.replace('"unused"', '"output"'))
    assert one.columns["u"].tolist() == [1.5, 2.5, -3.0]
    assert one.rate_hz == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("text", "csv"),
    [
        ("t;u\n0,0;1,5\n0,1;2,5\n0,2;-3\n", 'decimal = ","'),
        ("t\tu\n0.0\t1.5\n0.1\t2.5\n0.2\t-3\n", ""),
        ("t u\n0.0   1.5\n0.1 2.5\n0.2 -3\n", ""),
        ("# by the logger\nt,u\ns,V\n0.0,1.5\n0.1,2.5\n0.2,-3\n",
         'comment = "#"\nunits_row = true'),
        ("# recorded by me, on Monday\nt,u\n0.0,1.5\n0.1,2.5\n0.2,-3\n", ""),
        ("# recorded by me\n#\n# t,u\n0.0,1.5\n0.1,2.5\n0.2,-3\n", ""),
        ("# t u\n0.0 1.5\n0.1 2.5\n0.2 -3\n", ""),  # as numpy.savetxt does
        ("#t;u\n0,0;1,5\n0,1;2,5\n0,2;-3\n", 'decimal = ","'),
        ("% t,u\n0.0,1.5\n% a pause\n0.1,2.5\n0.2,-3\n", 'comment = "%"'),
        ("#a\nlogger\n# b,c\nt,u\n0.0,1.5\n0.1,2.5\n0.2,-3\n", "skip_rows = 2"),
        ("Logger 7\nrun 3\nt, u\n0.0, 1.5\n0.1, 2.5\n0.2, -3\n", "skip_rows = 2"),
        ("\ufefft,u\r\n0.0,1.5\r\n\r\n0.1,2.5\r\n0.2,-3", ""),
        ("t,u\n0.0,1.5\n0.1,2.5\n0.2,-3\n0.3", ""),  # cut off while it was written
    ],
)  # fmt: skip
def test_tables_of_text_as_people_write_them(text: str, csv: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text, "utf-8", newline="")
    (one,) = read(path, f'[time]\ncolumn = "t"\n[csv]\n{csv}\n' + column("u", "u"))
    assert one.columns["u"].tolist() == [1.5, 2.5, -3.0]
    np.testing.assert_allclose(one.time_s, [0.0, 0.1, 0.2], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "comment"),
    [
        ("t_us,cmd,depth\n{}", None),
        ("# recorded by me\nt_us,cmd,depth\n{}", None),
        ("# t_us,cmd,depth\n{}", None),
        ("# by me\nt_us,cmd,depth\n{}# the end\n", "#"),
        ("t_us,cmd,depth\n# a pause\n{}", "#"),
        ("% t_us,cmd,depth\n{}", "%"),
        ("% by me\nt_us,cmd,depth\n{}% the end\n", "%"),
        ("\n// by me\nt_us,cmd,depth\n{}", "//"),
    ],
)
@pytest.mark.parametrize("is_folder", [False, True])
def test_a_guess_passes_over_comments_and_takes_a_header_that_is_one(
    text: str, comment: str | None, is_folder: bool, tmp_path: Path
) -> None:
    path = tmp_path / "logs" / "log.csv"
    path.parent.mkdir()
    rows = "".join(f"{20_000 * k},{k % 3},{0.1 * k}\n" for k in range(50))
    path.write_text(text.format(rows), "utf-8")
    path = path.parent if is_folder else path
    guessed = guess_columns(path)
    assert ("[csv]" in guessed) == (comment is not None)
    if comment is not None:
        assert f'[csv]\ncomment = "{comment}"' in guessed
    assert 'column = "t_us"\nunit = "us"' in guessed
    (one,) = read(path, guessed.replace('role = "unused"', 'role = "output"'))
    assert one.rate_hz == pytest.approx(50.0)
    assert np.array_equal(one.columns["depth"], [0.1 * k for k in range(50)])


def test_topics_of_ros_before_jazzy_and_other_encodings_are_refused_when_they_are_asked_for(
    tmp_path: Path,
) -> None:
    from mcap.writer import Writer

    with (tmp_path / "log.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, encoding in (("/a", "json"), ("/b", "protobuf")):
            channel = writer.register_channel(topic, encoding, 0)
            for k in range(3):
                writer.add_message(channel, k * 10**7, b'{"x": 1.5}', k * 10**7)
        writer.finish()
    (one,) = read(tmp_path / "log.mcap", column("x", "/a.x"))
    assert one.columns["x"].tolist() == [1.5, 1.5, 1.5]
    with pytest.raises(UnusableInput, match="messages of /b are written as 'protobuf'"):
        read(tmp_path / "log.mcap", column("x", "/b.x"))


def test_a_definition_in_a_recording_is_data_and_never_a_program(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from mcap.writer import Writer

    mark = tmp_path / "owned"
    forged = (
        ("x/msg/Y:\n    open('" + str(mark) + "', 'w')\n#", b"float64 x\n"),
        ('x/msg/Y"""\n    pass\nopen("' + str(mark) + '", "w")\n"""', b"float64 x\n"),
        ("x/msg/Y", b"float64 x = __import__('os').system('touch " + str(mark).encode() + b"')\n"),
        ("x/msg/Y", b"float64 x\nopen('" + str(mark).encode() + b"','w') z\n"),
    )
    for name, definition in forged:
        with (tmp_path / "log.mcap").open("wb") as file:
            writer = Writer(file)
            writer.start()
            schema = writer.register_schema(name, "ros2msg", definition)
            channel = writer.register_channel("/a", "cdr", schema)
            writer.add_message(channel, 0, bytes(12), 0)
            writer.add_message(channel, 10**7, bytes(12), 10**7)
            writer.finish()
        with pytest.raises(UnusableInput, match=r"log\.mcap"):
            read(tmp_path / "log.mcap", column("x", "/a.x"))
        assert not mark.exists()


# --- public recordings


def test_the_positioning_axis_and_others_of_matlab_are_scipys_numbers() -> None:
    from scipy.io import loadmat

    path = recordings_of("emps") / "DATA_EMPS.mat"
    mat = loadmat(path)
    text = '[time]\ncolumn = "t"\n' + column("u", "vir", "V") + column("q", "qm", "m", to='"mm"')
    (one,) = read(path, text)
    assert np.array_equal(one.columns["u"], mat["vir"].ravel())
    np.testing.assert_allclose(one.columns["q"], 1000 * mat["qm"].ravel(), rtol=1e-15)
    assert np.abs(one.time_s - mat["t"].ravel()).max() < 5e-6  # its jitter
    for folder, name, time in (
        ("pick-and-place", "u", 'column = "t"'), ("coupled-drives", "u1", "rate_hz = 50"),
    ):  # fmt: skip
        (path,) = recordings_of(folder).glob("*.mat")
        (one,) = read(path, f"[time]\n{time}\n" + column("u", name, "V"))
        assert np.array_equal(one.columns["u"], loadmat(path)[name].ravel())


def test_text_recordings_are_numpys_numbers() -> None:
    path = recordings_of("cascaded-tanks") / "dataBenchmark_est.csv"
    (one,) = read(path, "[time]\nrate_hz = 0.25\n" + column("h", "yEst", "V"))
    there = np.genfromtxt(path, delimiter=",", skip_header=1)
    assert np.array_equal(one.columns["h"], there[:, 1])
    (path,) = recordings_of("silverbox").glob("*.csv.gz")
    (one,) = read(path, "[time]\nrate_hz = 610.35\n" + column("y", "V2", "V"))
    with gzip.open(path, "rt") as file:
        assert np.array_equal(one.columns["y"], np.loadtxt(file, delimiter=",", skiprows=1)[:, 1])


def test_both_layouts_of_the_arm_are_the_same_motion() -> None:
    arm = recordings_of("so101")
    npz = '[time]\ncolumn = "state_timestamp"\n' + "".join(
        column(f"{kind}{i}", f"{name}_positions[{i}]", "rad")
        for i in range(6) for kind, name in (("u", "control"), ("q", "state"))
    )  # fmt: skip
    text = '[time]\ncolumn = "timestamp"\nunit = "us"\n' + "".join(
        column(f"{kind}{i}", f"positions[{i}]", "rad", file=f'"{name}.csv"')
        for i in range(6) for kind, name in (("u", "control"), ("q", "state_motor"))
    )  # fmt: skip
    (one,) = read(arm / "wave_motion.npz", npz)
    (other,) = read(arm / "original_layout" / "wave_motion", text)
    for name, values in one.columns.items():
        assert np.array_equal(values, np.float32(other.columns[name]))
    assert np.abs(one.time_s - other.time_s).max() < 1e-6
    assert one.rate_hz == pytest.approx(49.85, abs=0.01)


def test_pendulums_with_a_nameless_column_and_with_blanks_in_the_header() -> None:
    path = recordings_of("pendulum") / "filter_method_fft.csv.gz"
    (one,) = read(path, '[time]\ncolumn = "time"\n' + column("i", "#1") + column("q", "pos", "rad"))
    assert one.columns["i"].tolist() == list(range(10_000))
    path = recordings_of("double-pendulum") / "A0_sys_id_friccomp_063536.csv.gz"
    resampled = '[time]\ncolumn = "time"\n[resample]\nrate_hz = 200\n' + column("q", "pos1", "rad")
    reading = read_recordings([path], parse_columns("version = 1\n" + resampled))
    assert "1 stamp was there twice; the last row of each was kept" in reading.notes[0]
    with pytest.raises(UnusableInput, match=r"steps by 0.003661 s at line 4.*\[resample\]"):
        read(path, resampled.replace("[resample]\nrate_hz = 200\n", ""))


def test_two_crazyflies_in_one_file() -> None:
    path = recordings_of("crazyflie") / "swap_ss_00.npz"
    (one,) = read(path, '[time]\ncolumn = "t"\n' + column("z", "b_pos[2]", "m"))
    with np.load(path) as arrays:
        assert np.array_equal(one.columns["z"], arrays["b_pos"][:, 2].astype(float))
    with pytest.raises(UnusableInput, match=r"holds \(3,\) numbers a sample; .*up to b_pos\[2\]"):
        read(path, '[time]\ncolumn = "t"\n' + column("z", "b_pos", "m"))


@pytest.mark.parametrize("name", ["sample_log_small", "sample_px4_events"])
def test_flights_of_px4_at_one_rate(name: str) -> None:
    pyulog = pytest.importorskip("pyulog")
    path = recordings_of("ulog") / f"{name}.ulg"
    text = "[resample]\nrate_hz = 50\n[split]\ngap_s = 0.5\n"
    text += column("w", "sensor_combined.gyro_rad[0]", "rad/s")
    text += column("motor", "actuator_outputs[0].output[1]", "us", to='"us"')
    (one,) = read(path, text)
    log = pyulog.ULog(str(path))
    first = min(log.get_dataset(n, 0).data["timestamp"][0] for n in ("sensor_combined", MOTORS))
    start = first // 10**6 * 10**6 if first > 10**12 else 0  # a simulated board counts from 1970
    for column_name, topic, field in (
        ("w", "sensor_combined", "gyro_rad[0]"), ("motor", MOTORS, "output[1]"),
    ):  # fmt: skip
        data = log.get_dataset(topic, 0).data
        stamps = data["timestamp"] - start
        ticks_us = [round(t * 1e6) for t in one.time_s]
        since_us = [ticks_us[0] - 20_000, *ticks_us]
        came = [
            stamps[(stamps > a) & (stamps <= b)] for a, b in zip(since_us, ticks_us, strict=False)
        ]
        value = dict(zip(stamps.tolist(), data[field].tolist(), strict=True))
        expected = np.array([value[new[-1]] if len(new) else math.nan for new in came])
        assert np.array_equal(one.columns[column_name], expected, equal_nan=True)
    assert one.rate_hz == pytest.approx(50.0)


@pytest.mark.whole
def test_motor_stands_with_dates_and_with_columns_of_their_own_pace() -> None:
    motor = recordings_of("motor")
    dates = '[time]\ncolumn = "Timestamp"\nformat = "%Y-%m-%d %H:%M:%S:%f"\n'
    dates += "[resample]\nrate_hz = 100\n" + column("w", "RPM", "rpm")
    (one,) = read(motor / "f40_steps_5-2.csv.gz", dates)
    assert one.time_s[0] == pytest.approx(0.947)  # after the first whole second
    assert np.nanmax(one.columns["w"]) == pytest.approx(16050 * math.pi / 30, rel=0.01)
    with gzip.open(motor / "f40_steps_5-2.csv.gz", "rt") as file:
        ms = [int(row.split(",")[0][17:19]) * 1000 + int(row.split(",")[0][20:]) for row in
              file.read().splitlines()[1:]]  # fmt: skip
    since_ms = np.unwrap(ms, period=60_000) - ms[0]
    came = {int(-(-since // 10)) for since in since_ms}  # a tick is every 10 ms
    measured = np.flatnonzero(np.isfinite(one.columns["w"]))
    assert came.issuperset(measured.tolist())
    assert len(measured) == sum(tick < len(one.time_s) for tick in came)
    stand = '[time]\ncolumn = "Time (s)"\nfalling = "sort"\n[resample]\nrate_hz = 100\n'
    with pytest.raises(UnusableInput, match=r"'ESC signal .µs.' has no number in any row"):
        read(motor / STAND, stand + column("pulse", "ESC signal (µs)", "µs", missing='"hold"'))
    stand += column("w", "Motor Optical Speed (RPM)", "rpm", missing='"hold"')
    stand += column("thrust", "Thrust (gf)", "gf", missing='"hold"')
    (one,) = read(motor / STAND, stand)
    assert one.rate_hz == pytest.approx(100.0)
    assert np.nanmax(one.columns["thrust"]) == pytest.approx(861.8 * 9.80665e-3, rel=1e-3)


@pytest.mark.parametrize(
    ("is_there", "says"),
    [
        (lambda k: k % 2 == 0, "hold"),  # of a clock half as fast
        (lambda k: k % 3 != 0, "hold"),
        (lambda k: not 100 <= k < 130, "split"),  # lost for a while
        (lambda k: k != 77, "split"),
    ],
)
def test_a_guess_tells_a_slower_clock_from_samples_that_are_lost(is_there, says, tmp_path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{k / 100},{k if is_there(k) else ''}" for k in range(300)]
    path.write_text("\n".join(["time_s,w_rad", *rows]) + "\n")
    assert f'missing = "{says}"' in guess_columns(path)


@pytest.mark.parametrize(
    ("text", "form", "advice"),
    [
        ("t;u\n0,0;1,5\n0,1;1,5\n", "", r'\[csv\] decimal = "," and delimiter = ";" in'),
        ("t\tu\n0,0\t1,5\n0,1\t1,5\n", "", r'decimal = "," and delimiter = "\\t" in'),
        ("t,u\n0.0,1.5\n0.1,1.5\n", '[csv]\ndelimiter = ";"\n',
         r"header is one name, 't,u'; write \[csv\] delimiter = \",\" in"),
        ("t,u\n0.0,x\n0.1,1.5\n", "", "which is no number; mend it, or leave the column out"),
        ("t,u\n0.0,hover\n0.1,track\n", "", "or write a column of 0 and 1 for each such word"),
    ],
)  # fmt: skip
def test_a_table_written_otherwise_is_refused_with_what_to_write(
    text: str, form: str, advice: str, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    columns = 'version = 1\n[time]\ncolumn = "t"\n[columns.u]\ncolumn = "u"\nrole = "output"\n'
    with pytest.raises(UnusableInput, match=advice):
        read_recordings([path], parse_columns(f'{columns}unit = "1"\n{form}'))


@pytest.mark.parametrize("ending", ["h5", "npz"])
def test_a_table_whose_rows_hold_several_columns_is_read_field_by_field(
    ending: str, tmp_path: Path
) -> None:
    """A compound dataset, as PyTables writes it, and a structured array of NumPy."""
    path = tmp_path / f"log.{ending}"
    table = np.zeros(60, dtype=[("t", "f8"), ("q", "f4", 2), ("note", "S3")])
    table["t"], table["q"] = np.arange(60) / 20.0, np.random.default_rng(1).normal(size=(60, 2))
    if ending == "npz":
        np.savez(path, log=table)
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            file["run/log"] = table
    guessed = guess_columns(path)
    name = "log" if ending == "npz" else "run/log"
    assert f'column = "{name}.t"' in guessed
    columns = parse_columns(guessed.replace('"unused"', '"output"'))
    (recording,) = read_recordings([path], columns).recordings
    assert recording.time_s == pytest.approx(table["t"])
    assert np.column_stack(list(recording.columns.values())) == pytest.approx(table["q"])


def test_objects_of_python_in_an_archive_are_named_and_the_columns_beside_them_are_read(
    tmp_path: Path,
) -> None:
    """As np.savez writes a dict of settings, or a column with None in it."""
    t = np.arange(200) / 50.0
    held = {"t": t, "q": np.sin(t), "config": np.array({"gain": 2.0}), "u": np.array([None, 1.0])}
    for name in ("a.npz", "b.npz"):
        np.savez(tmp_path / name, **held)
    guessed = guess_columns(tmp_path)
    for name in ("config", "u"):
        assert f"# Not listed: {name} holds pickled objects of Python, which are not" in guessed
    (recording,) = read(tmp_path / "a.npz", guessed.replace('"unused"', '"output"'))
    np.testing.assert_allclose(recording.columns["q"], np.sin(t))
    with pytest.raises(UnusableInput, match=r"column 'config' holds pickled objects .* save it as"):
        read(tmp_path / "a.npz", guessed + column("config", "config"))


def test_a_folder_whose_logs_cannot_be_read_tells_of_the_first(tmp_path: Path) -> None:
    (tmp_path / "notes.md").write_text("# none", "utf-8")
    with pytest.raises(UnusableInput, match="no log in a known format"):
        guess_columns(tmp_path)
    for name in ("b.npz", "a.npz"):
        (tmp_path / name).write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(UnusableInput, match=r"a\.npz: cannot be read \(damaged"):
        guess_columns(tmp_path)


def test_durations_of_parquet_are_seconds(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    path = tmp_path / "log.parquet"
    elapsed = pandas.to_timedelta(np.arange(200) * 20, unit="ms")
    pandas.DataFrame({"elapsed": elapsed, "q": np.sin(np.arange(200))}).to_parquet(path)
    guessed = guess_columns(path)
    assert 'column = "elapsed"' in guessed
    columns = parse_columns(guessed.replace('"unused"', '"output"'))
    (recording,) = read_recordings([path], columns).recordings
    assert recording.time_s == pytest.approx(np.arange(200) * 0.02)


def _lerobot(root: Path, names: object) -> Path:
    """Two episodes of a set of LeRobot, whose vectors have such names."""
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    chunk = root / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    (root / "meta").mkdir()
    features = {key: {"names": names} for key in ("action", "observation.state")}
    (root / "meta" / "info.json").write_text(json.dumps({"fps": 50, "features": features}))
    (root / "README.md").write_text("# Two episodes, 50 Hz\n")
    for episode in range(2):
        k = np.arange(200)
        columns = {"action": np.c_[k, k + 1.0], "observation.state": np.c_[-k, -k - 1.0]}
        made = {name: list(values) for name, values in columns.items()} | {"timestamp": k / 50.0}
        parquet.write_table(arrow.table(made), chunk / f"episode_{episode:06d}.parquet")
    return chunk


@pytest.mark.parametrize(
    ("names", "is_found"),
    [
        (["hip.pos", "knee.pos"], True),
        ({"motors": ["hip", "knee"]}, True),
        (["hip", "knee", "ankle"], False),
        (None, False),
        ([1, 2], False),
        ({}, False),
    ],
)
def test_joints_of_a_set_of_lerobot_are_known_by_their_names(
    names: object, is_found: bool, tmp_path: Path
) -> None:
    chunk = _lerobot(tmp_path / "leg", names)
    asked = [Asked("knee_target_rad", "input", "rad"), Asked("knee_rad", "output", "rad")]
    guessed = guess_columns(chunk / "episode_000001.parquet", asked)
    assert ('role = "output"\n' in guessed) == is_found
    if not is_found:
        return
    (read,) = read_recordings([chunk / "episode_000001.parquet"], parse_columns(guessed)).recordings
    assert read.columns["knee_target_rad"].tolist() == (np.arange(200) + 1.0).tolist()
    assert read.columns["knee_rad"].tolist() == (-np.arange(200) - 1.0).tolist()


def test_a_folder_whose_logs_lie_deeper_is_told_where(tmp_path: Path) -> None:
    """It was told that it has no row below its header, which was the README's."""
    chunk = _lerobot(tmp_path / "leg", None)
    told = rf"its logs lie in {chunk}; give these files, as {chunk}/\*\.parquet\.$"
    for folder in (tmp_path, tmp_path / "leg", tmp_path / "leg" / "data"):
        with pytest.raises(UnusableInput, match=told):
            guess_columns(folder)
        text = 'version = 1\n[columns.q]\ncolumn = "q"\nrole = "output"\nunit = "rad"\n'
        with pytest.raises(UnusableInput, match=told):
            read_recordings([folder], parse_columns(text))
