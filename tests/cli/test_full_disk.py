"""A disk that is full before a command is done: one sentence, what is there is whole, and again.

The operating system limits how long a file may be, which gives the writes that a full disk gives.
"""

import contextlib
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from small_tune import FAST, small_set

from wakedeploy.cli import main
from wakedeploy.core.runlog import RunLog, read_run_log
from wakedeploy.domains.gantry import record

BYTES = 3_000


@contextlib.contextmanager
def small_disk() -> Iterator[None]:
    """No file of this process grows beyond BYTES in the block.

    Nor is bytecode written: the interpreter keeps what was cut short, and fails at the next import.
    """
    before, writes_none = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    sys.dont_write_bytecode = True
    resource.setrlimit(resource.RLIMIT_FSIZE, (BYTES, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = writes_none


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def flight() -> RunLog:
    return record(None, seconds=8, seed=0)


@pytest.fixture
def inputs(tmp_path: Path, flight: RunLog) -> Path:
    small_set().write(tmp_path / "set")
    flight.write_mcap(tmp_path / "flight.mcap")
    return tmp_path


COMMANDS = {
    "train": ("train", "--data", "set", "--arch", "gru", "--epochs", 1, "--out", "out"),
    "tune": (*("tune", "--data", "set", "--arch", "gru", "--epochs", 1), *("--trials", 2),
             *("--out", "out"), *FAST),
    "data": ("data", "make", "gantry", "--minutes", 0.4, "--out", "out"),
    "log": ("log", "export", "flight.mcap", "--out", "out.csv"),
    "picture": ("log", "show", "flight.mcap", "--png", "out.png"),
    "json": ("rig", "show", "--json", "out.json"),
}  # fmt: skip
FILE = {
    "train": "best.safetensors", "tune": "study.journal", "data": ".npz", "log": "out.csv",
    "picture": "out.png", "json": "out.json",
}  # fmt: skip


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(name, marks=pytest.mark.whole) if name in ("data", "picture") else name
        for name in COMMANDS
    ],
)
def test_a_full_disk_is_one_sentence_and_the_command_is_given_again(command, inputs, monkeypatch):
    monkeypatch.chdir(inputs)
    monkeypatch.setattr(sys.modules[__name__], "BYTES", 1_000 if command == "json" else BYTES)
    monkeypatch.setattr("wakedeploy.domains.gantry.EPISODE_S", 8.0)
    with small_disk():
        done = run(*COMMANDS[command])
    assert done.exit_code in (1, 2), done.output
    (told,) = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert FILE[command] in told
    assert "File too large" in told
    assert told.endswith("; free some space there, then give the same command again.")
    assert "Traceback" not in done.output
    assert not [path for path in inputs.rglob("*") if ".unfinished-" in path.name]
    again = run(*COMMANDS[command])
    assert again.exit_code == 0, again.output


@pytest.mark.whole
def test_a_flight_whose_disk_is_full_is_brought_down_and_readable_up_to_there(inputs, monkeypatch):
    monkeypatch.chdir(inputs)
    fly = ("run-gantry", "--virtual", "--baseline", "--seconds", 12, "--log", "logs")
    monkeypatch.setattr(sys.modules[__name__], "BYTES", 60_000)
    with small_disk():
        done = run(*fly)
    assert done.exit_code == 1
    assert "recording stopped: File too large (free some space there" in done.stderr
    assert "ticks are in the log" in done.stderr
    (left,) = (inputs / "logs").iterdir()
    assert len(read_run_log(left)) > 0
    assert "failsafe" in " ".join(done.stdout.split())
    assert run(*fly).exit_code == 0


def test_several_flights_without_room_are_told_of_their_folder(inputs, monkeypatch):
    monkeypatch.chdir(inputs)
    fly = ("run-gantry", "--virtual", "--baseline", "--seconds", 6)
    several = (*fly, "--flights", 3, "--log", "tf/fl")
    monkeypatch.setattr(sys.modules[__name__], "BYTES", 200)
    with small_disk():
        done, alone = run(*several), run(*fly, "--log", "a.mcap")
    assert (done.exit_code, alone.exit_code) == (2, 2), done.output
    assert done.stderr.splitlines()[-1] == (
        "Error: tf/fl: the logs of these flights have no room (File too large); free some space "
        "there, then name another folder for --log, as this one keeps what it has."
    )
    assert "a.mcap: no run log can be written there (File too large); free some" in alone.stderr
    assert run(*several).exit_code == 0
    again = run(*several)
    assert again.exit_code == 2
    assert ".mcap: there is already a recording; name another folder for --log." in again.stderr


@pytest.mark.parametrize("arguments", [["--help"], ["train", "--help"], ["rig", "show"]])
def test_an_output_that_cannot_be_written_is_one_sentence(arguments):
    if not Path("/dev/full").is_char_device():
        pytest.skip("this system has no /dev/full")
    with Path("/dev/full").open("w") as nowhere:
        done = subprocess.run(
            [sys.executable, "-m", "wakedeploy", *arguments],
            stdout=nowhere, stderr=subprocess.PIPE, text=True, check=False, timeout=60,
        )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith("Error: a file or the standard output: No space left on device")
    assert len(done.stderr.splitlines()) == 1
