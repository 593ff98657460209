"""The recorder never holds up the loop, counts what it drops, and survives a full disk."""

import os
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from runtime.io.recorder import Recorder
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.runlog import read_run_log
from wakedeploy.core.runlog_mcap import RunLogWriter

METADATA = {"rate_hz": "32.0"}


def tick_row(tick: int) -> dict[str, object]:
    return {"tick": tick, "t_s": tick / 32, "range_m": 0.5, "mode": "RUNNING", "faults": ""}


def test_every_tick_is_recorded_in_order(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", METADATA)
    for tick in range(500):
        recorder.put(tick_row(tick))
    report = recorder.close()
    assert (report.written, report.dropped, report.error) == (500, 0, None)
    log = read_run_log(tmp_path / "a.mcap")
    np.testing.assert_array_equal(log["tick"], np.arange(500))
    assert log.metadata["dropped"] == "0"
    assert "unfinished" not in log.metadata


def test_a_running_recording_is_readable_within_about_a_second(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", METADATA)
    recorder.put(tick_row(0))
    deadline = time.monotonic() + 20
    while not len(read_run_log(tmp_path / "a.mcap")) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert len(read_run_log(tmp_path / "a.mcap")) == 1
    recorder.close()


def test_a_stalled_disk_drops_ticks_and_counts_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moving = threading.Event()
    write = RunLogWriter.write

    def stalled(self: RunLogWriter, row: dict[str, object], log_time_ns: int) -> None:
        moving.wait()
        write(self, row, log_time_ns)

    monkeypatch.setattr(RunLogWriter, "write", stalled)
    recorder = Recorder(tmp_path / "a.mcap", METADATA, queue_size=10)
    for tick in range(100):  # returns at once although nothing is written
        recorder.put(tick_row(tick))
    dropped = recorder.dropped
    moving.set()
    report = recorder.close()
    assert dropped == report.dropped == 100 - report.written
    assert report.written in (10, 11)
    assert read_run_log(tmp_path / "a.mcap").metadata["dropped"] == str(dropped)


def test_a_flight_is_not_recorded_under_a_name_that_says_csv(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match=r"name it flight.mcap, and `wakedeploy log export`"):
        Recorder(tmp_path / "flight.csv", METADATA)
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_never_answers_is_waited_for_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answered = threading.Event()
    monkeypatch.setattr(RunLogWriter, "write", lambda *row: answered.wait())
    monkeypatch.setattr("runtime.io.recorder.CLOSE_LIMIT_S", 0.2)
    recorder = Recorder(tmp_path / "a.mcap", METADATA)
    recorder.put(tick_row(0))
    joins: list[float] = []
    join = recorder._thread.join
    monkeypatch.setattr(
        recorder._thread, "join", lambda limit_s: (joins.append(limit_s), join(limit_s))
    )
    first = recorder.close()
    assert "has not answered" in str(first.error)
    assert recorder.close() is first
    assert joins == [0.2]
    answered.set()


def test_a_full_disk_stops_the_recording_and_keeps_what_is_there(tmp_path: Path) -> None:
    """A file-size limit of the operating system gives the writes the disk would give."""
    path = tmp_path / "full.mcap"
    script = f"""
        import resource, sys, time
        sys.dont_write_bytecode = True  # the interpreter would keep what the limit cuts short
        from pathlib import Path
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        from runtime.io.recorder import Recorder
        from test_recorder import METADATA, tick_row
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
        recorder = Recorder(Path({str(path)!r}), METADATA)
        tick = 0
        while recorder.error is None and tick < 100_000:
            recorder.put(tick_row(tick))
            tick += 1
            time.sleep(0.002)
        report = recorder.close()
        print(tick, report.written, report.dropped)
        print(report.error)
    """
    command = [sys.executable, "-c", textwrap.dedent(script)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    counts, error = done.stdout.splitlines()
    offered, written, dropped = map(int, counts.split())
    assert "recording stopped" in error
    assert "too large" in error
    assert offered == written + dropped
    log = read_run_log(path)
    assert len(log) == written > 0
    np.testing.assert_array_equal(log["tick"], np.arange(len(log)))
    assert "unfinished" in log.metadata


def test_a_disk_without_room_is_refused_before_the_run() -> None:
    if not Path("/dev/full").exists():
        pytest.skip("this system has no /dev/full")
    with pytest.raises(UnusableInput, match="No space left"):
        Recorder(Path("/dev/full"), METADATA)


def test_an_earlier_recording_is_not_overwritten(tmp_path: Path) -> None:
    Recorder(tmp_path / "a.mcap", METADATA).close()
    with pytest.raises(UnusableInput, match="already a recording"):
        Recorder(tmp_path / "a.mcap", METADATA)


def test_under_a_file_no_recording_is_said_to_lie(tmp_path: Path) -> None:
    (tmp_path / "a.onnx").touch()
    with pytest.raises(UnusableInput, match=r"a\.onnx is no folder; name a file in one for --log"):
        Recorder(tmp_path / "a.onnx" / "flight.mcap", METADATA)


def test_of_two_recordings_that_begin_as_one_file_the_second_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, first, begin = tmp_path / "a.mcap", list[Recorder](), RunLogWriter._begun

    def begin_late(self: RunLogWriter, metadata: dict[str, str]) -> int:
        monkeypatch.setattr(RunLogWriter, "_begun", begin)
        first.append(Recorder(path, METADATA))
        return begin(self, metadata)

    monkeypatch.setattr(RunLogWriter, "_begun", begin_late)
    with pytest.raises(UnusableInput, match="already a recording"):
        Recorder(path, METADATA)
    first[0].put(tick_row(7))
    assert first[0].close().written == 1
    assert read_run_log(path)["tick"].tolist() == [7]
    assert [*tmp_path.iterdir()] == [path]


def test_a_recording_can_be_read_from_the_moment_at_which_it_can_be_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, link = list[str](), os.link

    def look(file: Path, name: Path) -> None:
        read.append(read_run_log(file).metadata["rate_hz"])
        link(file, name)

    monkeypatch.setattr(os, "link", look)
    recorder = Recorder(tmp_path / "a.mcap", METADATA)
    assert read == ["32.0"]
    recorder.close()


def test_a_row_that_cannot_be_written_becomes_an_error_not_a_crash(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", METADATA)
    recorder.put({"no_such_column": 1.0})
    report = recorder.close()
    assert report.error is not None
    assert "no_such_column" in report.error
    recorder.put(tick_row(0))  # still safe to call
