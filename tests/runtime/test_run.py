"""Whole runs: real processes, pseudo-terminals and files, ended in every way that a run can end."""

import contextlib
import importlib.metadata
import json
import os
import pty
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from growing import written_so_far
from made_packages import gantry_package

from benchmarks.injected.catalogue import FAULTS
from benchmarks.injected.flight import Case, Moment, scene_of
from runtime.calibration.session import resting
from runtime.io.protocol import FIRMWARE, Fault
from runtime.io.recorder import RunLogWriter
from runtime.loop.safety import LATE_LIMIT, Findings, fatal_faults
from runtime.loop.tally import Tally
from runtime.request import RunRequest, require_fit
from runtime.run import fly
from runtime.verdict import judge
from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.cli import main
from wakedeploy.cli.run_gantry import _lines, summary
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.failsafes import HINTS
from wakedeploy.core.manifest import ForceChannel
from wakedeploy.core.package import write_package
from wakedeploy.core.runlog import read_run_log
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig, parse_rig

RIG = default_rig().changed(disturbance={"rest_s": 0.2})
CLI = [sys.executable, "-c", "from wakedeploy.cli import main; main()", "run-gantry"]


@pytest.fixture
def rig_file(tmp_path):
    path = tmp_path / "rig.toml"
    RIG.write(path)
    return path


def started(*arguments):
    return subprocess.Popen(
        [*CLI, "--baseline", *map(str, arguments)], stdout=-1, stderr=-1, text=True
    )


def flying_for(log, seconds):
    """Wait until the log on the disk has grown for so long, then some more."""
    end_s = time.monotonic() + 120.0
    while not written_so_far(log):
        assert time.monotonic() < end_s, "the run never began"
        time.sleep(0.05)
    time.sleep(seconds)


