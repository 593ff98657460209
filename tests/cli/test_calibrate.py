"""`calibrate` in real time, through the pseudo-terminal, with a plant unlike the rig file."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from runtime.calibration import zero
from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.cli import calibrate, calibrate_options, main
from wakedeploy.cli.flight_options import require_curve
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Effect, EffectParameter
from wakedeploy.core.runlog import read_run_log
from wakedeploy.domains.gantry import record
from wakedeploy.rig.file import default_rig, default_rig_text, read_rig

# Half a second at rest before and after each run, not three: nothing here is measured in them.
RIG_TEXT = default_rig_text().replace("[disturbance]\n", "[disturbance]\nrest_s = 0.5\n")
RIG = default_rig()
TRUTH = RIG.changed(range_sensor={"bias_m": 0.042, "scale": 1.02}, stepper={"steps_per_m": 4100})


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A rig file with comments, and the rig file of the truth."""
    rig, truth = tmp_path / "rig.toml", tmp_path / "truth.toml"
    rig.write_text(RIG_TEXT)
    TRUTH.write(truth)
    return rig, truth


def calibrated(*arguments: object, given: str | None = None):
    return CliRunner().invoke(main, ["calibrate", *map(str, arguments)], input=given)


def test_zero_on_the_virtual_gantry_writes_value_spread_and_date(
    files, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(zero, "SECONDS", 6.0)  # of rest; readings enough
    rig, truth = files
    told, logs, desk = tmp_path / "zero.json", tmp_path / "logs", tmp_path / "desk.toml"
    where = ("--virtual", "--plant-rig", truth, "--keep-logs", logs, "--json", told)
    result = calibrated("zero", "--rig", rig, "--out", desk, *where)
    assert result.exit_code == 0, result.output
    assert rig.read_text() == RIG_TEXT
    after = read_rig(desk)
    known = after.calibration["range_sensor.bias_m"]
    assert abs(after.range_sensor.bias_m - 0.042) < 3.0 * known.spread < 0.003
    assert known.date in desk.read_text()
    assert "# read in the paper" in desk.read_text()
    assert "range_sensor.bias_m" in result.output
    found = json.loads(told.read_text())["constants"]["range_sensor.bias_m"]
    assert found["before"] == 0.0
    assert found["value"] == after.range_sensor.bias_m
    # The same log again, as one recorded earlier, gives the same.
    again = tmp_path / "again.toml"
    result = calibrated("zero", "--rig", rig, "--out", again, "--log", logs / "zero.mcap")
    assert result.exit_code == 0, result.output
    assert read_rig(again) == after


def test_what_is_simulated_is_never_written_into_the_rig_file(files, random_flight) -> None:
    rig, _ = files
    for where in (("--virtual",), ("--log", random_flight)):
        for out in ((), ("--out", rig), ("--out", rig.parent / "." / rig.name)):
            result = calibrated("latency", "--rig", rig, *where, *out)
            assert result.exit_code == 2, result.output
            assert "give --out FILE, another file than --rig" in result.output
            assert result.output.count("\n") == 1
    assert rig.read_text() == RIG_TEXT
    assert sorted(path.name for path in rig.parent.iterdir()) == ["rig.toml", "truth.toml"]


def test_a_log_of_a_real_rig_needs_no_other_file(files, random_flight, tmp_path) -> None:
    log = read_run_log(random_flight)
    log.metadata["simulated"] = "false"
    log.write_mcap(tmp_path / "real.mcap")
    result = calibrated("latency", "--rig", files[0], "--log", tmp_path / "real.mcap")
    assert result.exit_code == 0, result.output
    assert "latency.round_trip_s" in read_rig(files[0]).calibration


@pytest.mark.wallclock
def test_steps_at_a_port_asks_the_operator(files, tmp_path) -> None:
    rig, _ = files
    with VirtualGantryProcess(TRUTH, seed=0) as gantry:
        where = ("--port", gantry.port, "--range-socket", gantry.range_socket)
        drive = ("--distance-m", "0.3", "--hold-s", "3", "--keep-logs", tmp_path / "logs")
        # Enter when the place is marked, then what a rule shows of 0.3 m by 4200 steps/m.
        given = "\n0.307\n"
        result = calibrated("steps", "--rig", rig, *where, *drive, given=given)
    assert result.exit_code == 0, result.output
    assert "Mark where the carriage stands" in result.output
    known = read_rig(rig).calibration["stepper.steps_per_m"]
    assert abs(read_rig(rig).stepper.steps_per_m - 4100.0) < 3.0 * known.spread
    log = read_run_log(tmp_path / "logs" / "steps.mcap")
    assert set(log["sufferer_cmd_us"]) == {RIG.limits.pulse_us[0]}


@pytest.mark.wallclock
def test_the_log_of_a_refused_calibration_at_a_port_is_kept_and_named(files) -> None:
    rig, _ = files
    with VirtualGantryProcess(TRUTH, seed=0) as gantry:
        where = ("--port", gantry.port, "--range-socket", gantry.range_socket)
        drive = ("--distance-m", "0.1", "--hold-s", "3")
        result = calibrated("steps", "--rig", rig, *where, *drive, given="\n10.2\n")  # in cm
    assert result.exit_code == 1, result.output
    (log,) = rig.parent.glob("calibration/*-steps/*.mcap")
    assert result.output.endswith(f"Nothing was written; recorded in {log}.\n")
    assert read_run_log(log)["homed"][-1] > 0
    assert rig.read_text() == RIG_TEXT


def test_without_a_terminal_it_is_said_what_the_question_needs(files) -> None:
    rig, _ = files
    where = ("--rig", rig, "--port", os.devnull)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(calibrate_options.Request, "site", lambda *_: contextlib.nullcontext())
        result = calibrated("zero", *where)
    assert result.exit_code == 2
    assert "Aborted" not in result.output
    assert result.output.splitlines()[-1] == (
        "Error: The standard input has ended before an answer; give the command at a "
        "terminal, or a recording by --log."
    )


def test_every_attempt_has_a_folder_of_its_own_and_one_without_a_log_leaves_none(files) -> None:
    rig, _ = files
    first = calibrate_options._log_folder(rig, "zero")
    first.mkdir(parents=True)
    second = calibrate_options._log_folder(rig, "zero")
    assert (second.parent, second.name) == (first.parent, f"{first.name}-2")
    result = calibrated("zero", "--rig", rig, "--port", os.devnull + "-none", given="\n")
    assert result.exit_code == 2
    assert "recorded in" not in result.output
    assert not second.exists()


@pytest.mark.wallclock
def test_ctrl_c_lands_and_leaves_the_file_as_it_was(files, tmp_path) -> None:
    rig, _ = files
    logs = tmp_path / "logs"
    code = "from wakedeploy.cli import main; main()"
    arguments = ["calibrate", "noise", "--virtual", "--rig", rig, "--out", tmp_path / "desk.toml",
                 "--keep-logs", logs, "--wall-clock"]  # fmt: skip
    run = subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)], stdout=-1, stderr=-1, text=True
    )
    end_s = time.monotonic() + 60.0
    while not (logs / "noise.mcap").exists() or flown(logs / "noise.mcap") < 40:
        assert run.poll() is None, run.communicate()
        assert time.monotonic() < end_s, "it never flew"
        time.sleep(0.1)
    run.send_signal(signal.SIGINT)
    _, err = run.communicate(timeout=30)
    assert run.returncode == 130, err
    assert "Traceback" not in err
    assert rig.read_text() == RIG_TEXT
    log = read_run_log(logs / "noise.mcap")
    assert log["sufferer_cmd_us"][-1] == log["source_cmd_us"][-1] == RIG.limits.pulse_us[0]


