"""`wakedeploy fly-pair` as a command: two real flights, ended in every way."""

import json
import signal
import subprocess
import sys
import time

import pytest
from click.testing import CliRunner
from growing import written_so_far

from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.cli import fly_pair, main
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.runlog import read_run_log
from wakedeploy.rig.file import default_rig

RIG = default_rig().changed(disturbance={"rest_s": 0.75})  # in which the carriage goes home
CLI = [sys.executable, "-c", "from wakedeploy.cli import main; main()", "fly-pair"]


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    RIG.write(tmp_path / "rig.toml")
    return tmp_path


def started(*arguments):
    told = [*CLI, "--rig", "rig.toml", "--out", "pair", *map(str, arguments)]
    return subprocess.Popen(told, stdin=-1, stdout=-1, stderr=-1, text=True)


@pytest.mark.whole
def test_a_virtual_pair_is_two_tied_logs_and_a_table(here):
    asked = ["--virtual", "--seconds", "8", "--seed", "2", "--json", "pair.json"]
    run = CliRunner().invoke(main, ["fly-pair", "--rig", "rig.toml", "--out", "pair", *asked])
    assert run.exit_code == 0, run.output
    assert "RMSE off [mm]" in run.output
    assert "Mean force: " in run.output
    off, on = (read_run_log(here / "pair" / f"wake-{wake}.mcap") for wake in ("off", "on"))
    assert set(off["source_cmd_us"]) == {1000.0}
    assert on["source_cmd_us"].max() > 1100.0
    assert off.metadata["pair_id"] == on.metadata["pair_id"] != ""
    assert (off.metadata["wake"], on.metadata["wake"]) == ("off", "on")
    assert (off.metadata["pair_order"], on.metadata["pair_order"]) == ("1", "2")
    assert off.metadata["seed"] == on.metadata["seed"] == "2"
    assert off.metadata["plant_seed"] != on.metadata["plant_seed"]
    aims = [
        dict(zip(log["tick"], zip(log["z_ref_m"], log["x_ref_m"], strict=True), strict=True))
        for log in (off, on)
    ]
    both = set(aims[0]) & set(aims[1])
    assert len(both) > 150
    assert all(aims[0][tick] == aims[1][tick] for tick in both)
    told = json.loads((here / "pair.json").read_text())
    assert told["pairs"][0]["pair_id"] == off.metadata["pair_id"]
    assert told["mean_n"] == told["pairs"][0]["mean_n"] < 0.0


@pytest.mark.whole
def test_ctrl_c_in_the_first_flight_keeps_it_and_flies_no_second(here):
    run = started("--virtual", "--seconds", 900)
    first, end_s = here / "pair" / "wake-off.mcap", time.monotonic() + 60.0
    while len(written_so_far(first) or ()) <= 40:
        assert time.monotonic() < end_s
        assert run.poll() is None
        time.sleep(0.05)
    run.send_signal(signal.SIGINT)
    out, err = run.communicate(timeout=60)
    assert (run.returncode, err) == (130, "Interrupted.\n")
    assert "stopped by hand" in out
    recorded = read_run_log(first)
    assert "unfinished" not in recorded.metadata
    assert recorded["mode"][-1] == "FAILSAFE"
    assert recorded["sufferer_cmd_us"][-1] == 1000.0
    assert [path.name for path in (here / "pair").iterdir()] == ["wake-off.mcap"]


@pytest.mark.wallclock
def test_at_a_port_the_operator_is_asked_between_the_flights(here):
    with VirtualGantryProcess(RIG, seed=1) as gantry:
        where = ("--port", gantry.port, "--range-socket", gantry.range_socket, "--trust-curve")
        run = started(*where, "--seconds", 6, "--pairs", 2)
        _, err = run.communicate("y\nn\n", timeout=180)  # the second flight, and no third
    assert err.count("Is the rig clear?") == 2
    assert run.returncode == 1
    assert "The flight with the wake on was not flown" in err
    logs = sorted((here / "pair").iterdir())
    assert [path.name for path in logs] == ["wake-off-01.mcap", "wake-on-01.mcap"]
    for recorded in map(read_run_log, logs):
        assert "unfinished" not in recorded.metadata
        assert "plant_seed" not in recorded.metadata
        assert recorded["mode"][-1] != "FAILSAFE"


def test_without_a_terminal_it_is_said_what_the_question_needs():
    with CliRunner().isolation(), pytest.raises(UnusableInput, match="or --yes where the rig"):
        fly_pair._ask("Is the rig clear?")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "--virtual or --port"),
        (["--virtual", "--yes"], "--yes belongs to --port"),
        (["--virtual", "--baseline", "--package", "a.onnx"], "--package FILE or --baseline"),
        (["--port", "/dev/ttyACM97", "--hooks", "a:b"], "belong to --virtual"),
        (["--port", "/dev/ttyACM97", "--trust-curve"], "no such port"),
        (["--port", "/dev/ttyACM97"], "rig.toml: [thrust.sufferer] is the default gantry's"),
    ],
)
def test_what_does_not_go_together_is_one_sentence(here, arguments, words):
    told = CliRunner().invoke(main, ["fly-pair", "--rig", "rig.toml", "--out", "pair", *arguments])
    assert told.exit_code == 2
    assert words in told.stderr
    assert told.stderr.count("\n") == 1
