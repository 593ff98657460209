"""In a pipe, commands that take their time tell on stderr how far they are."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from wakedeploy.cli import log_lines, main
from wakedeploy.domains.gantry import record


@pytest.fixture(autouse=True)
def everything_takes_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_lines, "_SILENT_S", 0.0)


def piped(*arguments: object) -> Result:
    done = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert done.exit_code in (0, 1), done.output  # 1: a machine on which something is broken
    assert "left" not in done.stdout
    return done


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    paths = [tmp_path_factory.mktemp("flights") / f"flight{n}.mcap" for n in range(3)]
    for seed, path in enumerate(paths):
        record(None, seconds=8, seed=seed).write_mcap(path)
    return paths


@pytest.mark.whole
def test_simulation_tells_how_far_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wakedeploy.domains.gantry.EPISODE_S", 8.0)
    done = piped("data", "make", "gantry", "--out", tmp_path / "set", "--minutes", "0.4")
    told = [line for line in done.stderr.splitlines() if line.startswith("Simulating")]
    far = re.compile(r"Simulating: \d+ %, (about \d+ s left|\d+ s so far)")  # as fast as it is here
    assert any(far.fullmatch(line) for line in told), done.stderr
    assert told[-1].startswith("Simulating: done in ")
    assert len(told) <= 12


@pytest.mark.whole
def test_logs_are_read_and_smoothed_aloud(flights: list[Path], tmp_path: Path) -> None:
    done = piped("log", "show", *flights, "--no-picture")
    assert "Reading the logs: done in " in done.stderr
    done = piped("log", "smooth", *flights, "--out", tmp_path / "set")
    assert "Smoothing: done in " in done.stderr


def test_this_machine_is_looked_at_aloud() -> None:
    assert "Looking at this machine: done in " in piped("doctor").stderr