def resident_mb(process_id):
    status = Path(f"/proc/{process_id}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) * 1024 / 1e6


@pytest.mark.wallclock
def test_a_virtual_run_flies_records_and_sums_up_and_a_terminal_sees_how_far(rig_file, tmp_path):
    log, told = tmp_path / "flight.mcap", tmp_path / "run.json"
    mine, its = pty.openpty()
    arguments = ["--baseline", "--virtual", "--seconds", "6", "--rig", rig_file, "--log", log]
    arguments += ["--wall-clock", "--no-realtime"]  # whose loop leaves time to draw
    line = [*CLI, *map(str, arguments), "--json", str(told), "--seed", "4"]
    run = subprocess.Popen(line, stdout=-1, stderr=its, text=True)
    os.close(its)
    seen = b""
    with contextlib.suppress(OSError):  # the terminal is gone when the command has ended
        while data := os.read(mine, 4096):
            seen += data
    os.close(mine)
    out, _ = run.communicate(timeout=30)
    assert run.returncode == 0, seen.decode()
    drawn = seen.decode().split("\r")
    assert 8 <= sum("of 6 s" in shown for shown in drawn) <= 26  # at most four a second
    assert drawn[-1] == "\x1b[K"
    assert "Tracking RMSE" in out
    recorded = read_run_log(log)
    assert recorded.flying.sum() > 150
    assert recorded.metadata["rig_sha256"] == RIG.sha256
    assert recorded.metadata["seed"] == "4"
    assert recorded.has("true_wake_force_n")
    summed_up = json.loads(told.read_text())
    assert summed_up["ended"] == "whole"
    assert summed_up["rmse_mm"] > 0.0
    assert recorded.metadata["numpy_version"] == importlib.metadata.version("numpy")
    assert recorded.metadata["onnxruntime_version"].count(".") >= 1
    assert recorded.metadata["plant_rig_sha256"] == RIG.sha256
    assert recorded.metadata["hooks"] == ""


# A step takes 200 ms, without the interpreter's lock, as onnxruntime computes.
SLOW_MODEL = """
import hashlib, time
from runtime.loop import prediction_worker
from runtime.predictor import PackagePredictor
from wakedeploy.cli import main

prediction_worker.WARM_UP_CALLS = 5
step, block = PackagePredictor.step, bytes(1 << 20)

def slow_step(self, observation):
    end_s = time.monotonic() + 0.2
    while time.monotonic() < end_s:
        hashlib.sha256(block)
    return step(self, observation)

PackagePredictor.step = slow_step
main()
"""


def may_be_realtime():
    """Whether this user may give a process real-time priority and locked memory."""
    code = "from runtime.io.realtime import become_realtime; become_realtime()"
    return subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


@pytest.mark.wallclock
def test_a_model_that_is_far_too_slow_is_flown_without_in_real_time(rig_file, tmp_path):
    """The loop and the model share a core: the loop has to come first."""
    if not may_be_realtime():
        pytest.skip("this user may not use SCHED_FIFO")
    package, log = tmp_path / "slow.onnx", tmp_path / "flight.mcap"
    write_package(gantry_package(default_lead_s(RIG)), package)
    arguments = ["run-gantry", "--package", package, "--virtual", "--wall-clock", "--realtime"]
    arguments += ["--rig", rig_file, "--seconds", "6", "--log", log]
    line = [sys.executable, "-c", SLOW_MODEL, *map(str, arguments)]
    run = subprocess.run(line, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    recorded = read_run_log(log)
    flying = [mode for mode in recorded["mode"] if mode not in ("ARMED", "LANDING")]
    assert len(flying) > 150
    assert set(flying[LATE_LIMIT:]) == {"DEGRADED"}


@pytest.mark.whole
def test_ctrl_c_lands_closes_the_log_and_says_130_in_little_memory(rig_file, tmp_path):
    log, told = tmp_path / "flight.mcap", tmp_path / "run.json"
    run = started("--virtual", "--seconds", 900, "--rig", rig_file, "--log", log, "--json", told)
    flying_for(log, 0.0)
    # Python 3.13 takes 17 MB more.
    assert resident_mb(run.pid) < (160.0 if sys.version_info < (3, 13) else 180.0)
    run.send_signal(signal.SIGINT)
    out, err = run.communicate(timeout=30)
    assert run.returncode == 130
    assert "Traceback" not in err
    assert "stopped by hand" in out
    summed_up = json.loads(told.read_text())
    assert summed_up["ended"] == "stopped by hand"
    assert summed_up["ticks"] > 30
    recorded = read_run_log(log)
    assert recorded["mode"][-1] == "FAILSAFE"
    assert recorded["sufferer_cmd_us"][-1] == recorded["source_cmd_us"][-1] == 1000.0
    assert recorded.metadata["rig_file"] == rig_file.name
    assert recorded.metadata["ended"] == "stopped by hand"
    assert "unfinished" not in recorded.metadata


@pytest.mark.wallclock
def test_a_second_ctrl_c_switches_the_motors_off_and_screen_and_log_say_so(rig_file, tmp_path):
    log = tmp_path / "flight.mcap"
    run = started("--virtual", "--wall-clock", "--seconds", 60, "--rig", rig_file, "--log", log)
    flying_for(log, 1.0)
    run.send_signal(signal.SIGINT)
    time.sleep(0.2)
    run.send_signal(signal.SIGINT)
    out, err = run.communicate(timeout=30)
    assert run.returncode == 130
    assert "Traceback" not in err
    assert "stopped by hand, and its motors switched off at once" in " ".join(out.split())
    recorded = read_run_log(log)
    assert recorded.metadata["ended"] == "stopped by hand, and its motors switched off at once"
    assert "unfinished" not in recorded.metadata


@pytest.mark.wallclock
def test_a_cable_pulled_in_flight_is_one_sentence_and_the_log_is_whole(rig_file, tmp_path):
    log = tmp_path / "flight.mcap"
    with VirtualGantryProcess(RIG, seed=0) as gantry:
        where = ("--port", gantry.port, "--range-socket", gantry.range_socket, "--trust-curve")
        run = started(*where, "--seconds", 60, "--rig", rig_file, "--log", log)
        flying_for(log, 0.5)
        gantry.kill()
        out, err = run.communicate(timeout=30)
    assert run.returncode == 1
    assert "failsafe: " in out
    assert "Recorded in" in out
    assert "connection to the board was lost" in err.splitlines()[-1]
    recorded = read_run_log(log)
    assert {"link_lost", "sensor_lost"} & set(recorded["faults"][-1].split("+"))
    assert "unfinished" not in recorded.metadata


@pytest.mark.wallclock
def test_a_virtual_board_at_a_rigs_port_is_refused_and_its_kind_is_in_the_log(
    tmp_path, monkeypatch
):
    sensor = SimpleNamespace(close=lambda: None)
    monkeypatch.setattr("runtime.place.I2cRangeSource", lambda: sensor)
    with VirtualGantryProcess(RIG, seed=0) as gantry:
        with pytest.raises(UnusableInput, match="a virtual board answers, and only an UNO may fly"):
            fly(RunRequest(RIG, 6.0, port=gantry.port, log=tmp_path / "no.mcap"))
        assert not (tmp_path / "no.mcap").exists()
        log, (rig, plan) = tmp_path / "f.mcap", resting(RIG, 1.0)
        where = {"port": gantry.port, "range_socket": gantry.range_socket}
        fly(RunRequest(rig, 0.0, plan=plan, log=log, **where))
    told = read_run_log(log).metadata
    own = (told["board"], told["firmware"], told["board_faults"])
    assert own == ("virtual", str(FIRMWARE), "")


def test_a_full_disk_ends_the_flight_and_keeps_what_was_written(tmp_path, monkeypatch):
    log, write, rows = tmp_path / "flight.mcap", RunLogWriter.write, []

    def until_full(self, row, log_time_ns):
        rows.append(row)
        if len(rows) > 40:
            raise OSError(28, "No space left on device")
        write(self, row, log_time_ns)

    monkeypatch.setattr(RunLogWriter, "write", until_full)
    with pytest.raises(CheckFailed, match="No space left"):
        fly(RunRequest(RIG, 8.0, log=log))
    assert 0 < len(read_run_log(log)) <= 40


@pytest.mark.parametrize(
    ("cause", "said"),
    [
        ((), "^9 ticks were not recorded"),
        (("recorder_failed",), "^9 ticks were not recorded"),
        (("operator_stop",), "^9 ticks were not recorded"),
        (("battery_lost",), r"\(battery_lost\): the battery.* 9 ticks were not recorded"),
        (("link_lost", "operator_stop"), r"\(link_lost\+operator_stop\): the USB cable is gone"),
    ],
)
def test_a_failsafe_and_a_log_with_holes_are_both_told(cause, said):
    tally = SimpleNamespace(pause=None, gantry_pause=None)
    loop = SimpleNamespace(failsafe_cause=cause, last_reset=Fault.NONE, tally=tally)
    ranges = SimpleNamespace(failure=None)
    link = SimpleNamespace(failure="the USB cable is gone" if "link_lost" in cause else None)
    with pytest.raises(CheckFailed, match=said):
        judge(loop, link, ranges, "9 ticks were not recorded", is_virtual=False, is_realtime=False)


def test_a_start_that_is_refused_leaves_no_log_in_the_way_of_the_next(tmp_path, monkeypatch):
    log = tmp_path / "flight.mcap"

    def refuse(armed, is_plant):
        raise UnusableInput("The carriage is not at home.")

    with monkeypatch.context() as patched:
        patched.setattr("runtime.loop.loop.require_home", refuse)
        with pytest.raises(UnusableInput, match="not at home"):
            fly(RunRequest(RIG, 6.0, log=log))
    assert not log.exists()
    assert fly(RunRequest(RIG, 6.0, log=log)).log == log


def test_a_virtual_gantry_with_another_truth_and_hooks_flies_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "push.py").write_text(
        "def hooks():\n    return {'force_hook': lambda t_s, state: -0.25}\n"
    )
    log = tmp_path / "flight.mcap"
    truth = RIG.changed(sufferer={"mass_kg": 0.47})
    fly(RunRequest(RIG, 6.0, plant_rig=truth, hooks="push:hooks", log=log))
    recorded = read_run_log(log)
    assert recorded.metadata["plant_rig_sha256"] == truth.sha256 != recorded.metadata["rig_sha256"]
    assert parse_rig(recorded.metadata["plant_rig_toml"]) == truth
    assert recorded.metadata["hooks"] == "push:hooks"
    assert set(recorded["true_hook_force_n"][10:]) == {-0.25}
    # 20 g more and 0.25 N of push: the integral finds both.
    late = recorded["pid_i_n"][recorded.flying][6 * 32 - 60 : 6 * 32 - 30]
    assert late.mean() > 0.2


@pytest.mark.whole
def test_hooks_of_the_current_folder_are_found_by_the_installed_command(rig_file, tmp_path):
    here, elsewhere = tmp_path / "here", tmp_path / "bin"
    here.mkdir()
    elsewhere.mkdir()
    # A console script lies in a folder of its own, which takes the current one's place in sys.path.
    script = elsewhere / "wakedeploy"
    script.write_text("from wakedeploy.cli import main\nmain()\n")
    hooks = "print('loaded')\ndef hooks():\n    return {'force_hook': lambda t_s, state: -0.25}\n"
    (here / "push.py").write_text(hooks)
    (here / "typo.py").write_text("def hooks(:\n")
    arguments = ["run-gantry", "--virtual", "--baseline", "--seconds", "6", "--rig", str(rig_file)]

    def run(name, *more):
        command = [sys.executable, str(script), *arguments, "--hooks", name, *more]
        return subprocess.run(command, capture_output=True, text=True, cwd=here)

    flown = run("push:hooks", "--log", "flight.mcap")
    assert flown.returncode == 0, flown.stderr
    assert set(read_run_log(here / "flight.mcap")["true_hook_force_n"][10:]) == {-0.25}
    wrong = run("typo:hooks")
    assert wrong.returncode == 2
    assert "SyntaxError" in wrong.stderr
    assert wrong.stderr.count("\n") == 1


def test_a_recording_is_closed_when_the_flight_cannot_even_begin(tmp_path, monkeypatch):
    def no_loop(*_, **__):
        raise CheckFailed("no loop")

    monkeypatch.setattr("runtime.run.Loop", no_loop)
    log = tmp_path / "flight.mcap"
    with pytest.raises(CheckFailed, match="no loop"):
        fly(RunRequest(RIG, 6.0, log=log))
    assert "recorder" not in {thread.name for thread in threading.enumerate()}
    assert "unfinished" not in read_run_log(log).metadata


def test_a_round_trip_too_long_for_a_prediction_is_refused_before_flying_a_package(
    tmp_path, tiny_package, monkeypatch
):
    slow = RIG.changed(latency={"round_trip_s": 0.03})
    path = tmp_path / "tiny.onnx"
    write_package(tiny_package("state"), path)
    monkeypatch.setattr("runtime.request.require_fit", lambda *_: None)
    with pytest.raises(UnusableInput, match=r"round_trip_s = 0\.03 leaves no time"):
        fly(RunRequest(slow, 6.0, package=path))


def manifest(**changes):
    return gantry_package(default_lead_s(RIG)).manifest.model_copy(update=changes)


def a_force(name: str = "force_z_n", unit: str = "N", largest: float = 1.0) -> ForceChannel:
    return ForceChannel(name=name, unit=unit, min=-largest, max=0.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rate_hz": 30.0}, "runs at 30 Hz"),
        ({"observation": (a_force("foil_angle"),)}, r"observes foil_angle \[N\]: it is not for"),
        ({"force": ()}, "not for the gantry"),
        ({"force": (a_force("force_x_n"),)}, r"predicts force_x_n \[N\]: it is not for"),
        ({"force": (a_force(unit="kN"),)}, r"predicts force_z_n \[kN\]: it is not for"),
        ({"force": (a_force(largest=50.0),)}, "forces of up to 50 N, and no motor of this rig"),
        ({"lead_s": 0.0}, "train with --lead"),
    ],
)
def test_a_package_that_does_not_fit_is_refused_before_anything_is_opened(changes, words):
    with pytest.raises(UnusableInput, match=words):
        require_fit(manifest(**changes), RIG)