def flown(path: Path) -> int:
    with contextlib.suppress(Exception):
        return int(read_run_log(path).flying.sum())
    return 0


@pytest.fixture(scope="session")
def random_flight(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "flight.mcap"
    record(RIG, seconds=20.0, seed=1).write_mcap(path)
    return path


def test_latency_from_a_log_of_any_flight_and_a_refusal_that_leaves_the_file(
    files, random_flight, tmp_path
) -> None:
    (rig, _), desk = files, tmp_path / "desk.toml"
    result = calibrated("latency", "--rig", rig, "--out", desk, "--log", random_flight)
    assert result.exit_code == 0, result.output
    text = desk.read_text()
    assert read_rig(desk).calibration["latency.round_trip_s"].spread > 0.0
    refused = calibrated(
        "thrust", "--rig", rig, "--out", desk, *["--log", random_flight] * 4, *MASSES
    )
    assert refused.exit_code == 1
    assert "Nothing was written." in refused.output
    assert refused.output.count("\n") == 1
    assert desk.read_text() == text


MASSES = ("--mass-kg", "0", "--mass-kg", "0.1", "--mass-kg", "0.2", "--mass-kg", "0")


@pytest.mark.parametrize("arguments", [("noise",), ("thrust", *MASSES), ("spool",)])
def test_nothing_flies_at_a_port_on_the_default_thrust_curve(files, arguments) -> None:
    rig, missing = files[0], os.devnull + "-not-there"
    where = ("--rig", rig, "--port", missing)
    refused = calibrated(*arguments, *where)
    assert refused.exit_code == 2
    assert f"{rig}: [thrust.sufferer] is the default gantry's estimate" in refused.output
    trusted = calibrated(*arguments, *where, "--trust-curve", given="\n")
    assert "no such port" in trusted.output
    entered = [0.9 * thrust_n for thrust_n in RIG.thrust.sufferer.thrust_n]
    RIG.changed(thrust={"sufferer": {"thrust_n": entered}}).write(rig)
    assert "no such port" in calibrated(*arguments, *where, given="\n").output


def test_a_constant_that_an_effect_replaces_is_refused(files, random_flight) -> None:
    rig, _ = files
    entry = Effect(name="range-bias", parameters={"bias_m": EffectParameter(value=0.1, unit="m")})
    RIG.model_copy(update={"effect": (entry,)}).write(rig)
    result = calibrated("zero", "--rig", rig, "--log", random_flight)
    assert result.exit_code == 2
    assert "lists the effect range-bias" in result.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("zero",), "one of --port PORT, --virtual, --log FILE"),
        (("zero", "--virtual", "--port", "x"), "one of --port"),
        (("zero", "--port", "x", "--plant-rig", "y"), "belongs to --virtual"),
        (("zero", "--virtual", "--range-socket", "y"), "belongs to --port"),
        (("zero", "--log", "x", "--keep-logs", "y"), "--keep-logs belongs"),
        (("zero", "--log", "x", "--realtime"), "--realtime belongs"),
        (("zero", "--log", "x", "--firmware"), "--firmware belongs"),
        (("range", "--virtual", "--height-m", "0"), "two or more heights"),
        (("range", "--log", "x", "--height-m", "0", "--height-m", "0.4"), "2 logs are needed"),
        (("thrust", "--virtual", "--mass-kg", "0"), "3 different masses"),
        (("thrust", "--virtual", *MASSES[:-2]), "fly the first mass again at the end"),
        (("steps", "--virtual"), "--distance-m"),
        (("steps", "--log", "x"), "give --measured-m"),
        (("steps", "--virtual", "--distance-m", "3"), "limits.x_m"),
    ],
)
def test_what_contradicts_itself_is_refused_before_anything_flies(files, arguments, words) -> None:
    result = calibrated(*arguments, "--rig", files[0], "--out", files[0].with_name("desk.toml"))
    assert result.exit_code == 2, result.output
    assert words in result.output
    assert files[0].read_text() == RIG_TEXT


