"""What goes wrong at a rig, over real processes, pseudo-terminals and files: one sentence each.

In every case the motors are idle at the end and the log is whole.
"""

import contextlib
import fcntl
import itertools
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cable import Cable
from click.testing import CliRunner
from far_end import FarEnd
from growing import written_so_far

from runtime.io.conversation import Conversation
from runtime.io.protocol import (
    PROTOCOL_VERSION,
    Command,
    Fault,
    Frame,
    HelloReply,
    Status,
    encode_frame,
)
from runtime.io.range_source import RangeReading, wait_for_first
from runtime.virtual.mcu import latch_s
from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.cli import main
from wakedeploy.core.runlog import read_run_log
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 0.2})
CLI = [sys.executable, "-c", "from wakedeploy.cli import main; main()", "run-gantry", "--baseline"]

# A plant's faults begin half a second after the sufferer has risen to 0.25 m.
FAULTS = """
import math

rose_s = math.inf
held_m = math.nan

def look(t_s, state):
    global rose_s
    if state["z_m"] > 0.25:
        rose_s = min(rose_s, t_s)
    return 0.0

def broken(t_s):
    return t_s > rose_s + 0.5

def pulled():
    def battery(t_s, source_us, sufferer_us, dt_s):
        return (1000.0, 1000.0) if broken(t_s) else (source_us, sufferer_us)
    return {"force_hook": look, "command_hook": battery}

def never_plugged():
    return {"command_hook": lambda t_s, source_us, sufferer_us, dt_s: (1000.0, 1000.0)}

def stops():
    def sensor(t_s, range_m, steps):
        return (math.nan if broken(t_s) else range_m), steps
    return {"force_hook": look, "sensor_hook": sensor}

def freezes():
    def sensor(t_s, range_m, steps):
        global held_m
        if not broken(t_s):
            held_m = range_m
        return held_m, steps
    return {"force_hook": look, "sensor_hook": sensor}

def blocked():
    def sensor(t_s, range_m, steps):
        return (0.1 + 0.003 * math.sin(1e3 * t_s) if broken(t_s) else range_m), steps
    return {"force_hook": look, "sensor_hook": sensor}

def covered():
    return {"sensor_hook": lambda t_s, range_m, steps: (math.nan, steps)}
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    RIG.write(tmp_path / "rig.toml")
    (tmp_path / "faults.py").write_text(FAULTS)
    return tmp_path


def started(*arguments):
    told = ["--rig", "rig.toml", *map(str, arguments)]
    return subprocess.Popen([*CLI, "--trust-curve", *told], stdout=-1, stderr=-1, text=True)


@pytest.fixture
def refused(here, monkeypatch):
    """What a run that cannot begin says; it waits a second for a board and for a sensor."""
    monkeypatch.setattr(Conversation.handshake, "__defaults__", (1.0,))
    monkeypatch.setattr(wait_for_first, "__defaults__", (time, 1.0))
    monkeypatch.syspath_prepend(str(here))
    monkeypatch.delitem(sys.modules, "faults", raising=False)

    def invoked(*arguments):
        place = [*map(str, arguments), *(["--no-realtime"] if "--port" in arguments else [])]
        told = ["--baseline", "--trust-curve", "--rig", "rig.toml", "--log", "refused.mcap"]
        run = CliRunner().invoke(main, ["run-gantry", *told, *place])
        assert run.exit_code == 2, run.output
        assert run.stderr.count("\n") == 1
        assert run.stderr.startswith("Error: ")
        log = Path("refused.mcap")
        assert not log.exists() or "unfinished" not in read_run_log(log).metadata
        return run.stderr

    return invoked


def failed(run, log):
    """What a run that ended in a failsafe says; its log is whole and its motors idle."""
    _, err = run.communicate(timeout=120)
    assert run.returncode == 1, err
    (err,) = (line for line in err.splitlines() if not line.startswith("Real time: "))
    assert "ended in a failsafe" in err
    recorded = read_run_log(log)
    assert "unfinished" not in recorded.metadata
    assert recorded.metadata["dropped"] == "0"
    assert int(recorded.metadata["written"]) == len(recorded) > 16
    assert recorded["mode"][-1] == "FAILSAFE"
    assert recorded["source_cmd_us"][-1] == recorded["sufferer_cmd_us"][-1] == 1000.0
    return err, recorded


def until(condition, limit_s=60.0):
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s, "it never happened"
        time.sleep(0.02)


def has_flown(run, log, ticks):
    """Whether so many ticks are on the disk, or the run has ended before it could."""
    written = written_so_far(log)
    flown = 0 if written is None else int(written.flying.sum())
    return flown > ticks or run.poll() is not None


@pytest.mark.whole
@pytest.mark.parametrize(
    ("fault", "cause", "words"),
    [
        ("pulled", "thrust_lost", "check the battery"),
        ("never_plugged", "thrust_lost", "check the battery"),
        ("stops", "sensor_lost", "a fault that was put in"),
        ("freezes", "sensor_frozen", "says the same"),
        ("blocked", "sensor_jump", "beam free"),
    ],
)
def test_a_fault_of_the_plant_is_named_in_one_sentence(here, fault, cause, words):
    run = started("--virtual", "--hooks", f"faults:{fault}", "--seconds", 20, "--log", "f.mcap")
    err, recorded = failed(run, "f.mcap")
    assert f"({cause})" in err
    assert words in err
    began = list(recorded["mode"]).index("FAILSAFE")
    assert recorded["faults"][began].split("+")[0] == cause
    assert recorded["source_cmd_us"][began] == 1000.0
    if fault == "blocked":  # nothing pushed it onto the upper stop
        assert recorded["true_z_m"].max() < RIG.sufferer.travel_m - 0.1


@pytest.mark.wallclock
def test_a_usb_cable_pulled_in_flight_leaves_idle_motors_and_a_whole_log(here):
    with VirtualGantryProcess(RIG, seed=0) as gantry:
        cable = Cable(gantry.port)
        where = ("--port", cable.port, "--range-socket", gantry.range_socket)
        run = started(*where, "--seconds", 60, "--log", "f.mcap")
        until(lambda: has_flown(run, "f.mcap", 16))
        cable.pull()
        err, recorded = failed(run, "f.mcap")
        assert "(link_lost)" in err
        assert "check the USB cable" in err
        assert np.all(np.diff(recorded["tick"]) >= 1)
        # The board has been alone for longer than its descent takes.
        time.sleep(latch_s(RIG.limits) + 0.2)
        board = cable.ask(Command(1500.0, 1500.0, 0, 1000, 1000))
        assert board.faults == Fault.DEADMAN
        assert not board.armed
        assert (board.source_us, board.sufferer_us) == (1000.0, 1000.0)
        cable.close()


@pytest.mark.wallclock
def test_a_battery_whose_voltage_goes_is_named_by_the_board_itself(here):
    # As behind a pressed stop, where capacitors hold the voltage up for a while.
    drained = (round(11_100 * 0.99**n) for n in itertools.count())
    voltages = itertools.chain([11_100] * 80, drained)
    RIG.changed(battery={"has_divider": True}).write(here / "rig.toml")

    def divider(message):
        if isinstance(message, Status):
            return replace(message, battery_mv=next(voltages))
        return message

    with VirtualGantryProcess(RIG, seed=0) as gantry:
        cable = Cable(gantry.port, divider)
        where = ("--port", cable.port, "--range-socket", gantry.range_socket)
        run = started(*where, "--seconds", 60, "--log", "f.mcap")
        err, recorded = failed(run, "f.mcap")
        cable.close()
    assert "(battery_lost)" in err
    assert np.nanmax(recorded["battery_v"]) == 11.1
    began = list(recorded["mode"]).index("FAILSAFE")
    assert 11.1 * 0.6 * 0.99**12 < recorded["battery_v"][began] < 11.1 * 0.6


class Sensor:
    """A range socket on which readings come: its own, or those of another one."""

    def __init__(self, path):
        self.path, self.is_silent, self._ended = path, False, threading.Event()
        self._from = None
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.bind(str(path))
        self._listener.listen()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def relay(self, path):
        """Pass on the readings of another socket from now on."""
        self._from = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._from.connect(str(path))

    def _serve(self):
        with contextlib.suppress(OSError):
            client, _ = self._listener.accept()
            with client:
                while not self._ended.is_set():
                    if packet := self._packet():
                        client.send(packet)

    def _packet(self):
        if self._from is not None:
            return self._from.recv(4096)
        time.sleep(0.02)
        reading = RangeReading(100.0, int(time.monotonic() * 1e6))
        return None if self.is_silent else reading.pack()

    def close(self):
        if self._ended.is_set():
            return
        self._ended.set()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(2.0)
        if self._from is not None:
            self._from.close()


@pytest.fixture
def sensor():
    with tempfile.TemporaryDirectory(prefix="wd-") as folder:  # a socket's path must be short
        made = Sensor(Path(folder) / "range.sock")
        yield made
        made.close()


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda data: b"", ("nothing answered", "arduino_sketch/arduino_sketch.ino")),
        (lambda data: data, ("sends back what it is sent", "wakedeploy doctor")),
        (lambda data: b"\r\nERROR\r\n", ("it says 'ERROR", "arduino_sketch/arduino_sketch.ino")),
        (
            lambda data: encode_frame(Frame(1, 0, HelloReply(0, 1, 1, 7))),
            ("firmware 7", "another version", f"version {PROTOCOL_VERSION}", "upload the sketch"),
        ),
    ],
    ids=["silent", "echo", "modem", "firmware of another version"],
)
def test_a_wrong_board_is_named_with_what_to_do(refused, sensor, answer, words):
    device = FarEnd(answer)
    err = refused("--port", device.name, "--range-socket", sensor.path)
    device.close()
    assert all(word in err for word in words)


def test_a_port_that_another_process_uses_is_busy(refused, sensor):
    device = FarEnd(lambda data: b"")
    script = "import serial, sys; p = serial.Serial(sys.argv[1], exclusive=True); input()"
    other = subprocess.Popen([sys.executable, "-c", script, device.name], stdin=subprocess.PIPE)
    taken = os.open(device.name, os.O_RDWR | os.O_NOCTTY)

    def is_taken():
        try:
            fcntl.flock(taken, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        fcntl.flock(taken, fcntl.LOCK_UN)
        return False

    until(is_taken)
    err = refused("--port", device.name, "--range-socket", sensor.path)
    assert "used by another program" in err
    other.communicate(b"\n", timeout=30)
    os.close(taken)
    device.close()


@pytest.mark.skipif(not hasattr(os, "setuid") or os.getuid() != 0, reason="needs another user")
def test_a_port_without_permission_says_which_group(tmp_path):
    master, slave = os.openpty()
    os.fchmod(slave, 0o600)
    script = (
        "import os, sys; from runtime.io.link import Link; from wakedeploy.core.errors import "
        "UnusableInput\nos.setgroups([]); os.setuid(65534)\n"
        "try: Link(sys.argv[1])\nexcept UnusableInput as error: print(error)"
    )
    command = [sys.executable, "-c", script, os.ttyname(slave)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=60)
    os.close(slave)
    os.close(master)
    assert "no permission; add yourself to the group dialout" in run.stdout, run.stderr


def test_a_port_that_is_not_there_says_where_to_look(refused):
    assert "no such port; plug the board in" in refused("--port", "/dev/ttyACM97")


@pytest.mark.whole
def test_a_missing_sensor_is_told_before_anything_moves(refused, sensor, tmp_path):
    with VirtualGantryProcess(RIG, seed=0) as gantry:
        # No socket, a sensor that says nothing, and one that sees nothing.
        err = refused("--port", gantry.port, "--range-socket", tmp_path / "none.sock")
        assert "no range samples can be read there" in err
        sensor.is_silent = True
        err = refused("--port", gantry.port, "--range-socket", sensor.path)
        assert "check that it sees the reflector" in err
    assert not Path("refused.mcap").exists()
    assert "check that it sees" in refused("--virtual", "--hooks", "faults:covered")


@pytest.mark.wallclock
def test_a_sensor_whose_process_ends_in_flight_is_told_by_its_own_words(here, sensor):
    with VirtualGantryProcess(RIG, seed=0) as gantry:
        sensor.relay(gantry.range_socket)
        run = started("--port", gantry.port, "--range-socket", sensor.path, "--log", "f.mcap")
        until(lambda: has_flown(run, "f.mcap", 0))
        sensor.close()
        err, _ = failed(run, "f.mcap")
    assert "(sensor_lost): the plant process stopped sending range samples" in err


@pytest.mark.whole
def test_a_terminal_that_closes_is_nobodys_concern_under_nohup(here):
    CLI.insert(0, "nohup")
    try:
        run = started("--virtual", "--seconds", 900, "--log", "f.mcap")
    finally:
        CLI.pop(0)
    until(lambda: has_flown(run, "f.mcap", 0))
    run.send_signal(signal.SIGHUP)
    flown = int(read_run_log("f.mcap").flying.sum())
    until(lambda: has_flown(run, "f.mcap", flown + 32))
    assert run.poll() is None
    run.send_signal(signal.SIGTERM)
    _, err = run.communicate(timeout=60)
    assert run.returncode == 130
    assert err.endswith("Interrupted.\n")  # behind what nohup says


@pytest.fixture
def attended():
    """As at a terminal, also where the tests run under `nohup`: a run inherits what is ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.whole
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_polite_kill_lands_and_closes_the_log(here, attended, number):
    run = started("--virtual", "--seconds", 900, "--log", "f.mcap")
    until(lambda: has_flown(run, "f.mcap", 64))
    for _ in range(5):  # a closing terminal is told by its shell and by the kernel
        run.send_signal(number)
        time.sleep(0.002)
    _, err = run.communicate(timeout=60)
    assert (run.returncode, err) == (130, "Interrupted.\n")
    log = read_run_log("f.mcap")
    assert "unfinished" not in log.metadata
    landing = log["mode"] == "FAILSAFE"
    down = log["z_est_m"][landing]
    assert down[0] > 0.1
    assert down[-1] < 0.05
    assert landing.sum() / 32 > 0.5 * down[0] / 0.25  # not a fall
    assert (log["sufferer_cmd_us"][landing][: landing.sum() // 2] > 1100.0).all()


@pytest.mark.wallclock
def test_ctrl_c_again_stops_the_motors_at_once(here):
    run = started("--virtual", "--wall-clock", "--seconds", 60, "--log", "f.mcap")
    until(lambda: has_flown(run, "f.mcap", 64))
    run.send_signal(signal.SIGINT)
    until(lambda: "FAILSAFE" in read_run_log("f.mcap")["mode"])
    run.send_signal(signal.SIGINT)
    _, err = run.communicate(timeout=60)
    assert run.returncode == 130
    assert err.endswith("Interrupted.\n")
    log = read_run_log("f.mcap")
    assert "unfinished" not in log.metadata
    assert log["z_est_m"][-1] > 0.05  # it was in the air