def test_a_lead_close_to_the_rigs_fits_and_another_one_by_permission():
    require_fit(manifest(lead_s=0.09), RIG)
    require_fit(manifest(lead_s=0.0), RIG, allow_lead_mismatch=True)


def test_every_fault_that_ends_a_flight_comes_with_a_hint():
    everything = Findings(
        range_silence_s=9.0,
        range_frozen_s=9.0,
        not_lifting_s=9.0,
        unexplained_s=9.0,
        late_commands=99,
        tick_failed=True,
        battery_gone_s=9.0,
        range_jump_m=9.0,
        mcu_fault=True,
        recorder_failed=True,
        is_noisy=True,
        held_up_mps=9.0,
        stop_asked=True,
        z_m=9.0,
        x_m=9.0,
    )
    named = {
        name
        for other in ({"link_silence_s": 9.0}, {"stalled_s": 9.0, "range_frozen_s": 0.0})
        for name in fatal_faults(replace(everything, **other), RIG.limits)
    }
    # A reboot looks like a lost link until the flight is over.
    assert {*named, "mcu_reboot"} == set(HINTS)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--baseline"], "--virtual or --port"),
        (["--virtual"], "--package FILE or --baseline"),
        (["--baseline", "--port", "/dev/ttyACM97", "--trust-curve"], "no such port"),
        (["--baseline", "--port", "/dev/ttyACM97"], "The default rig: [thrust.sufferer] is"),
        (["--baseline", "--port", "/dev/ttyACM97", "--hooks", "a:b"], "belong to --virtual"),
        (["--baseline", "--virtual", "--range-socket", "a.sock"], "belongs to --port"),
        (["--baseline", "--virtual", "--allow-lead-mismatch"], "belongs to --package"),
        (["--package", "none.onnx", "--virtual"], "none.onnx"),
    ],
)
def test_arguments_that_do_not_go_together_are_one_sentence(arguments, words):
    told = CliRunner().invoke(main, ["run-gantry", *arguments])
    assert told.exit_code == 2
    assert words in told.stderr
    assert told.stderr.count("\n") == 1


