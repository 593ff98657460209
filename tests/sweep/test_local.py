"""Sweeps on this machine: rows as jobs finish, nothing twice, failures told, resumed."""

import csv
import dataclasses
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import Result
from said import sentences

from trainers.trained_run import load_run
from trainers.training.trainer import configure, settings_for, train
from wakedeploy.core.episodes import EpisodeSet, read_episode_set
from wakedeploy.sweep.executor import ATTEMPTS, LocalProcesses
from wakedeploy.sweep.generate import Generate
from wakedeploy.sweep.jobs import Job, Outcome, TrainJob, do, failure, train_jobs
from wakedeploy.sweep.plan import Choice, Plan, read_plan
from wakedeploy.sweep.run import Report, sweep

GRID = ("--arch", "agile-mlp,gru", "--seeds", 2, "--epochs", 1, "--hyper", "gru.hidden=4,8")


def test_one_row_per_job_with_the_scores_that_train_tells(
    small: Path, tmp_path: Path, wakedeploy: Callable, lines: Callable
) -> None:
    out = tmp_path / "out"
    told = wakedeploy("sweep", "--data", small, *GRID, "--out", out, "--workers", 1,
                      "--json", tmp_path / "told.json")  # fmt: skip
    assert told.exit_code == 0, told.output
    assert "6 of 6 jobs are done; 6 were run now" in told.output
    rows = lines(out)
    assert len({row["identity"] for row in rows}) == len(rows) == 6
    assert json.loads((tmp_path / "told.json").read_text())["rows"] == rows
    data = read_episode_set(small)
    (row,) = [r for r in rows if r["hyper"].get("hidden") == 8 and r["arch"] == "gru" and r["seed"]]
    config = configure(data, "gru", seed=1, lead_s=0.0, hyper={"hidden": 8},
                       settings=settings_for("gru", epochs=1))  # fmt: skip
    run = train(config, data, tmp_path / "alone")
    assert row["test"] == run.metrics.test.model_dump()
    assert row["validation"] == run.metrics.validation.model_dump()
    assert row["data_sha256"] == data.sha256
    assert (row["trainable"], row["device"], row["state"]) == (run.metrics.trainable, "cpu", "done")
    assert {"seconds", "host", "commit", "wakedeploy", "python", "finished_utc"} <= set(row)
    assert load_run(out / row["run"]).metrics.weights_sha256 == run.metrics.weights_sha256
    table = list(csv.DictReader((out / "results.csv").open(newline="")))
    assert [float(line["test.rmse.f_n"]) for line in table] == [
        r["test"]["rmse"]["f_n"] for r in rows
    ]


def test_asked_again_only_what_is_missing_is_done_and_rows_stay(
    small: Path, tmp_path: Path, wakedeploy: Callable, lines: Callable
) -> None:
    out, asked = tmp_path / "out", ("sweep", "--data", small, "--epochs", 1, "--workers", 1)
    assert wakedeploy(*asked, "--arch", "agile-mlp", "--out", out).exit_code == 0
    first = lines(out)
    more = wakedeploy(*asked, "--arch", "agile-mlp,history-mlp", "--lead", "0,0.1", "--out", out)
    assert "4 of 4 jobs are done; 3 were run now" in more.output
    assert lines(out)[:1] == first
    fewer = wakedeploy(*asked, "--arch", "history-mlp", "--out", out)
    assert "1 of 1 jobs are done; 0 were run now" in fewer.output
    assert len(lines(out)) == 4
    assert len(list(csv.DictReader((out / "results.csv").open(newline="")))) == 4


def be_of(monkeypatch: pytest.MonkeyPatch, commit: str) -> None:
    for module in ("wakedeploy.sweep.jobs", "wakedeploy.core.commit"):
        monkeypatch.setattr(f"{module}.present_commit", lambda: commit)


