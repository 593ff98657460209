"""Several processes on one study: `wakedeploy tune` killed, interrupted, and gone on with."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import optuna
import pytest
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState
from said import sentences
from small_tune import FAST, LIMIT_S, one_line, small_set, tune

from trainers.tuning.report import Row, rows_of

SLOW = ("--dimension", "hidden=130:140", "--dimension", "chunk_steps=16:20")  # seconds a trial


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tune") / "set"
    small_set().write(folder)
    return folder


def study_in(out: Path) -> optuna.Study | None:
    """The study as any other program of Optuna's would read it, once it is there."""
    if not (out / "study.journal").exists():
        return None
    storage = JournalStorage(JournalFileBackend(str(out / "study.journal")))
    studies = storage.get_all_studies()
    if not studies:
        return None
    return optuna.load_study(study_name=studies[0].study_name, storage=storage)


def in_training(out: Path) -> list[FrozenTrial]:
    """The trials that have an epoch behind them and more before."""
    study = study_in(out)
    trials = [] if study is None else study.get_trials(states=(TrialState.RUNNING,))
    return [trial for trial in trials if trial.intermediate_values]


def until(what: Callable[[], object]) -> None:
    end = time.monotonic() + LIMIT_S
    while not what():
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.05)


def killed_in_training(out: Path) -> FrozenTrial:
    """A trial whose process was killed in the middle of it, however slow this machine is now."""
    while True:
        until(lambda: in_training(out))
        victim = in_training(out)[0]
        pid = victim.user_attrs["worker"]["pid"]
        os.kill(pid, signal.SIGSTOP)
        until(lambda pid=pid: Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2][1] == "T")
        if victim.number in [trial.number for trial in in_training(out)]:
            os.kill(pid, signal.SIGKILL)
            return victim
        os.kill(pid, signal.SIGCONT)


@pytest.fixture
def started(data: Path) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    running: list[subprocess.Popen[str]] = []

    def start(out: Path, *others: object) -> subprocess.Popen[str]:
        asked = ["tune", "--arch", "gru", "--data", data, "--out", out, *others]
        process = subprocess.Popen(
            [sys.executable, "-m", "wakedeploy", *map(str, asked)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        running.append(process)
        return process

    yield start
    for process in running:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def rows_in(out: Path) -> list[Row]:
    study = study_in(out)
    assert study is not None
    return rows_of(study)


@pytest.mark.slow
def test_a_killed_worker_loses_one_trial_and_ctrl_c_none(
    data: Path, tmp_path: Path, started: Callable[..., subprocess.Popen[str]]
) -> None:
    out = tmp_path / "out"
    asked = ("--epochs", 12, "--pruner", "none", *SLOW)
    process = started(out, "--trials", 10, "--workers", 2, *asked)
    until(lambda: len(in_training(out)) == 2)
    assert len({trial.user_attrs["worker"]["pid"] for trial in in_training(out)}) == 2
    victim = killed_in_training(out)
    until(lambda: any(row.state == "lost" for row in rows_in(out)))
    until(lambda: len(in_training(out)) == 2)  # another worker took its place
    os.killpg(process.pid, signal.SIGINT)  # as the terminal does it, to every process
    printed, complained = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 130, complained
    assert printed == ""
    (sentence,) = sentences(complained)
    assert "the same command goes on" in sentence
    rows = rows_in(out)
    assert [row.number for row in rows if row.state == "lost"] == [victim.number]
    assert any(row.state == "interrupted" for row in rows), rows
    assert all(
        row.reason.endswith("begun again") for row in rows if row.state in ("lost", "interrupted")
    )
    finished = sum(row.state == "finished" for row in rows)
    ended = tune(data, out, "--trials", finished + 1, *asked)
    assert ended.exit_code == 0, ended.output
    after = rows_in(out)
    fresh = [row for row in after[: len(rows)] if row not in rows]
    assert "finished" in [row.state for row in fresh]  # one that waited to be begun again
    assert sum(row.state == "finished" for row in after) == finished + 1
    assert not any(row.state == "running" for row in after)


@pytest.mark.whole
def test_a_tune_killed_whole_is_gone_on_with_by_the_next(
    data: Path, tmp_path: Path, started: Callable[..., subprocess.Popen[str]]
) -> None:
    out = tmp_path / "out"
    asked = ("--epochs", 6, "--pruner", "none", *SLOW)
    process = started(out, "--trials", 50, *asked)
    victim = killed_in_training(out)
    process.communicate()
    before = rows_in(out)
    assert before[victim.number].state == "running"
    ended = tune(data, out, "--trials", len(before), *asked)
    assert ended.exit_code == 0, ended.output
    after = rows_in(out)
    assert [row.state for row in after] == [
        "lost" if row.number == victim.number else "finished" for row in after
    ]
    assert len(after) == len(before) + 1
    assert after[-1].point == after[victim.number].point


def test_what_another_machine_never_finished_is_begun_again_when_it_is_asked_for(
    data: Path, tmp_path: Path
) -> None:
    out, asked = tmp_path / "out", ("--epochs", 1, *FAST)
    assert tune(data, out, "--trials", 1, *asked).exit_code == 0
    study = study_in(out)
    assert study is not None
    gone = study.ask()
    hidden = gone.suggest_int("hidden", 4, 9, log=True)
    gone.set_user_attr("worker", {"host": "gone-7", "machine": "0", "pid": 1, "born": "0-0"})
    told = tune(data, out, "--trials", 2, *asked)
    assert told.exit_code == 0, told.output
    assert "Still in training on gone-7: 1 of the trials; the same command" in one_line(told)
    assert "with --give-up-elsewhere begins again what other machines will not finish" in (
        one_line(told)
    )
    assert [row.state for row in rows_in(out)] == ["finished", "running"]
    again = tune(data, out, "--trials", 2, "--give-up-elsewhere", *asked)
    assert again.exit_code == 0, again.output
    assert "Still in training" not in again.output
    rows = rows_in(out)
    assert [row.state for row in rows] == ["finished", "lost", "finished"]
    assert (rows[1].reason, rows[2].point["hidden"]) == ("its process ended; begun again", hidden)