def test_a_folder_for_logs_that_is_not_there_yet_is_made(tmp_path):
    folder = tmp_path / "all" / "flights"
    tally = fly(RunRequest(RIG, 6.0, log=folder))
    assert [tally.log] == list(folder.iterdir())
    assert tally.log.suffix == ".mcap"
    (tmp_path / "file").write_text("")
    with pytest.raises(UnusableInput, match="file/flights: no folder can be made"):
        fly(RunRequest(RIG, 6.0, log=tmp_path / "file" / "flights"))


@pytest.mark.parametrize(
    ("place", "advice"),
    [
        ({"is_virtual": True, "is_realtime": False}, "fly without --wall-clock"),
        ({"is_virtual": False, "is_realtime": False}, "give it SCHED_FIFO"),
        ({"is_virtual": False, "is_realtime": True}, "end what else runs on it; `wakedeploy bench"),
    ],
)
@pytest.mark.parametrize("cause", ["loop_stalled", "link_lost", "mcu_fault"])
def test_a_computer_that_stood_still_is_blamed_and_no_cable(cause, place, advice):
    tally = Tally(1 / 32)
    for length_s, until_s in ((0.033, 3.0), (0.167, 12.5), (0.07, 14.0)):
        tally.stood_still(length_s, until_s)
    loop = SimpleNamespace(failsafe_cause=(cause,), last_reset=Fault.NONE, tally=tally)
    well = SimpleNamespace(failure=None)
    with pytest.raises(CheckFailed) as ended:
        judge(loop, well, well, "", **place)
    assert f"({cause}): this computer stood still for 167 ms at 12.3 s: " in str(ended.value)
    assert advice in str(ended.value)
    assert "cable" not in str(ended.value)