def test_rows_of_another_commit_are_kept_and_told_of(
    small: Path, tmp_path: Path, wakedeploy: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, asked = tmp_path / "out", ("sweep", "--data", small, "--epochs", 1, "--arch", "agile-mlp")
    be_of(monkeypatch, "abc-dirty")

    def sweep_with(seeds: int) -> Result:
        jobs = Instant(lambda job: failure(job, "never mind"))
        monkeypatch.setattr("wakedeploy.sweep.executor.LocalProcesses", lambda *_: jobs)
        return wakedeploy(*asked, "--seeds", seeds, "--out", out)

    assert "of another commit" not in sweep_with(2).stderr
    assert "of another commit" not in sweep_with(2).stderr
    be_of(monkeypatch, "def")
    told = sweep_with(3)
    assert "; 1 were run now" in told.output
    assert (
        "Rows are of another commit than this one, def: 2 by abc-dirty; a new --out, on workers of"
        " this commit, does their jobs again.\n" in told.stderr
    )
    be_of(monkeypatch, "")
    assert "of another commit" not in sweep_with(1).stderr


def test_another_set_in_the_same_folder_is_other_jobs(
    small: Path, tmp_path: Path, wakedeploy: Callable, make_small: Callable, lines: Callable
) -> None:
    out = tmp_path / "out"
    asked = ("sweep", "--data", small, "--arch", "agile-mlp", "--epochs", 1, "--out", out)
    assert wakedeploy(*asked).exit_code == 0
    make_small(seed=1).write(small)
    assert wakedeploy(*asked).exit_code == 0
    assert len({row["data_sha256"] for row in lines(out)}) == 2


PLAN = """
data = ["short"]
arch = "agile-mlp"
seeds = 2
[settings]
epochs = 1
[[generate]]
name = "short"
domain = "gantry"
minutes = 0.5
"""


@pytest.mark.slow
def test_a_generated_set_is_trained_on_and_made_again_where_it_is_gone(
    tmp_path: Path, wakedeploy: Callable, lines: Callable
) -> None:
    plan, out = tmp_path / "plan.toml", tmp_path / "out"
    plan.write_text(PLAN)
    told = wakedeploy("sweep", plan, "--out", out, "--workers", 1)
    assert told.exit_code == 0, told.output
    made, *trained = lines(out)
    assert (made["kind"], made["domain"], made["minutes"]) == ("generate", "gantry", 0.5)
    data = read_episode_set(out / "sets" / "short")
    assert {row["data_sha256"] for row in [made, *trained]} == {data.sha256}
    assert [row["seed"] for row in trained] == [0, 1]
    assert "; 0 were run now" in wakedeploy("sweep", plan, "--out", out).output
    shutil.rmtree(out / "sets")
    again = wakedeploy("sweep", plan, "--out", out, "--workers", 1)
    assert "3 of 3 jobs are done; 1 were run now" in again.output
    assert len(lines(out)) == 3


class Instant:
    """An executor that has what became of every job at hand."""

    def __init__(self, outcome: Callable[[Job], Outcome]) -> None:
        self.outcome, self.jobs = outcome, list[Job]()

    def submit(self, job: Job) -> None:
        self.jobs.append(job)

    def finished(self) -> Iterator[tuple[Job, Outcome]]:
        while self.jobs:
            job = self.jobs.pop(0)
            yield job, self.outcome(job)

    def cancel(self) -> None:
        self.jobs.clear()


def made_of(data: EpisodeSet, lines: Callable, out: Path) -> Instant:
    """An executor that "simulates" this set, and only if the folder has none."""

    def outcome(job: Job) -> Outcome:
        if isinstance(job, TrainJob):
            return do(job, data)
        assert not lines(out), "the set is simulated again"
        return Outcome(job.request | {"state": "done", "data_sha256": data.sha256}, made=data)

    return Instant(outcome)


def test_a_generated_set_that_is_damaged_is_made_again(
    make_small: Callable, tmp_path: Path, lines: Callable
) -> None:
    data, out = make_small(), tmp_path / "out"
    asked = Plan({}, (), (Generate("short", "gantry", 0.5, 0, {}),))

    def outcome(job: Job) -> Outcome:
        return Outcome(job.request | {"state": "done", "data_sha256": data.sha256}, made=data)

    assert sweep(asked, out, Instant(outcome)).begun == 1
    assert sweep(asked, out, Instant(outcome)).begun == 0
    first = min((out / "sets" / "short").glob("*.npz"))
    whole = first.read_bytes()
    first.write_bytes(whole[:100])
    assert sweep(asked, out, Instant(outcome)).begun == 1
    assert first.read_bytes() == whole
    assert len(lines(out)) == 1


def test_a_generated_set_too_small_to_validate_on_is_kept_and_its_trainings_fail(
    tmp_path: Path, unvalidated: EpisodeSet, lines: Callable
) -> None:
    (tmp_path / "plan.toml").write_text(PLAN)
    plan, out = read_plan(tmp_path / "plan.toml"), tmp_path / "out"
    report = sweep(plan, out, made_of(unvalidated, lines, out))
    made, *unfit = rows = lines(out)
    assert (made["kind"], made["state"]) == ("generate", "done")
    assert read_episode_set(out / "sets" / "short").sha256 == unvalidated.sha256
    assert [(row["state"], row["arch"], row["seed"]) for row in unfit] == [
        ("failed", "agile-mlp", seed) for seed in range(2)
    ]
    for row in unfit:
        assert "short: This toy set has no episode in its 'validation' split" in row["reason"]
    assert (report.rows, report.failed, report.waiting, report.begun) == (rows, unfit, 0, 1)
    again = sweep(plan, out, made_of(unvalidated, lines, out))
    assert (again.rows, again.begun, lines(out)) == (rows, 0, rows)
    assert sweep(plan, out, made_of(unvalidated, lines, out), retry_failed=True).begun == 0
    assert [row["state"] for row in lines(out)] == ["done"] + ["failed"] * 4


def test_only_the_trainings_that_do_not_fit_a_generated_set_fail(
    tmp_path: Path, make_small: Callable, lines: Callable
) -> None:
    text = PLAN.replace("seeds = 2", "lead = [0.0, 3.9]")
    (tmp_path / "plan.toml").write_text(text)
    plan, out = read_plan(tmp_path / "plan.toml"), tmp_path / "out"
    seen: list[tuple[int, int]] = []
    tell = lambda done, total: seen.append((done, total))  # noqa: E731
    report = sweep(plan, out, made_of(make_small(), lines, out), on_progress=tell)
    assert [(row["kind"], row["state"]) for row in report.rows] == [
        ("generate", "done"), ("train", "done"), ("train", "failed")
    ]  # fmt: skip
    assert [row["lead_s"] for row in report.rows[1:]] == [0.0, 3.9]
    assert seen[-1] == (3, 3)


# Each update takes learning rate × decay of a weight away: all of it ten times over is nine times
# the weight the other way round, which no float holds for long.
DIVERGING = """
data = "small"
arch = "agile-mlp"
[settings]
epochs = 3
batch = 4
learning_rate = 1
weight_decay = [10, 0]
"""


def test_a_diverged_job_is_a_row_and_the_others_go_on(
    small: Path, tmp_path: Path, wakedeploy: Callable, lines: Callable
) -> None:
    (tmp_path / "plan.toml").write_text(DIVERGING)
    asked, out = ("sweep", tmp_path / "plan.toml", "--workers", 1), tmp_path / "out"
    told = wakedeploy(*asked, "--out", out)
    assert told.exit_code == 1
    assert "1 jobs failed; the first, agile-mlp on" in told.output
    bad, good = sorted(lines(out), key=lambda row: row["state"] == "done")
    assert bad["state"] == "failed"
    assert bad["reason"].startswith("training diverged in epoch")
    assert good["state"] == "done"
    again = wakedeploy(*asked, "--out", out)
    assert again.exit_code == 1
    assert "; 0 were run now" in again.output
    assert len(lines(out)) == 2
    retried = wakedeploy(*asked, "--out", out, "--retry-failed")
    assert retried.exit_code == 1
    assert [row["state"] for row in lines(out)].count("failed") == 2
    assert len(list(csv.DictReader((out / "results.csv").open(newline="")))) == 2


@pytest.fixture
def jobs(small: Path) -> list[TrainJob]:
    choices = [Choice("agile-mlp", seed, None, {"epochs": 1}, {}) for seed in range(2)]
    return train_jobs("small", small, read_episode_set(small), choices, device="cpu")


def test_the_lead_is_the_rigs_unless_another_is_asked_for(small: Path) -> None:
    data = dataclasses.replace(read_episode_set(small), provenance={"default_lead_s": 0.05})
    choices = [Choice("agile-mlp", 0, lead_s, {"epochs": 1}, {}) for lead_s in (None, 0.0)]
    made = train_jobs("small", small, data, choices, device="cpu")
    assert [job.config.lead_s for job in made if isinstance(job, TrainJob)] == [0.05, 0.0]


def test_a_setting_that_an_architecture_does_not_use_makes_no_other_run(small: Path) -> None:
    data = read_episode_set(small)
    for arch, name, values, count in (
        ("esn", "epochs", (1, 2), 1),
        ("agile-mlp", "chunk_steps", (8, 16), 1),
        ("gru", "chunk_steps", (8, 16), 2),
        ("agile-mlp", "epochs", (1, 2), 2),
    ):
        choices = [Choice(arch, 0, None, {name: value}, {}) for value in values]
        assert len(train_jobs("small", small, data, choices, device="cpu")) == count


def outcomes(executor: LocalProcesses) -> dict[str, Outcome]:
    try:
        return {job.identity: outcome for job, outcome in executor.finished()}
    finally:
        executor.cancel()
        assert multiprocessing.active_children() == []


def test_a_job_whose_process_is_killed_is_done_again(jobs: list[TrainJob], tmp_path: Path) -> None:
    executor = LocalProcesses(tmp_path / "runs", workers=1)
    for job in jobs:
        executor.submit(job)
    executor._hand_out()
    os.kill(executor._workers[0].process.pid or 0, signal.SIGKILL)
    done = outcomes(executor)
    assert {job.identity for job in jobs} == set(done)
    assert {outcome.row["state"] for outcome in done.values()} == {"done"}


def test_a_job_that_kills_its_process_is_given_up(jobs: list[TrainJob], tmp_path: Path) -> None:
    class Deadly(LocalProcesses):
        killed = 0

        def _hand_out(self) -> None:
            super()._hand_out()
            for worker in self._workers:
                if worker.job == jobs[0]:
                    self.killed += 1
                    worker.process.kill()

    executor = Deadly(tmp_path / "runs", workers=1)
    for job in jobs:
        executor.submit(job)
    done = outcomes(executor)
    first, second = (done[job.identity].row for job in jobs)
    assert executor.killed == ATTEMPTS
    assert (first["state"], first["reason"]) == ("failed", "its process was killed 3 times")
    assert second["state"] == "done"


def test_what_a_failed_attempt_left_is_forgotten_by_the_next(
    jobs: list[TrainJob], tmp_path: Path
) -> None:
    job, runs = jobs[0], tmp_path / "runs"
    row = do(job, runs=runs).row
    assert do(job, runs=runs).row["test"] == row["test"]
    (tmp_path / row["run"] / "best.safetensors").write_bytes(b"")
    damaged = do(job, runs=runs).row
    assert damaged["state"] == "failed"
    assert "best.safetensors is damaged" in damaged["reason"]
    again = do(dataclasses.replace(job, fresh=True), runs=runs).row
    assert (again["state"], again["test"]) == ("done", row["test"])


def test_what_a_killed_worker_of_a_cluster_left_goes_with_its_next_job(
    jobs: list[TrainJob], make_small: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = "from wakedeploy.sweep import jobs\nimport os\n"
    killed += "with jobs._root(None, None) as root: os._exit(9)"
    (tmp_path / "there").mkdir()
    environment = os.environ | {"TMPDIR": str(tmp_path / "there")}
    subprocess.run([sys.executable, "-c", killed], env=environment, check=False, timeout=120)
    (left,) = (tmp_path / "there").iterdir()
    os.utime(left, (0, 0))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "there"))
    assert do(jobs[0], make_small()).row["state"] == "done"
    assert list((tmp_path / "there").iterdir()) == []


