"""The standby against a real board process: what ends it, and that it keeps the board disarmed."""

import re
import subprocess
import sys
import time

import pytest
from made_packages import gantry_package

from runtime.io.link import Link
from runtime.io.protocol import Command
from runtime.io.range_source import RangeReading, SocketRangeSource, wait_for_first
from runtime.loop.arming import arm_limits
from runtime.standby import begin_standby, stand_by
from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.package import write_package
from wakedeploy.core.runlog import read_run_log
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

# A board that was armed greets again once its own descent is over.
RIG = default_rig().changed(disturbance={"rest_s": 0.2}, limits={"sink_s": 0.5})
CLI = [sys.executable, "-c", "from wakedeploy.cli import main; main()", "run-gantry"]


@pytest.fixture
def gantry():
    with VirtualGantryProcess(RIG, seed=0) as running:
        yield running


@pytest.fixture
def opened(gantry):
    with Link(gantry.port) as link:
        link.handshake()
        ranges = SocketRangeSource(gantry.range_socket)
        wait_for_first(ranges)
        yield link, ranges
        ranges.close()


class Beats:
    """Counts beats, and does something at one of them."""

    def __init__(self, at, then):
        self.count, self._at, self._then = 0, at, then

    def __call__(self):
        self.count += 1
        if self.count == self._at:
            self._then()


def test_a_word_ends_it_and_is_gone(opened, tmp_path):
    word = tmp_path / "fly"
    beats = Beats(3, word.touch)
    stand_by(word, *opened, beats)
    assert beats.count == 3
    assert not word.exists()


@pytest.mark.whole
def test_it_greets_the_board_again_and_again_which_disarms_it(opened, tmp_path):
    link, ranges = opened
    assert link.arm(arm_limits(RIG)).armed  # by a run that was killed
    word = tmp_path / "fly"
    stand_by(word, link, ranges, Beats(15, word.touch))
    idle = link.wait_for(link.send(Command(1000.0, 1000.0, 0, 1000, 1000)), 5.0)
    assert not idle.status.armed
    assert link.arm(arm_limits(RIG)).armed  # which takes a greeting since the last time


SILENT = "The range sensor fell silent while standing by; check its wires and its power."
ENDED = "The plant process stopped sending range samples."


def test_a_sensor_that_falls_silent_ends_it(opened, tmp_path):
    link, ranges = opened
    with pytest.raises(UnusableInput) as ended:
        stand_by(tmp_path / "fly", link, ranges, Beats(2, ranges.close))
    assert str(ended.value) == SILENT


def test_a_sensor_that_says_why_it_ended_is_quoted_in_a_sentence(gantry, opened, tmp_path):
    link, ranges = opened

    def end():
        gantry.kill()
        until_s = time.monotonic() + 10.0
        while ranges.failure is None:
            assert time.monotonic() < until_s
            time.sleep(0.01)

    # The first look after the process's end comes before the next greeting.
    with pytest.raises(UnusableInput) as ended:
        stand_by(tmp_path / "fly", link, ranges, Beats(2, end))
    assert str(ended.value) == ENDED


def test_a_board_that_is_gone_ends_it(gantry, opened, tmp_path):
    class Well:
        """A sensor that goes on whatever happens to the board."""

        failure = None

        @property
        def newest(self):
            return RangeReading(40.0, int(time.monotonic() * 1e6))

    link, _ = opened
    with pytest.raises(UnusableInput) as ended:
        stand_by(tmp_path / "fly", link, Well(), Beats(2, gantry.kill))
    why = re.escape("; check the USB cable and its power.")
    assert re.fullmatch(
        rf"{gantry.port}: the connection to the board was lost \([^()]+\){why}", str(ended.value)
    )


def test_a_folder_that_is_missing_is_named_before_anything_waits(tmp_path):
    with pytest.raises(UnusableInput, match="no folder"):
        begin_standby(tmp_path / "none" / "fly")


def test_a_word_that_cannot_be_taken_away_is_no_word(tmp_path):
    (tmp_path / "fly").mkdir()
    with pytest.raises(CheckFailed, match="again and again"):
        begin_standby(tmp_path / "fly")


@pytest.mark.wallclock
def test_what_flies_is_what_is_current_when_asked_for(tmp_path):
    word, current, log = tmp_path / "fly", tmp_path / "current.onnx", tmp_path / "flight.mcap"
    rig_file = tmp_path / "rig.toml"
    RIG.write(rig_file)
    before, deployed = (gantry_package(default_lead_s(RIG), seed=seed) for seed in (1, 2))
    write_package(before, current)
    arguments = ["--package", current, "--rig", rig_file, "--log", log, "--arm-file", word]
    run = subprocess.Popen(
        [str(part) for part in (*CLI, "--virtual", "--wall-clock", "--seconds", 6, *arguments)],
        stdout=-1, stderr=-1, text=True,
    )  # fmt: skip
    assert "Standing by" in run.stderr.readline()
    write_package(deployed, current)
    lower = RIG.changed(limits={"pulse_us": (1000.0, 1700.0)})
    lower.write(rig_file)
    word.touch()
    _, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    assert deployed.sha256 != before.sha256
    flown = read_run_log(log)
    assert flown.metadata["package_sha256"] == deployed.sha256
    assert flown.metadata["rig_sha256"] == lower.sha256
    assert flown.metadata["plant_rig_sha256"] == RIG.sha256  # the plant was there before
    assert 1600.0 < flown["source_cmd_us"].max() <= 1700.0
    assert flown["sufferer_cmd_us"].max() <= 1700.0


def standing_by(rig_file, word):
    arguments = ["--baseline", "--rig", rig_file, "--arm-file", word, "--seconds", 6]
    run = subprocess.Popen(
        [str(part) for part in (*CLI, "--virtual", "--wall-clock", *arguments)],
        stdout=-1,
        stderr=-1,
        text=True,
    )
    assert "Standing by" in run.stderr.readline()
    return run


@pytest.mark.whole
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("rest_s", "rest_z"), "rest_z"),
        (lambda text: "", "rig"),
    ],
)
def test_a_rig_file_that_became_unusable_meanwhile_flies_nothing(tmp_path, change, words):
    word, rig_file = tmp_path / "fly", tmp_path / "rig.toml"
    RIG.write(rig_file)
    run = standing_by(rig_file, word)
    rig_file.write_text(change(rig_file.read_text()))
    word.touch()
    out, err = run.communicate(timeout=60)
    assert run.returncode == 2
    assert out == ""
    late = "The virtual gantry was up to"  # a line of its own, on a busy computer
    (sentence,) = [line for line in err.splitlines() if not line.startswith(late)]
    assert sentence.startswith("Error: ")
    assert words in sentence
