"""The command line as a whole: what it loads, how it fails, what its exit status says."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from every_command import EVERY

import wakedeploy
from wakedeploy import cli
from wakedeploy.core.errors import CheckFailed, UnusableInput

HEAVY = [
    "torch", "numpy", "scipy", "onnx", "onnxruntime", "optuna", "numba", "pandas", "matplotlib",
    "plotly", "filterpy", "pydantic", "mcap", "serial", "rich", "safetensors", "sympy", "jinja2",
]  # fmt: skip


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )


def test_help_loads_no_heavy_library() -> None:
    ended = run_python(
        "import sys\nfrom wakedeploy.cli import main\n"
        "main(['--help'], standalone_mode=False)\n"
        f"print('LOADED', [name for name in {HEAVY} if name in sys.modules])"
    )
    assert "LOADED []" in ended.stdout


@pytest.mark.parametrize("path", [(), *EVERY], ids=" ".join)
def test_every_command_explains_itself_with_an_example(path: tuple[str, ...]) -> None:
    result = CliRunner().invoke(cli.main, [*path, "--help"], prog_name="wakedeploy")
    assert result.exit_code == 0
    command = EVERY.get(path, cli.main)
    if not isinstance(command, click.Group) or len(path) == 1:
        _, _, example = result.output.split("Options:")[0].partition("\n  Example:\n")
        assert " ".join(["wakedeploy", *path]) in example, "the help text has no example"


def test_the_version_is_the_packages() -> None:
    result = CliRunner().invoke(cli.main, ["--version"])
    assert result.output.strip() == f"wakedeploy, version {wakedeploy.__version__}"


def test_running_the_module_is_the_command() -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "wakedeploy", "nonsense"],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert ended.returncode == 2
    assert "wakedeploy --help" in ended.stderr
    assert "No such command 'nonsense'" in ended.stderr


@pytest.mark.parametrize(
    "arguments",
    [["data", "make"], ["data", "make", "gantry"], ["data", "show"], ["rig", "show", "--nonsense"],
     ["data", "make", "gantry", "--out", "x", "--minutes", "-1"],
     ["data", "make", "gantry", "--out", "x", "--seed", "many"]],
)  # fmt: skip
def test_wrong_arguments_end_with_2(arguments: list[str]) -> None:
    assert CliRunner().invoke(cli.main, arguments).exit_code == 2


def failing_with(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    @click.command()
    def command() -> None:
        raise error

    monkeypatch.setattr(cli._Commands, "get_command", lambda *_: command)


@pytest.mark.parametrize(
    ("error", "status", "told"),
    [
        (UnusableInput("a.toml: [wake] speed_mps = -1."), 2, "a.toml: [wake] speed_mps = -1."),
        (CheckFailed("Parity\nwas missed."), 1, "Parity was missed."),
        (
            OSError(28, "No space left on device", "x.mcap"),
            1,
            "x.mcap: No space left on device; free some space there",
        ),
        (PermissionError(13, "Permission denied", "/etc/x"), 2, "/etc/x: Permission denied; name"),
        (ModuleNotFoundError("no torch", name="torch"), 2, "constraints.txt '.[train]'"),
        (ModuleNotFoundError("no mcap", name="mcap"), 2, "mcap is not installed"),
        (ZeroDivisionError("division by zero"), 1, "unexpected ZeroDivisionError"),
    ],
)
def test_a_failure_is_one_line_and_a_status(
    error: Exception, status: int, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing_with(error, monkeypatch)
    result = CliRunner().invoke(cli.main, ["doctor"])
    assert result.exit_code == status
    assert told in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert "Traceback" not in result.stderr


def test_the_traceback_comes_with_debug_only(monkeypatch: pytest.MonkeyPatch) -> None:
    failing_with(UnusableInput("No."), monkeypatch)
    result = CliRunner().invoke(cli.main, ["--debug", "doctor"])
    assert isinstance(result.exception, UnusableInput)


def test_what_a_library_makes_of_an_interruption_is_one_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    try:
        try:
            raise KeyboardInterrupt
        finally:
            raise AttributeError("module 'torch' has no attribute 'half'")
    except AttributeError as cause:
        error = RuntimeError("Failed to export the model.")
        error.__cause__ = cause
    failing_with(error, monkeypatch)
    result = CliRunner().invoke(cli.main, ["doctor"])
    assert (result.exit_code, result.stderr) == (130, "Interrupted.\n")


@pytest.mark.parametrize("where", ["get_command", "parse_args", "resolve_command"])
def test_interrupting_ends_with_130(where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    failing_with(KeyboardInterrupt(), monkeypatch)
    monkeypatch.setattr(cli._Commands, where, interrupted)
    result = CliRunner().invoke(cli.main, ["doctor"])
    assert (result.exit_code, result.stderr) == (130, "Interrupted.\n")


WAITING = """
import time
import click
from wakedeploy import cli

def wait():
    print("begun", flush=True)
    time.sleep(600.0)

cli._Commands.get_command = lambda *_: click.Command("doctor", callback=wait)
cli.main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_program_that_is_asked_to_stop_says_one_word(number: signal.Signals) -> None:
    run = subprocess.Popen(
        [sys.executable, "-c", WAITING, "doctor"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert run.stdout is not None
    try:
        assert run.stdout.readline() == "begun\n"
        run.send_signal(number)
        _, said = run.communicate(timeout=60)
    finally:
        run.kill()
    assert (run.returncode, said) == (130, "Interrupted.\n")


def test_a_closed_pipe_is_no_error(tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    ended = subprocess.run(
        [sys.executable, "-m", "wakedeploy", "rig", "show"],
        stdout=write, stderr=subprocess.PIPE, text=True, check=False, timeout=60,
    )  # fmt: skip
    os.close(write)
    assert "Traceback" not in ended.stderr
    assert "unexpected" not in ended.stderr


def test_a_rig_file_is_started_and_checked(tmp_path: Path) -> None:
    path, runner = tmp_path / "rig.toml", CliRunner()
    assert runner.invoke(cli.main, ["rig", "init", str(path)]).exit_code == 0
    shown = runner.invoke(cli.main, ["rig", "show", str(path), "--json", str(tmp_path / "r.json")])
    assert shown.exit_code == 0
    assert "sufferer.mass_kg" in shown.output
    assert json.loads((tmp_path / "r.json").read_text())["rig"]["schema"] == 1
    again = runner.invoke(cli.main, ["rig", "init", str(path)])
    assert again.exit_code == 2
    assert "exists already" in again.stderr
    path.write_text(path.read_text().replace("[sufferer]", "[sufferer]\nwings = 2", 1))
    wrong = runner.invoke(cli.main, ["rig", "show", str(path)])
    assert wrong.exit_code == 2
    assert "wings" in wrong.stderr
