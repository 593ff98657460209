"""Flights in simulated time: what they are a function of, what they share with real ones."""

import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

from runtime.io.protocol import Command, Frame, encode_frame
from runtime.io.range_source import SOCKET_LAYOUT, RangeReading
from runtime.loop.loop import Loop
from runtime.reference import random_plan
from runtime.request import RunRequest
from runtime.run import fly
from runtime.simulated import SimulatedGantry
from runtime.virtual.mcu_port import McuPort
from runtime.virtual.server import FrameStamps
from wakedeploy.cli import main
from wakedeploy.core.runlog import read_run_log
from wakedeploy.core.runlog_columns import STAGES
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 0.2})


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    RIG.write(tmp_path / "rig.toml")
    return tmp_path


def run_gantry(*arguments):
    words = ["run-gantry", "--rig", "rig.toml", *map(str, arguments)]
    return CliRunner().invoke(main, words)


def contents(log: Path):
    """Every message's bytes and all metadata but when it was."""
    with log.open("rb") as stream:
        reader = make_reader(stream)
        messages = [message.data for _, _, message in reader.iter_messages()]
    metadata = read_run_log(log).metadata
    return messages, {name: value for name, value in metadata.items() if name != "started_utc"}


@pytest.mark.whole
def test_two_processes_fly_the_same_to_the_last_byte_whatever_else_runs(here):
    command = [sys.executable, "-m", "wakedeploy", "run-gantry", "--baseline", "--virtual"]
    command += ["--rig", "rig.toml", "--seconds", "6", "--seed", "5"]
    busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        for name, priority in (("a.mcap", "0"), ("b.mcap", "5")):
            line = ["nice", "-n", priority, *command, "--log", name]
            assert subprocess.run(line, check=False, capture_output=True).returncode == 0
    finally:
        busy.kill()
        busy.wait()
    first, second = contents(Path("a.mcap")), contents(Path("b.mcap"))
    assert len(first[0]) > 250
    assert first == second


def test_a_logs_stamps_run_with_the_flights_own_time(here):
    fly(RunRequest(RIG, 6.0, log=Path("f.mcap")))
    with Path("f.mcap").open("rb") as stream:
        messages = make_reader(stream).iter_messages("/state")
        stamps_ns = [message.log_time for _, _, message in messages]
    t_s = read_run_log("f.mcap")["t_s"]
    assert np.diff(stamps_ns) * 1e-9 == pytest.approx(np.diff(t_s), abs=1e-6)


@pytest.mark.whole
def test_what_computing_takes_is_not_made_up(here):
    result = run_gantry("--baseline", "--virtual", "--seconds", 6, "--log", "f.mcap", "--json", "r")
    assert result.exit_code == 0, result.output
    told = {name for message in contents(Path("f.mcap"))[0] for name in json.loads(message)}
    assert "round_trip_s" in told
    assert not told & set(STAGES)
    summary = json.loads(Path("r").read_text())
    assert summary["clock"] == "simulated"
    assert not [name for name in summary if name.startswith("compute")]
    assert "simulated; --wall-clock flies in real time" in result.output
    shown = CliRunner().invoke(main, ["log", "show", "f.mcap"])
    assert shown.exit_code == 0, shown.output
    assert "nan" not in shown.output


class NoisyWire(McuPort):
    """A board that every tenth frame reaches with one bit changed."""

    frames = 0

    def receive(self, t_s, data, *, at_once=False):
        self.frames += 1
        if self.frames > 10 and self.frames % 10 == 0:
            data = bytes([data[0] ^ 4, *data[1:]])
        super().receive(t_s, data, at_once=at_once)


def test_the_bytes_on_the_wire_are_real_a_damaged_frame_is_dropped_and_counted():
    board = NoisyWire(RIG, boot_s=0.0)
    world = SimulatedGantry(GantryPlant(RIG, seed=2), truth=RIG, seed=2, port=board)
    loop = Loop(RIG, world, world, random_plan(RIG, 6.0, 2), None, None, world, is_timed=False)
    assert loop.run().ended == "whole"
    damaged = board.frames // 10 - 1
    assert damaged > 15
    assert world.answer.status.malformed == damaged
    assert world.answer.status.missed >= damaged - 1  # which the deadman counts, too


@pytest.mark.whole
def test_an_hour_of_flight_outruns_the_disk_and_loses_no_tick(here, monkeypatch):
    monkeypatch.setattr("runtime.io.recorder.QUEUE_SIZE", 8)
    fly(RunRequest(RIG, 30.0, log=Path("f.mcap")))
    log = read_run_log("f.mcap")
    assert log.metadata["dropped"] == "0"
    assert np.all(np.diff(log["tick"]) == 1)


@pytest.mark.parametrize("workers", [1, 2])
def test_what_keeps_one_of_several_flights_on_the_ground_ends_the_command(here, workers):
    """A rig whose carriage seems not to be at home: the sentence of a single flight, at once."""
    default_rig().changed(range_sensor={"bias_m": 0.2}).write("plant.toml")
    result = run_gantry("--baseline", "--virtual", "--seconds", 6, "--plant-rig", "plant.toml",
                        "--flights", 2, "--workers", workers)  # fmt: skip
    assert result.exit_code == 2
    assert "At rest the range sensor reads" in result.output


