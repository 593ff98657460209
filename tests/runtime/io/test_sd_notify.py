"""What a run tells systemd, heard at a real datagram socket, from a real process."""

import contextlib
import os
import signal
import socket
import subprocess
import sys

import pytest

from runtime.io.sd_notify import ServiceManager
from wakedeploy.core.runlog import read_run_log
from wakedeploy.rig.file import default_rig

RUN = [sys.executable, "-c", "from wakedeploy.cli import main; main()", "run-gantry"]
# The same command with a loop that hangs in a tick, while the process lives on.
HANGS = """
import time
from runtime.loop.loop import Loop

tick = Loop._tick

def hang(loop, now):
    if loop.tally.ticks == 40:
        print("hangs", flush=True)
        time.sleep(1000)
    tick(loop, now)

Loop._tick = hang
from wakedeploy.cli import main
main()
"""
WATCHDOG_S = 0.8


class Manager:
    """systemd's end of the socket."""

    def __init__(self, name):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind("\0" + name[1:] if name.startswith("@") else name)
        self.socket.settimeout(60.0)
        self.environment = {
            "NOTIFY_SOCKET": name, "WATCHDOG_USEC": str(round(1e6 * WATCHDOG_S)),
        }  # fmt: skip

    def heard(self):
        return self.socket.recv(4096).decode()

    def heard_until(self, words):
        """Everything up to the first message with these words."""
        messages = []
        while not messages or words not in messages[-1]:
            messages.append(self.heard())
        return messages

    def is_silent_for(self, seconds):
        self.socket.settimeout(seconds)
        try:
            return not self.heard()
        except TimeoutError:
            return True
        finally:
            self.socket.settimeout(60.0)


@pytest.fixture
def manager(tmp_path):
    made = Manager(str(tmp_path / "notify"))
    yield made
    made.socket.close()


@pytest.fixture
def rig_file(tmp_path):
    path = tmp_path / "rig.toml"
    default_rig().changed(disturbance={"rest_s": 0.2}).write(path)
    return path


@contextlib.contextmanager
def started(manager, rig_file, *arguments, command=RUN):
    line = [*command, "--baseline", "--virtual", "--wall-clock", "--rig", rig_file, *arguments]
    environment = os.environ | manager.environment
    run = subprocess.Popen(
        [str(word) for word in line], stdout=-1, stderr=-1, text=True, env=environment
    )
    try:
        yield run
    finally:
        run.kill()
        run.communicate(timeout=30)


@pytest.mark.parametrize("name", ["/notify", "@wakedeploy"])
def test_the_messages_are_those_of_the_protocol(name, tmp_path):
    is_abstract = name.startswith("@")
    manager = Manager(f"{name}-{os.getpid()}" if is_abstract else f"{tmp_path}{name}")
    told = ServiceManager(manager.environment)
    told.ready("standing by")
    assert manager.heard() == "READY=1\nSTATUS=standing by"
    told.status("flying")
    assert manager.heard() == "STATUS=flying"
    told.stopping("landed")
    assert manager.heard() == "STOPPING=1\nSTATUS=landed"
    told.beat()
    assert manager.heard() == "WATCHDOG=1"
    for _ in range(100):
        told.beat()  # at once: not due
    told.status("marker")
    assert manager.heard() == "STATUS=marker"
    told.close()
    manager.socket.close()


def test_without_a_manager_or_a_watchdog_of_ours_nothing_is_sent(tmp_path):
    made = Manager(str(tmp_path / "notify"))
    of_another = made.environment | {"WATCHDOG_PID": str(os.getpid() + 1)}
    for environment in ({}, {"NOTIFY_SOCKET": "vsock:2:1"}, {"WATCHDOG_USEC": "1"}, of_another):
        told = ServiceManager(environment)
        told.beat()
        if environment is not of_another:
            told.ready("nobody listens")
        told.close()
    assert made.is_silent_for(0.2)
    made.socket.close()
    gone = ServiceManager(made.environment)
    (tmp_path / "notify").unlink()
    gone.ready("the manager is gone")  # and the flight goes on
    gone.beat()
    gone.close()


def test_a_manager_that_does_not_listen_never_holds_up_a_tick(tmp_path):
    made = Manager(str(tmp_path / "notify"))
    told = ServiceManager(made.environment | {"WATCHDOG_USEC": "1"})
    for _ in range(2000):  # far more than its queue takes
        told.beat()
    told.close()
    made.socket.close()


@pytest.mark.wallclock
def test_a_flight_is_ready_alive_and_says_how_it_ended(manager, rig_file):
    with started(manager, rig_file, "--seconds", 6) as run:
        first, *between, last = manager.heard_until("STOPPING=1")
        _, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    assert first == "READY=1\nSTATUS=flying"
    assert set(between) == {"WATCHDOG=1"}
    assert len(between) >= 6.0 / WATCHDOG_S  # about four in each limit, on an idle machine
    assert last == "STOPPING=1\nSTATUS=ended: whole"


@pytest.mark.wallclock
def test_a_loop_that_hangs_in_a_living_process_stops_the_beats(manager, rig_file):
    command = [sys.executable, "-c", HANGS, "run-gantry"]
    with started(manager, rig_file, "--seconds", 20, command=command) as run:
        assert "WATCHDOG=1" in manager.heard_until("WATCHDOG=1")
        assert run.stdout.readline() == "hangs\n"
        manager.socket.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while manager.heard():
                pass
        assert manager.is_silent_for(3.0 * WATCHDOG_S)
        assert run.poll() is None


@pytest.mark.wallclock
def test_a_standby_flies_once_and_only_for_a_new_word(manager, rig_file, tmp_path):
    word, flights = tmp_path / "fly", tmp_path / "flights"
    flights.mkdir()
    word.touch()  # left over from a run that crashed
    arguments = ("--seconds", 6, "--log", flights, "--arm-file", word)
    with started(manager, rig_file, *arguments) as run:
        assert "READY=1\nSTATUS=standing by, motors off" in manager.heard()
        assert not word.exists()
        for _ in range(8):  # beats of the standby: longer than between two handshakes
            assert manager.heard() == "WATCHDOG=1"
        assert list(flights.iterdir()) == []
        word.touch()
        manager.heard_until("STATUS=about to fly")
        assert not word.exists()
        manager.heard_until("STATUS=flying")
        assert manager.heard_until("STOPPING=1")[-1] == "STOPPING=1\nSTATUS=ended: whole"
        out, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    assert "taken away unheeded" in err
    (log,) = flights.glob("*.mcap")
    assert str(log) in out
    assert read_run_log(log).flying.sum() > 150


@pytest.mark.whole
@pytest.mark.parametrize("stop", [signal.SIGTERM, signal.SIGINT])
def test_a_standby_that_is_stopped_never_flew(manager, rig_file, tmp_path, stop):
    log = tmp_path / "flight.mcap"
    with started(manager, rig_file, "--log", log, "--arm-file", tmp_path / "fly") as run:
        manager.heard_until("READY=1")
        run.send_signal(stop)
        _, err = run.communicate(timeout=30)
    assert run.returncode == 130
    assert "Traceback" not in err
    assert not log.exists()