@pytest.mark.parametrize("name", sorted(calibrate.command.commands))
def test_every_procedure_has_help_with_an_example(name: str) -> None:
    result = calibrated(name, "--help")
    assert result.exit_code == 0
    assert f"wakedeploy calibrate {name}" in result.output


def test_a_port_that_is_not_there_is_one_sentence(files) -> None:
    missing = os.devnull + "-not-there"
    result = calibrated("latency", "--rig", files[0], "--port", missing)
    assert result.exit_code == 2
    assert "no such port" in result.output


@pytest.mark.parametrize(
    ("factor", "port", "is_refused"),
    [
        (1.0, "/dev/ttyACM0", True),
        (1.0002, "/dev/ttyACM0", True),
        (0.993, "/dev/ttyACM0", True),
        (1.08, "/dev/ttyACM0", False),
        (1.0, None, False),
    ],
)
def test_a_rehearsal_on_the_virtual_gantry_calibrates_no_real_motor(
    factor: float, port: str | None, is_refused: bool
) -> None:
    """It finds the estimate again, but for its noise: a real sufferer may still be thrown."""
    curve = default_rig().thrust.sufferer
    thrust_n = tuple(factor * each for each in curve.thrust_n)
    rig = default_rig().changed(thrust={"sufferer": {"thrust_n": thrust_n}})
    refused = pytest.raises(UnusableInput, match="default gantry's estimate")
    with refused if is_refused else contextlib.nullcontext():
        require_curve(rig, Path("desk.toml"), port=port, trusted=False)
    require_curve(rig, Path("desk.toml"), port=port, trusted=True)
