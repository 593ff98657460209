"""Run logs keep what was recorded: through both formats, a kill, a cut and a corruption."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from wakedeploy.core.errors import UnusableInput, WakedeployError
from wakedeploy.core.runlog import RunLog, read_run_log
from wakedeploy.core.runlog_columns import COLUMN, COLUMNS, MODES, TOPICS
from wakedeploy.core.runlog_mcap import RunLogWriter
from wakedeploy.core.runlog_messages import message_schema

METADATA = {"rate_hz": "32.0", "seed": "7", "started_utc": "2026-01-02T03:04:05+00:00"}
REQUIRED = [column.name for column in COLUMNS if column.presence == "required"]


def tick_row(tick: int, **values: object) -> dict[str, object]:
    row = {
        "tick": tick,
        "t_s": tick / 32,
        "range_m": 0.5 + 0.001 * tick,
        "range_age_s": 0.009,
        "steps": 10 * tick,
        "source_cmd_us": 1500.0,
        "sufferer_cmd_us": 1700.25,
        "mode": "RUNNING",
        "faults": "",
    }
    return row | values


def some_log(ticks: int = 100, **values: object) -> RunLog:
    return RunLog.from_rows([tick_row(n, **values) for n in range(ticks)], METADATA)


def assert_same(a: RunLog, b: RunLog) -> None:
    assert a.columns.keys() == b.columns.keys()
    for name in a.columns:
        np.testing.assert_array_equal(a[name], b[name], err_msg=name)
    assert a.metadata == b.metadata


@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
def test_a_log_comes_back_as_it_was_written(tmp_path: Path, suffix: str) -> None:
    rows = [tick_row(n, battery_v=11.1, faults="overrun+outlier") for n in range(50)]
    rows[3] |= {"range_m": None, "battery_v": float("nan"), "mode": "DEGRADED"}
    log = RunLog.from_rows(rows, METADATA)
    path = tmp_path / f"flight{suffix}"
    (log.write_csv if suffix == ".csv" else log.write_mcap)(path)
    back = read_run_log(path)
    assert_same(back, log)
    assert np.isnan(back["range_m"][3])
    assert "true_wake_force_n" not in back


number = st.one_of(st.none(), st.floats(-1e12, 1e12))
integer = st.one_of(st.none(), st.integers(-(2**40), 2**40))


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_any_values_survive_both_formats(tmp_path: Path, data: st.DataObject) -> None:
    rows = []
    for tick in range(data.draw(st.integers(0, 5))):
        row = {c.name: data.draw(integer if c.kind == "integer" else number) for c in COLUMNS}
        text = st.text(st.characters(codec="utf-8", exclude_characters="\r\n\0"), max_size=5)
        faults = data.draw(text).strip()
        mode = data.draw(st.sampled_from(MODES))
        rows.append(row | {"tick": tick, "t_s": tick * 0.03, "mode": mode, "faults": faults})
    log = RunLog.from_rows(rows, METADATA)
    log.write_csv(tmp_path / "a.csv")
    log.write_mcap(tmp_path / "a.mcap")
    assert_same(read_run_log(tmp_path / "a.csv"), log)
    if rows:
        assert_same(read_run_log(tmp_path / "a.mcap"), log)


def test_viewers_find_a_topic_for_each_group_and_plain_numbers_in_it(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    some_log(3, range_m=None, battery_v=11.1, homed=1).write_mcap(path)
    with path.open("rb") as handle:
        reader = make_reader(handle)
        summary = reader.get_summary()
        seen = list(reader.iter_messages())
    assert {channel.topic for channel in summary.channels.values()} == set(TOPICS)
    assert all(channel.schema_id in summary.schemas for channel in summary.channels.values())
    told: dict[int, dict[str, object]] = {0: {}, 1: {}, 2: {}}
    for schema, channel, message in seen:
        assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
        described = json.loads(schema.data)
        assert described == message_schema(channel.topic)
        assert all(isinstance(kind["type"], str) for kind in described["properties"].values())
        values = json.loads(message.data)
        jsonschema.validate(values, described)
        assert set(values) <= set(TOPICS[channel.topic])
        told[message.sequence] |= values
        assert message.log_time == seen[0][2].log_time + message.sequence * 31_250_000
    row = tick_row(2, battery_v=11.1, homed=1)
    assert told[2] == {name: value for name, value in row.items() if name != "range_m"}


def test_every_column_has_one_topic() -> None:
    assert sorted(name for names in TOPICS.values() for name in names) == sorted(COLUMN)


def test_a_log_with_one_message_a_tick_is_still_read(tmp_path: Path) -> None:
    path, log = tmp_path / "old.mcap", some_log(20, battery_v=11.1)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata("wakedeploy.run", {"schema": "1"} | METADATA)
        schema = writer.register_schema("wakedeploy.run", "jsonschema", b"{}")
        channel = writer.register_channel("/run", "json", schema)
        for row in log.rows():
            writer.add_message(channel, 0, json.dumps(row).encode(), 0)
        writer.add_metadata("wakedeploy.end", {"written": "20"})
        writer.finish()
    back = read_run_log(path)
    assert back.metadata.pop("written") == "20"
    assert_same(back, log)


def test_a_tick_that_is_not_whole_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    writer = RunLogWriter(path, METADATA)
    for tick in range(3):
        writer.write(tick_row(tick), tick * 31_250_000)
    writer._writer.add_message(writer._channels["/height"], 0, b'{"range_m":0.5}', 0, 3)
    writer.flush()
    writer.abandon()
    assert list(read_run_log(path)["tick"]) == [0, 1, 2]


def test_same_log_same_bytes(tmp_path: Path) -> None:
    some_log().write_mcap(tmp_path / "a.mcap")
    some_log().write_mcap(tmp_path / "b.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_a_killed_process_leaves_what_it_had_flushed(tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    script = f"""
        import sys, time
        from pathlib import Path
        from wakedeploy.core.runlog_mcap import RunLogWriter
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        from test_runlog import METADATA, tick_row
        writer = RunLogWriter(Path({str(path)!r}), METADATA)
        for tick in range(200):
            writer.write(tick_row(tick), tick * 31_250_000)
        print("written", flush=True)
        time.sleep(600)
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "written"
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    log = read_run_log(path)
    assert 200 - 32 <= len(log) <= 200  # at most the last second is gone
    np.testing.assert_array_equal(log["tick"], np.arange(len(log)))
    assert "unfinished" in log.metadata
    assert log.metadata["seed"] == "7"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "a.mcap"
    some_log(120).write_mcap(path)
    return path.read_bytes()


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(share=st.floats(0, 0.999), tail=st.binary(max_size=40))
def test_a_cut_file_is_read_as_far_as_it_goes(
    tmp_path: Path, whole: bytes, share: float, tail: bytes
) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: int(share * len(whole))] + tail)
    try:
        log = read_run_log(path)
    except UnusableInput:
        return
    np.testing.assert_array_equal(log["tick"], np.arange(len(log)))
    assert "unfinished" in log.metadata or len(log) == 120