@pytest.mark.parametrize("cause", ["sensor_lost", "link_lost"])
def test_a_virtual_gantry_that_stood_still_is_blamed_and_no_wire(cause):
    tally = Tally(1 / 32)
    for length_s, until_s in ((0.02, 3.0), (0.8, 12.5), (0.7, 14.0)):
        tally.gantry_stood_still(length_s, until_s)
    loop = SimpleNamespace(failsafe_cause=(cause,), last_reset=Fault.NONE, tally=tally)
    well = SimpleNamespace(failure=None)
    with pytest.raises(CheckFailed, match="too busy") as ended:
        judge(loop, well, well, "", is_virtual=True, is_realtime=False)
    assert "it stood still for 0.80 s at 11.7 s" in str(ended.value)
    assert "wire" not in str(ended.value)
    assert "cable" not in str(ended.value)


def test_a_whole_flight_says_when_its_virtual_gantry_stood_still():
    tally = Tally(1 / 32, ended="whole")
    for series in tally.stages_s.values():
        series.append(1e-4)
    unmoved = dict(_lines(summary(tally, 13.25)))
    assert not [name for name in unmoved if "stood still" in name]
    tally.gantry_stood_still(1.5, 12.5)
    assert dict(_lines(summary(tally, 13.25))) == unmoved | {
        "The virtual gantry stood still": "for 1500 ms at 11.0 s"
    }


def test_what_stands_still_after_a_failsafe_began_did_not_begin_it():
    hovering = Moment("hovering", seed=5, begins_s=3.0, seconds=6.0)
    scene = scene_of(Case("none", hovering))
    silent = FAULTS["range silent"]
    scene.later(0.0, lambda: silent.begin(scene))
    scene.later(1.5, lambda: scene.world.stand_still(0.07))
    tally = scene.loop.run()
    assert tally.ended == "failsafe: sensor_lost"
    assert tally.pause is None


def test_a_late_virtual_gantry_is_no_cable_and_its_page_hears_why(monkeypatch):
    """Nobody answers in no time: what a gantry that gets no time of the computer looks like."""
    monkeypatch.setattr("runtime.io.conversation.ANSWER_LIMIT_S", 0.0)
    monkeypatch.setattr(VirtualGantryProcess, "boot_s", 0.0)
    told = {}
    page = SimpleNamespace(tell=told.update, stop_asked=lambda: False)
    with pytest.raises((CheckFailed, UnusableInput), match=r"[Tt]he virtual gantry") as ended:
        fly(RunRequest(RIG, 6.0, wall_clock=True), live=page)
    assert "too busy to fly it in real time" in str(ended.value)
    assert "cable" not in str(ended.value)
    assert (told["phase"], told["reason"]) == ("ended", str(ended.value))
