"""The doctor names what is missing with its fix, and fails only for what every use needs."""

import datetime
import importlib.metadata
import json
import os
import platform
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from wakedeploy.cli import doctor, main
from wakedeploy.rig.file import default_rig


def test_a_sound_machine_passes_and_says_so_as_json(tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["doctor", "--json", str(tmp_path / "doctor.json")])
    told = json.loads((tmp_path / "doctor.json").read_text())
    assert result.exit_code == 0, result.output
    assert told["ok"] is True
    names = {finding["name"] for finding in told["findings"]}
    assert {"Python", "numpy", "onnxruntime starts", "--realtime", "free disk"} <= names


def test_whatever_is_not_ok_has_its_fix() -> None:
    findings = [finding for look in doctor.CHECKS for finding in look()]
    assert all(finding.fix for finding in findings if finding.state != doctor.OK)


def test_a_missing_library_is_broken_a_missing_extra_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def version(name: str) -> str:
        if name in ("mcap", "torch"):
            raise importlib.metadata.PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(importlib.metadata, "version", version)
    states = {f.name: f.state for f in [*doctor.base_libraries(), *doctor.extras()]}
    assert states["mcap"] == doctor.BROKEN
    assert states["numpy"] == doctor.OK
    assert states["[train]"] == doctor.OPTIONAL
    assert CliRunner().invoke(main, ["doctor"]).exit_code == 1


def test_a_library_that_kills_the_interpreter_does_not_kill_the_doctor(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "onnxruntime.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGILL)"
    )
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    (finding,) = doctor.onnxruntime_starts()
    assert (finding.state, finding.found) == (doctor.BROKEN, "ended by SIGILL")


def test_a_machine_without_onnxruntime_is_sound_and_flies_c(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    version = importlib.metadata.version

    def missing(name: str) -> str:
        if name == "onnxruntime":
            raise importlib.metadata.PackageNotFoundError(name)
        return version(name)

    monkeypatch.setattr(importlib.metadata, "version", missing)
    (finding,) = doctor.onnxruntime_starts()
    assert (finding.state, finding.found) == (doctor.OPTIONAL, "missing")
    assert "--backend c" in finding.fix
    assert "'.[onnx]'" in finding.fix
    assert "onnxruntime" not in [finding.name for finding in doctor.base_libraries()]
    monkeypatch.setattr(sys, "maxsize", 2**31 - 1)  # as on armv6l and armv7l
    monkeypatch.setattr(platform, "machine", lambda: "armv7l")
    (finding,) = doctor.onnxruntime_starts()
    assert finding.state == doctor.OPTIONAL
    assert "armv7l" in finding.found
    assert "pip" not in finding.fix
    assert "--backend c" in finding.fix


def test_without_a_c_compiler_it_says_what_c_needs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    (finding,) = doctor.c_compiler()
    assert finding.state == doctor.OPTIONAL
    assert "apt install gcc" in finding.fix


def test_an_import_error_is_told_in_its_own_words(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "onnxruntime.py").write_text("raise ImportError('libfoo.so: no such file')")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    (finding,) = doctor.onnxruntime_starts()
    assert (finding.state, finding.found) == (doctor.BROKEN, "libfoo.so: no such file")


def test_a_driver_that_cannot_be_loaded_is_not_ok_where_there_is_a_bus(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    words = "The platform library 'gpiod' was not found."
    (tmp_path / "board.py").write_text(f"raise RuntimeError({words!r})")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "1.0")
    monkeypatch.setattr(doctor, "_I2C_BUSES", str(tmp_path / "i2c-*"))
    states = {f.name: f.state for f in doctor.extras()}
    assert doctor.OPTIONAL not in states.values()
    (tmp_path / "i2c-1").touch()
    (found,) = (f for f in doctor.extras() if f.name.startswith("[rig]"))
    assert found.state == doctor.OPTIONAL
    assert words in found.fix


def test_a_port_without_permission_names_the_group(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = {"/dev/ttyACM*": ["/dev/ttyACM0", "/dev/ttyACM1"]}
    monkeypatch.setattr(doctor.glob, "glob", lambda pattern: ports.get(pattern, []))
    monkeypatch.setattr(os, "access", lambda path, mode: path == "/dev/ttyACM1")
    refused, allowed = doctor.serial_ports()
    assert "usermod -aG dialout" in refused.fix
    assert (allowed.state, allowed.found) == (doctor.OK, "/dev/ttyACM1")


def test_an_unsuitable_python_is_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 10, 4, "final", 0))
    (finding,) = doctor.python_version()
    assert finding.state == doctor.BROKEN


PROCEDURES = ("zero", "range", "noise", "latency", "thrust", "steps", "spool", "spool")


def test_missing_old_and_future_calibrations_are_stale_and_named_with_their_command(
    tmp_path: Path,
) -> None:
    def dated(value: float, date: str) -> dict[str, object]:
        return {"value": value, "spread": 0.0004, "date": date}

    rig = default_rig().changed(
        range_sensor={
            "bias_m": dated(0.01, "2026-03-01"),
            "scale": dated(1.0, "2026-02-28"),
            "noise_m": dated(0.004, "2026-05-01"),
        },
        latency={"round_trip_s": dated(0.02, "some day")},
    )
    rig.write(tmp_path / "rig.toml")
    found = doctor.calibrations(tmp_path / "rig.toml", datetime.date(2026, 3, 31))
    states = {f.name: (f.state, f.found) for f in found}
    assert states["range_sensor.bias_m"] == (doctor.OK, "2026-03-01, 30 days old")
    assert states["range_sensor.scale"] == (doctor.STALE, "2026-02-28, 31 days old")
    assert "still to come" in states["range_sensor.noise_m"][1]
    assert "some day" in states["latency.round_trip_s"][1]
    assert states["stepper.steps_per_m"] == (doctor.STALE, "never calibrated")
    assert all(f"calibrate {p}" in f.fix for f, p in zip(found, PROCEDURES, strict=True) if f.fix)
    result = CliRunner().invoke(main, ["doctor", "--rig", str(tmp_path / "rig.toml")])
    assert result.exit_code == 0
    assert "wakedeploy calibrate steps --rig" in result.output


@pytest.mark.parametrize("name", doctor.CALIBRATIONS)
def test_the_command_that_renews_a_calibration_is_a_whole_one(name: str, tmp_path: Path) -> None:
    rig, path = default_rig(), tmp_path / "rig.toml"
    curve = [0.9 * thrust_n for thrust_n in rig.thrust.sufferer.thrust_n]
    rig.changed(thrust={"sufferer": {"thrust_n": curve}}).write(path)
    (fix,) = [f.fix for f in doctor.calibrations(path) if f.name == name]
    told = CliRunner().invoke(main, fix.split()[1:], input="\n")
    assert "PORT: no such port" in told.output
