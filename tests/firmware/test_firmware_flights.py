"""Whole flights behind the compiled sketch, and behind spoilt ones.

In virtual time but one: what they show must not depend on how busy the computer is.
"""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import needs
import numpy as np
import pytest

from runtime.virtual.firmware_build import ROOT
from wakedeploy.core.runlog import RunLog, read_run_log
from wakedeploy.rig.file import default_rig

pytestmark = needs.simulator

HERE = Path(__file__).parent
RIG = default_rig().changed(disturbance={"rest_s": 0.2})
SECONDS, SEED = 6.0, 5
# Servo frames of another phase make 3.5 mm; pulses too long by 3 % would make 31 mm.
SAME_M = 0.007


def run(*command: str | Path, folder: Path, project: Path = ROOT) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, *map(str, command)],
        cwd=folder, env={"PATH": "/usr/bin:/bin", "PYTHONPATH": f"{project}:{HERE.parent}"},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


def flown(board: str, folder: Path, project: Path = ROOT) -> tuple[str, RunLog]:
    """How a flight in virtual time ended, and its log."""
    RIG.write(folder / "rig.toml")
    log = folder / f"{board}.mcap"
    script = HERE / "flight_in_virtual_time.py"
    told = run(script, board, "rig.toml", f"{SECONDS}", f"{SEED}", log, folder=folder,
               project=project)  # fmt: skip
    assert told.returncode == 0, told.stderr
    return told.stdout.strip(), read_run_log(log)


@pytest.fixture(scope="module")
def as_it_should_be(tmp_path_factory: pytest.TempPathFactory) -> RunLog:
    """The flight of the board in Python."""
    ended, log = flown("python", tmp_path_factory.mktemp("python"))
    assert ended == "whole"
    return log


def apart_m(one: RunLog, other: RunLog) -> float:
    """How far apart two sufferers were in flight, root mean square."""
    ticks, first, second = np.intersect1d(one["tick"], other["tick"], return_indices=True)
    assert len(ticks) >= SECONDS * 32
    return float(np.sqrt(np.mean((one["true_z_m"][first] - other["true_z_m"][second]) ** 2)))


def rmse_m(log: RunLog) -> float:
    return float(np.sqrt(np.mean((log["z_ref_m"] - log["true_z_m"])[log.flying] ** 2)))


@pytest.mark.whole
def test_the_sketch_flies_as_the_board_in_python_does(tmp_path, as_it_should_be) -> None:
    ended, log = flown("sketch", tmp_path)
    assert ended == "whole"
    assert "unfinished" not in log.metadata
    assert len(log) == len(as_it_should_be)
    assert set(log["faults"]) == {""}
    assert log["source_cmd_us"].max() > 1200.0  # there was a wake to fly in
    assert apart_m(log, as_it_should_be) < SAME_M
    assert rmse_m(log) == pytest.approx(rmse_m(as_it_should_be), rel=0.1)


@pytest.mark.whole
def test_the_command_flies_the_sketch(tmp_path, as_it_should_be) -> None:
    RIG.write(tmp_path / "rig.toml")
    fly = ["-m", "wakedeploy", "run-gantry", "--baseline", "--virtual", "--firmware"]
    told = run(
        *fly, "--rig", "rig.toml", "--seconds", f"{SECONDS}", "--seed", f"{SEED}",
        "--log", "flight.mcap", "--json", "run.json", folder=tmp_path,
    )  # fmt: skip
    assert told.returncode == 0, told.stderr
    summary = json.loads((tmp_path / "run.json").read_text())
    assert summary["ended"] == "whole"
    log = read_run_log(tmp_path / "flight.mcap")
    assert "unfinished" not in log.metadata
    assert len(log) == summary["ticks"]
    assert log.metadata["board"] == "uno"
    assert rmse_m(log) == pytest.approx(rmse_m(as_it_should_be), rel=0.1)


def with_the_motors_swapped(sketch: str) -> str:
    return sketch.replace("OCR1A", "OCR1?").replace("OCR1B", "OCR1A").replace("OCR1?", "OCR1B")


def with_pulses_too_long(sketch: str) -> str:
    """By a quarter; a division would take longer than the interrupt has."""
    return re.sub(r"(OCR1[AB]) = (mcu.+);", r"\1 = (\2) + ((\2) >> 2);", sketch)


@pytest.mark.whole
@pytest.mark.parametrize(
    ("spoil", "ends"),
    [
        (with_the_motors_swapped, "failsafe: thrust_lost"),
        (with_pulses_too_long, "failsafe: height_impossible"),
    ],
)
def test_a_bug_in_the_sketch_is_seen_in_the_flight(
    spoil: Callable[[str], str], ends: str, tmp_path: Path, as_it_should_be: RunLog
) -> None:
    project = tmp_path / "project"  # this one, with another sketch
    project.mkdir()
    for package in ("runtime", "wakedeploy"):
        (project / package).symlink_to(ROOT / package)
    shutil.copytree(ROOT / "arduino_sketch", project / "arduino_sketch")
    sketch = project / "arduino_sketch" / "arduino_sketch.ino"
    sound = sketch.read_text()
    sketch.write_text(spoil(sound))
    assert sketch.read_text() != sound
    ended, log = flown("sketch", tmp_path, project)
    assert list((project / "build" / "firmware").glob("uno-*")), "it flew another sketch"
    assert ended == ends
    if ended == "whole":
        assert apart_m(log, as_it_should_be) > 10.0 * SAME_M
