"""The commands that serve pages: what they refuse in a sentence, and a whole flight with STOP."""

import re
import socket
import subprocess
import sys
import time

import pytest
from click.testing import CliRunner
from pages import RIG, Client

from benchmarks.live import PAGES
from benchmarks.results.live import live
from wakedeploy.cli import main
from wakedeploy.core.runlog import read_run_log
from wakedeploy.domains.gantry import record

FLY = ["run-gantry", "--baseline", "--virtual"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([*FLY, "--live", "--flights", "2"], "--live shows a single flight"),
        ([*FLY, "--live-token", "x"], "--live-token belongs to --live"),
        ([*FLY, "--live", "nowhere"], "nowhere: is no address to serve a page at"),
        ([*FLY, "--live", "0.0.0.0:0"], "other computers reach this address"),
        (["live", "none.mcap"], "there is no such file in "),
    ],
)
def test_what_cannot_be_served_is_a_sentence(words, sentence):
    told = CliRunner().invoke(main, words)
    assert told.exit_code == 2
    assert sentence in told.output


@pytest.mark.parametrize("words", [[*FLY, "--live"], ["live", "x"], ["log", "browse", "."]])
def test_without_the_extra_one_sentence_says_what_to_install(words, monkeypatch):
    whole = __import__("importlib.util").util.find_spec
    monkeypatch.setattr(
        "importlib.util.find_spec", lambda name, *more: None if name == "tornado" else whole(name)
    )
    told = CliRunner().invoke(main, words)
    assert told.exit_code == 2
    assert "tornado, which is not installed" in told.output
    assert "'.[live]'" in told.output
    assert told.output.count("\n") == 1


def test_nothing_of_the_web_is_in_the_process_that_flies():
    code = (
        "import sys, wakedeploy.cli.run_gantry, wakedeploy.live.process, runtime.run;"
        "print(sorted({m.split('.')[0] for m in sys.modules} & {'tornado', 'asyncio', 'http',"
        "'jinja2', 'foxglove'}))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "tornado" not in told.stdout
    assert "http" not in told.stdout
    assert "jinja2" not in told.stdout
    assert "foxglove" not in told.stdout


def test_the_results_say_what_a_record_has():
    spread = {"p50": 0.5, "p99": 1.0, "p999": 1.5, "max": 2.0}
    flown = {"compute_ms": spread, "wake_up_ms": spread, "dropped": 3}
    added = {name: [0.1, 0.02] for name in spread}

    class Records:
        def json(self, name):
            return {
                "pages": PAGES, "seconds": 60, "pairs": [{"0": flown, f"{PAGES}": flown}],
                "put_us": {"p50": 18.3}, "added_compute_ms": added, "added_wake_up_ms": added,
                "list": {"logs": 1000, "read_s": 31.0, "from_cache_s": 0.02},
            }  # fmt: skip

    section = live(Records())
    assert "| computing, p99.9 | 1.50 | 1.50 | +0.10 ± 0.02 |" in section.body
    (line,) = section.commands
    assert "--pairs 1 --seconds 60 --logs 1000 " in line
    assert "3 rows were dropped" in section.body
    assert "1,000 flights in 31 s, once; from then on it lists them in 0.02 s" in section.body


@pytest.mark.wallclock
def test_a_flight_is_stopped_from_its_page_and_its_log_is_whole(tmp_path):
    RIG.write(tmp_path / "rig.toml")
    log = tmp_path / "flight.mcap"
    line = [sys.executable, "-m", "wakedeploy", *FLY, "--rig", str(tmp_path / "rig.toml")]
    line += ["--seconds", "60", "--log", str(log), "--live", "127.0.0.1:0"]
    with subprocess.Popen(line, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as run:
        client = Client(re.search(r"http://\S+", run.stderr.readline()).group())
        while not log.exists():
            time.sleep(0.05)
        time.sleep(5.0)
        headers = {"Origin": f"http://{client.host}", "Authorization": f"Bearer {client.token}"}
        assert client.ask("POST", "/stop", **headers)[0] == 200
        out, _ = run.communicate(timeout=30)
    assert run.returncode == 130
    assert "stopped by hand" in out
    flown = read_run_log(log)
    assert flown["mode"][-1] == "FAILSAFE"
    assert "operator_stop" in flown["faults"][-1]
    assert flown["sufferer_cmd_us"][-1] == 1000.0
    assert "unfinished" not in flown.metadata


def test_a_replay_says_what_a_long_log_takes_its_time_for(tmp_path, monkeypatch):
    """An hour of flight is read and smoothed for a minute before there is a page."""
    log = tmp_path / "flight.mcap"
    record(None, seconds=8, seed=0).write_mcap(log)
    monkeypatch.setattr("wakedeploy.cli.log_lines._SILENT_S", 0.0)
    monkeypatch.setattr("wakedeploy.live.replay.replay", lambda read, *served: read())
    told = CliRunner().invoke(main, ["live", str(log)])
    assert told.exit_code == 0
    assert "Reading the log: done" in told.stderr
    assert "Smoothing the force: done" in told.stderr


def test_a_port_that_is_taken_is_told_before_a_long_log_is_read(tmp_path):
    log = tmp_path / "flight.mcap"
    log.write_bytes(b"no log: reading it would say so")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        place = f"127.0.0.1:{taken.getsockname()[1]}"
        told = CliRunner().invoke(main, ["live", str(log), "--listen", place])
    assert told.exit_code == 2
    assert told.stderr.startswith(f"Error: {place}: no page can be served there (Address already")
    assert "Reading the log" not in told.stderr


def test_a_socket_at_which_a_page_is_served_is_left_to_it(tmp_path):
    log, place = tmp_path / "flight.mcap", tmp_path / "live"
    log.write_bytes(b"no log: reading it would say so")
    with socket.socket(socket.AF_UNIX) as served:
        served.bind(str(place))
        served.listen()
        told = CliRunner().invoke(main, ["live", str(log), "--listen", str(place)])
        assert told.exit_code == 2
        assert told.stderr.startswith(f"Error: {place}: no page can be served there (another is)")
        assert told.stderr.count("\n") == 1
        with socket.socket(socket.AF_UNIX) as visitor:
            visitor.connect(str(place))


def test_a_log_that_cannot_be_read_leaves_no_socket(tmp_path):
    log, place = tmp_path / "flight.mcap", tmp_path / "live"
    log.write_bytes(b"no log")
    with socket.socket(socket.AF_UNIX) as killed:  # its file stays, and nobody answers there
        killed.bind(str(place))
    told = CliRunner().invoke(main, ["live", str(log), "--listen", str(place)])
    assert told.exit_code == 2
    assert str(log) in told.stderr
    assert not place.exists()


def test_a_file_that_is_no_socket_is_kept(tmp_path):
    log, place = tmp_path / "flight.mcap", tmp_path / "notes"
    log.write_bytes(b"no log")
    place.write_text("kept")
    told = CliRunner().invoke(main, ["live", str(log), "--listen", str(place)])
    assert told.exit_code == 2
    assert f"{place}: is a file, and no socket" in told.stderr
    assert place.read_text() == "kept"