def test_a_set_that_changed_under_the_sweep_is_told(
    jobs: list[TrainJob], small: Path, make_small: Callable, tmp_path: Path
) -> None:
    make_small(seed=9).write(small)
    executor = LocalProcesses(tmp_path / "runs", workers=1)
    executor.submit(jobs[0])
    (outcome,) = outcomes(executor).values()
    assert "small is not the set that this sweep began with" in outcome.row["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("killed", [signal.SIGINT, signal.SIGKILL])
def test_a_stopped_sweep_keeps_its_rows_and_goes_on(
    killed: signal.Signals, small: Path, tmp_path: Path, wakedeploy: Callable, lines: Callable
) -> None:
    out = tmp_path / "out"
    asked = ["sweep", "--data", small, "--arch", "agile-mlp,gru", "--seeds", 40, "--epochs", 3,
             "--hyper", "gru.hidden=64", "--out", out, "--workers", 1]  # fmt: skip
    started = subprocess.Popen(
        [sys.executable, "-m", "wakedeploy", *map(str, asked)],
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        while started.poll() is None and len(lines(out)) < 2:
            time.sleep(0.02)
        if killed == signal.SIGINT:
            os.killpg(started.pid, killed)  # as a terminal does
        else:
            started.send_signal(killed)
        _, said = started.communicate(timeout=60)
    finally:
        if started.poll() is None:
            os.killpg(started.pid, signal.SIGKILL)
    before = lines(out)
    assert 2 <= len(before) < 80
    if killed == signal.SIGINT:
        assert started.returncode == 130
        (sentence,) = sentences(said)
        assert "the same command goes on with the rest" in sentence
        assert len(list(csv.DictReader((out / "results.csv").open(newline="")))) == len(before)
    with (out / "results.jsonl").open("ab") as torn:
        torn.write(b'{"identity": "half a li')
    asked[asked.index(40)] = 4
    done = wakedeploy(*asked)
    assert done.exit_code == 0, done.output
    identities = [row["identity"] for row in lines(out)]
    assert lines(out)[: len(before)] == before
    assert len(set(identities)) == len(identities) >= 8


def test_help_loads_no_heavy_library() -> None:
    code = (
        "import sys\nfrom wakedeploy.cli import main\n"
        "main(['sweep', '--help'], standalone_mode=False)\n"
        "heavy = {'torch', 'numpy', 'pydantic', 'rich', 'distributed', 'trainers.training'}\n"
        "print('LOADED', heavy & set(sys.modules))"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "LOADED set()" in ended.stdout


def test_finished_jobs_are_counted(small: Path, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    plan = read_plan(None, {"data": [str(small)], "arch": ["gru"], "seeds": 3, "lead": [0, 0, 0.1]})

    def sweep_all() -> Report:
        failing = Instant(lambda job: failure(job, "never mind"))
        tell = lambda done, total: seen.append((done, total))  # noqa: E731
        return sweep(plan, tmp_path / "out", failing, on_progress=tell)

    assert len(sweep_all().failed) == 6
    assert seen == [(done, 6) for done in range(7)]
    seen.clear()
    assert sweep_all().begun == 0
    assert seen == [(6, 6)]
