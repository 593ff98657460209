"""What the unit forbids, and that the real-time loop runs within it."""

import ctypes
import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import needs
import pytest
from made_packages import gantry_package
from pages import sent_at

from wakedeploy.core.package import write_package
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

UNIT = Path(__file__).parents[2] / "deployment" / "wakedeploy-gantry@.service"
CEILING = 0.8  # systemd's exposure, of 10; real time, two devices and a socket are what remains

ANALYZE = shutil.which("systemd-analyze")


def exposure(folder, text):
    """Systemd's score of the unit for a user, 0 to 10, and its lines."""
    unit = folder / "wakedeploy-gantry@pi.service"
    unit.write_text(text)
    ended = subprocess.run(
        [ANALYZE, "security", "--offline=true", "--no-pager", unit],
        capture_output=True, text=True, check=False, env={"LC_ALL": "C.UTF-8"},
    )  # fmt: skip
    score = re.search(r"Overall exposure level for \S+: ([\d.]+)", ended.stdout)
    assert score, ended.stdout + ended.stderr
    return float(score[1]), ended.stdout


@needs.systemd
def test_systemd_finds_little_exposed(tmp_path):
    score, lines = exposure(tmp_path, UNIT.read_text())
    print("\n".join(line for line in lines.splitlines() if "✓" not in line))
    assert score <= CEILING


@needs.systemd
@pytest.mark.parametrize(
    "line",
    ["CapabilityBoundingSet=\n", "SystemCallFilter=", "DevicePolicy=", "ProtectHome=",
     "PrivateNetwork=", "RestrictNamespaces="],
)  # fmt: skip
def test_the_score_rises_without_a_line(tmp_path, line):
    text = UNIT.read_text()
    assert line in text
    assert exposure(tmp_path, text.replace(line, f"# {line}"))[0] > CEILING


def settings(name):
    return re.findall(rf"^{name}=(.*)$", UNIT.read_text(), re.MULTILINE)


def test_the_port_the_sensor_and_the_flights_stay_within_reach():
    assert {entry.split()[0] for entry in settings("DeviceAllow")} == {
        "char-ttyACM", "char-ttyUSB", "char-i2c",
    }  # fmt: skip
    assert all(entry.split()[1] == "rw" for entry in settings("DeviceAllow"))
    assert settings("BindPaths") == ["/home/%i/wakedeploy"]  # package, rig file, flights
    assert settings("PrivateDevices") == settings("PrivateUsers") == settings("ProcSubset") == []
    assert settings("RestrictRealtime") == ["no"]
    assert settings("RestrictAddressFamilies") == ["AF_UNIX"]


def calls_of(name):
    """The system calls of one of systemd's groups, in groups within it too."""
    ended = subprocess.run(
        [ANALYZE, "syscall-filter", "--no-pager", name],
        capture_output=True, text=True, check=True, env={"LC_ALL": "C.UTF-8"},
    )  # fmt: skip
    lines = [line.strip() for line in ended.stdout.splitlines()[1:]]
    named = {line for line in lines if line and not line.startswith("#")}
    return {c for n in named for c in (calls_of(n) if n.startswith("@") else {n})}


def allowed_calls():
    """What the unit's filters leave; @default is what systemd always allows."""
    allowed = calls_of("@default")
    for entry in settings("SystemCallFilter"):
        for name in entry.removeprefix("~").split():
            calls = calls_of(name) if name.startswith("@") else {name}
            allowed = allowed - calls if entry.startswith("~") else allowed | calls
    return allowed


def missing_for_confinement():
    """Why a process cannot be confined as the service is; None where it can."""
    if shutil.which("systemd-analyze") is None:
        return f"{needs.NOT_INSTALLED}systemd"
    try:
        ctypes.CDLL("libseccomp.so.2")
    except OSError:
        return f"{needs.NOT_INSTALLED}libseccomp2"
    command = [sys.executable, "-c", "from runtime.io.realtime import *; become_realtime()"]
    ended = subprocess.run(command, capture_output=True, check=False)
    return "this user may not use SCHED_FIFO" if ended.returncode else None


def confined(package, calls, told):
    return within(calls, "bench", "latency", package, "--ticks", "64", "--realtime", "--json", told)


def within(calls, *arguments):
    """Run a command with these system calls alone."""
    confined = Path(__file__).with_name("confined.py")
    command = [sys.executable, confined, "wakedeploy", *arguments]
    return subprocess.run(
        command, input=" ".join(sorted(calls)), capture_output=True, text=True, check=False,
        timeout=100,
    )  # fmt: skip


@pytest.fixture(scope="module")
def confinement():
    why = missing_for_confinement()
    if why is not None:
        pytest.skip(why)


@pytest.mark.whole
@pytest.mark.usefixtures("confinement")
def test_the_real_time_loop_runs_within_the_units_limits_and_system_calls(tiny_package, tmp_path):
    package, told = tmp_path / "p.onnx", tmp_path / "told.json"
    write_package(tiny_package("state"), package)
    calls = allowed_calls()
    ended = confined(package, calls, told)
    assert told.exists(), ended.stdout + ended.stderr  # a busy machine may miss the budget
    (row,) = json.loads(told.read_text())["rows"]
    assert row["realtime"]
    refused = confined(package, calls - {"sched_setscheduler"}, tmp_path / "none.json")
    assert "may not use SCHED_FIFO" in refused.stdout + refused.stderr


@pytest.mark.whole
@needs.c_compiler
@pytest.mark.usefixtures("confinement")
def test_a_package_becomes_c_and_flies_within_the_units_system_calls(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    package, told = tmp_path / "p.onnx", tmp_path / "told.json"
    write_package(gantry_package(default_lead_s(default_rig())), package)
    asked = ("run-gantry", "--package", package, "--backend", "c", "--virtual", "--seconds", "6")
    ended = within(allowed_calls(), *asked, "--json", told)
    assert told.exists(), ended.stdout + ended.stderr
    assert json.loads(told.read_text())["ended"] == "whole"
    assert list((tmp_path / "cache" / "wakedeploy" / "c").glob("*.so"))


@pytest.mark.wallclock
@pytest.mark.usefixtures("confinement")
def test_a_live_page_is_served_at_a_socket_within_the_units_system_calls(tmp_path):
    default_rig().changed(disturbance={"rest_s": 0.2}).write(tmp_path / "rig.toml")
    page = tmp_path / "live"
    command = [sys.executable, Path(__file__).with_name("confined.py"), "wakedeploy", "run-gantry",
               "--baseline", "--virtual", "--rig", tmp_path / "rig.toml", "--seconds", "6",
               "--realtime", "--live", page]  # fmt: skip
    with subprocess.Popen(command, stdin=-1, stdout=-1, stderr=subprocess.STDOUT, text=True) as run:
        run.stdin.write(" ".join(sorted(allowed_calls())))
        run.stdin.close()
        until_s = time.monotonic() + 30.0
        while not page.exists():
            assert time.monotonic() < until_s
            assert run.poll() is None, run.stdout.read()
            time.sleep(0.1)
        told = sent_at(page)
        said = run.stdout.read()
    assert run.returncode == 0, said
    assert "<title>wakedeploy</title>" in told
    assert "ssh -N -L 8032:" in said