def test_half_a_file_keeps_its_first_half(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "half.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    assert len(read_run_log(path)) >= 16


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(share=st.floats(0, 0.999), flip=st.integers(1, 255))
def test_a_flipped_byte_is_refused_or_harmless(
    tmp_path: Path, whole: bytes, share: float, flip: int
) -> None:
    damaged = bytearray(whole)
    damaged[int(share * len(whole))] ^= flip
    path = tmp_path / "flipped.mcap"
    path.write_bytes(bytes(damaged))
    try:
        log = read_run_log(path)
    except UnusableInput:
        return
    np.testing.assert_array_equal(log["range_m"], some_log(len(log))["range_m"])


def test_a_file_that_is_cut_before_its_first_tick_says_so(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "cut.mcap"
    for length in (8, 20, 60):
        path.write_bytes(whole[:length])
        with pytest.raises(UnusableInput, match=r"cut\.mcap: is cut or damaged before its first"):
            read_run_log(path)


def test_the_mcap_file_of_another_program_is_none_of_ours(tmp_path: Path) -> None:
    from mcap.writer import Writer

    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    with pytest.raises(UnusableInput, match=r"is an MCAP file, and no run log of wakedeploy"):
        read_run_log(path)


@pytest.mark.parametrize("content", [b"", b"hello", b"\x00" * 100, os.urandom(999)])
def test_a_foreign_file_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "foreign.mcap"
    path.write_bytes(content)
    with pytest.raises(UnusableInput, match=r"foreign\.mcap.*not an MCAP run log"):
        read_run_log(path)


def test_a_newer_schema_is_refused(tmp_path: Path) -> None:
    writer = RunLogWriter(tmp_path / "new.mcap", METADATA | {"schema": "3"})
    writer.close()
    with pytest.raises(UnusableInput, match="upgrade"):
        read_run_log(tmp_path / "new.mcap")


def write_lines(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


HEADER = ",".join(REQUIRED)
LINE = "0,0.0,0.5,0.009,0,1500,1700,RUNNING"


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], "is empty"),
        (["t_s,tick,mode", "0,0,RUNNING"], "lacks the column.*range_m, range_age_s, steps"),
        ([HEADER, LINE.replace("0.5", "half")], "line 2: range_m = 'half' is not a number"),
        ([HEADER, LINE.replace("0.5", "inf")], "range_m = inf is not a number"),
        (["Zeit;Kraft", "0,0;1,5"], "not a run log, .* read by `wakedeploy data import table`"),
        ([HEADER, LINE + ",1"], "line 2: 9 fields, but 8 column names"),
        ([HEADER, LINE, LINE], "t_s does not rise after tick 0"),
        ([HEADER, LINE.replace("RUNNING", "FLYING")], "mode = 'FLYING' is none of"),
        ([HEADER, LINE.replace("0,0.0", "0,")], "t_s is missing"),
        ([HEADER + ",tick", LINE + ",1"], "the column 'tick' is there twice"),
    ],
)
def test_a_bad_csv_is_one_sentence_that_says_where(
    tmp_path: Path, lines: list[str], message: str
) -> None:
    path = write_lines(tmp_path / "bad.csv", *lines) if lines else tmp_path / "bad.csv"
    if not lines:
        path.write_text("")
    with pytest.raises(UnusableInput, match=message) as caught:
        read_run_log(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_hundred_thousand_columns_are_refused_before_a_person_wonders(tmp_path: Path) -> None:
    names = ",".join(f"c{i}" for i in range(100_000))
    began_s = time.process_time()
    with pytest.raises(UnusableInput, match="lacks the column"):
        read_run_log(write_lines(tmp_path / "wide.csv", names))
    assert time.process_time() - began_s < 2.0


def test_required_columns_alone_are_enough_and_foreign_ones_are_left_out(tmp_path: Path) -> None:
    log = read_run_log(write_lines(tmp_path / "a.csv", HEADER + ",wind_mps", LINE + ",3"))
    assert log.metadata["ignored_columns"] == "wind_mps"
    assert np.isnan(log["z_est_m"]).all()
    assert not log.has("z_est_m")
    assert log.has("range_m")


@pytest.mark.parametrize(
    ("key", "text"),
    [
        *(("dropped", text) for text in ("3.5", "-1", "few", "")),
        *(("rate_hz", text) for text in ("0", "0.000", "-32", "fast")),
    ],
)
def test_metadata_that_no_summary_could_use_are_refused(
    tmp_path: Path, key: str, text: str
) -> None:
    log = some_log(5)
    RunLog(log.columns, METADATA | {key: text}).write_mcap(tmp_path / "a.mcap")
    with pytest.raises(UnusableInput, match=f"{key} = '{text}'; that is no"):
        read_run_log(tmp_path / "a.mcap")


def test_each_column_has_its_own_name() -> None:
    assert len(COLUMN) == len(COLUMNS)


def test_truth_can_be_dropped() -> None:
    log = some_log(true_wake_force_n=-0.5)
    assert "true_wake_force_n" in log
    assert "true_wake_force_n" not in log.without_truth()


def test_a_misspelt_column_is_an_error_of_the_program() -> None:
    with pytest.raises(ValueError, match="rnage_m"):
        RunLog.from_rows([{"rnage_m": 1.0}])


def test_missing_file_is_unusable(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match=r"there is no such file in .*; give a run log"):
        read_run_log(tmp_path / "none.mcap")


def test_what_cannot_be_written_is_the_librarys_own_error(tmp_path: Path) -> None:
    log = some_log()
    for write, end in ((log.write_mcap, "mcap"), (log.write_csv, "csv")):
        (tmp_path / f"folder.{end}").mkdir()
        with pytest.raises(UnusableInput, match=rf"folder\.{end}: Is a directory\.$"):
            write(tmp_path / f"folder.{end}")
        with pytest.raises(UnusableInput, match=r"^path is 3: give a path"):
            write(3)
        with pytest.raises(WakedeployError, match=r"^/dev/full: No space left on device; free"):
            write(Path("/dev/full"))