@pytest.mark.whole
def test_many_flights_are_the_single_ones_and_their_mean_has_its_standard_error(here):
    plan = ("--baseline", "--virtual", "--seconds", 6)
    for workers in (1, 2):
        result = run_gantry(
            *plan, "--flights", 3, "--seed", 4, "--log", f"logs{workers}", "--workers", workers,
            "--json", f"{workers}.json",
        )  # fmt: skip
        assert result.exit_code == 0, result.output
    one, two = (json.loads(Path(f"{n}.json").read_text()) for n in (1, 2))
    assert one == two
    assert run_gantry(*plan, "--seed", 5, "--log", "single.mcap").exit_code == 0
    assert contents(Path("single.mcap")) == contents(Path("logs1/pid-0005.mcap"))
    rmse_mm = [
        1e3 * read_run_log(f"logs2/pid-000{seed}.mcap").tracking_rmse_m("true_z_m")
        for seed in (4, 5, 6)
    ]
    mean = one["rmse_mm"]["pid"]
    assert mean["mean"] == pytest.approx(sum(rmse_mm) / 3)
    scatter = sum((value - mean["mean"]) ** 2 for value in rmse_mm) / 2
    assert mean["standard_error"] == pytest.approx(math.sqrt(scatter / 3))
    assert f"{mean['mean']:.1f} ± {mean['standard_error']:.1f}" in result.output


def test_a_flight_among_many_that_ends_early_is_named_and_fails_the_command(here):
    Path("push.py").write_text(
        "def hooks():\n"
        "    return {'command_hook': lambda t, a, b, dt: (a, 1000.0 if t > 3.0 else b)}\n"
    )
    arguments = ("--baseline", "--virtual", "--seconds", 8, "--flights", 2)
    result = run_gantry(*arguments, "--hooks", "push:hooks", "--workers", 1, "--json", "r.json")
    assert result.exit_code == 1
    assert "2 of 2 flights did not end whole, the first with seed 0 (failsafe: " in result.output
    assert json.loads(Path("r.json").read_text())["rmse_mm"]["pid"]["mean"] is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--virtual", "--realtime"], "--realtime belongs to --port or --wall-clock"),
        (["--virtual", "--no-realtime"], "--no-realtime belongs to --port or --wall-clock"),
        (["--port", "x", "--wall-clock"], "--wall-clock belongs to --virtual"),
        (["--virtual", "--arm-file", "x"], "add --wall-clock"),
        (["--virtual", "--wall-clock", "--flights", "3"], "--flights flies in simulated time"),
        (["--virtual", "--flights", "3", "--log", "a.mcap"], "several flights need a folder"),
        (["--virtual", "--flights", "3", "--watch-gap"], "--watch-gap belongs to a single flight"),
    ],
)
def test_options_of_the_other_clock_are_one_sentence(here, arguments, words):
    result = run_gantry("--baseline", "--trust-curve", *arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert result.stderr.count("\n") == 1


def test_a_plant_process_that_was_not_let_run_is_no_silent_board():
    reading = RangeReading(100.0, 5_000_000, plant_time_us=5_000_000)
    assert reading.behind_s(5.4) == pytest.approx(0.4)
    assert reading.behind_s(4.999) == 0.0
    assert reading.behind_s(60.0) == 0.0  # it hangs, and that is a fault
    # A real world is never behind, nor a simulated one that began a moment ago.
    assert RangeReading(100.0, 5_000_000).behind_s(5.4) == 0.0
    assert RangeReading(100.0, 500_000).behind_s(0.54) == 0.0
    truth = {"true_wake_force_n": -0.1, "true_hook_force_n": 0.0, "true_z_m": 0.1}
    known = replace(reading, **truth)
    assert RangeReading(*SOCKET_LAYOUT.unpack(known.pack())) == known


@pytest.mark.parametrize("split", [1, 7, 1000])
def test_frames_act_when_they_were_sent_not_when_a_late_plant_reads_them(split):
    wrap_s = 2**32 * 1e-6
    sent_s = [2 * wrap_s - 0.03, 2 * wrap_s + 0.001, 2 * wrap_s + 0.032]  # the stamp wraps between
    data = b"".join(
        encode_frame(Frame(n, int(t_s * 1e6), Command(1200.0, 1300.0, 0, 1000, 1000)))
        for n, t_s in enumerate(sent_s)
    )
    stamps, now_s = FrameStamps(), 2 * wrap_s + 0.2
    found = [
        pair for i in range(0, len(data), split) for pair in stamps.of(data[i : i + split], now_s)
    ]
    assert b"".join(piece for _, piece in found) == data
    told_s = [t_s for t_s, piece in found if piece.endswith(b"\0")]
    assert told_s == pytest.approx(sent_s, abs=1e-5)


@pytest.mark.wallclock
def test_a_plant_that_the_computer_stops_for_a_while_ends_no_flight(here):
    log = Path("f.mcap")
    command = [sys.executable, "-m", "wakedeploy", "run-gantry", "--baseline", "--virtual"]
    command += ["--wall-clock", "--rig", "rig.toml", "--seconds", "8", "--log", str(log)]
    run = subprocess.Popen(command, stdout=-1, stderr=-1, text=True)
    end_s = time.monotonic() + 60.0
    while not (log.exists() and log.stat().st_size > 20_000):
        assert time.monotonic() < end_s
        assert run.poll() is None
        time.sleep(0.05)
    plant = int(subprocess.check_output(["pgrep", "-P", str(run.pid)], text=True).split()[0])
    os.kill(plant, signal.SIGSTOP)
    time.sleep(0.4)
    os.kill(plant, signal.SIGCONT)
    out, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    assert "whole" in out
    assert "late: this computer is too slow or too busy" in err
