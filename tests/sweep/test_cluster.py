"""Sweeps on a dask cluster: a real scheduler and workers, each a process on this machine."""

import asyncio
import os
import platform
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pytest
import warm

pytest.importorskip("distributed", reason="dask is not installed: pip install '.[cluster]'")

import distributed
from distributed.cli import dask_worker
from distributed.scheduler import KilledWorker

import wakedeploy as package
from trainers.trained_run import load_run
from trainers.training.runs import TRAINING
from trainers.training.trainer import configure, settings_for, train
from wakedeploy.core.episodes import read_episode_set
from wakedeploy.core.errors import CheckFailed, installs
from wakedeploy.sweep import cluster
from wakedeploy.sweep.cluster import Cluster, misfit
from wakedeploy.sweep.jobs import do, train_jobs
from wakedeploy.sweep.plan import Choice, read_plan
from wakedeploy.sweep.run import sweep

PLAN = """
data = ["small", "made"]
arch = ["agile-mlp", "gru"]
seeds = 3
lead = 0.0
[settings]
epochs = 6
[hyper.gru]
dropout = 0.2
[[generate]]
name = "made"
domain = "gantry"
minutes = 0.5
"""


class Machines:
    """A scheduler and workers, as processes of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.processes = folder, list[BaseProcess]()
        self.address = ""

    def scheduler(self) -> BaseProcess:
        told = self.folder / "address"
        process = self._start(schedule, told)
        while not told.exists():
            assert process.exitcode is None
            time.sleep(0.05)
        self.address = told.read_text()
        return process

    def worker(self, *options: str) -> BaseProcess:
        return self._start(
            do_its_jobs,
            [self.address, "--nthreads", "2", "--no-nanny", "--no-dashboard",
             "--host", "127.0.0.1", "--local-directory", str(self.folder), *options],
        )  # fmt: skip

    def _start(self, *work: Any) -> BaseProcess:
        self.processes.append(warm.started(self.folder / f"log{len(self.processes)}", *work))
        return self.processes[-1]

    def end(self) -> None:
        for process in self.processes:
            process.kill()
            process.join()


def do_its_jobs(options: list[str]) -> None:
    """As `dask worker` does; what it leaves when it is killed lies where all of it does."""
    tempfile.tempdir = options[options.index("--local-directory") + 1]
    dask_worker.main(options)


def schedule(told: Path) -> None:
    """A scheduler, which writes its address."""

    async def serve() -> None:
        async with distributed.Scheduler(host="127.0.0.1", port=0, dashboard=False) as one:
            told.with_suffix(".new").write_text(one.address)
            told.with_suffix(".new").rename(told)
            await one.finished()

    asyncio.run(serve())


@pytest.fixture
def machines(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machines]:
    started = Machines(tmp_path_factory.mktemp("machines"))
    try:
        started.scheduler()
        yield started
    finally:
        started.end()


def connected(machines: Machines, workers: int) -> Cluster:
    executor = Cluster(machines.address)
    executor._client.wait_for_workers(workers, timeout=60)
    return executor


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers start slowly on a busy machine."""
    monkeypatch.setattr(cluster, "CONNECT_S", 60.0)


# What a worker does before and after each job, in a file that all of them append to.
RECORDED = """
import os
from wakedeploy.sweep import jobs
def tell(*words):
    with open({path!r}, "a") as file:
        file.write(" ".join(map(str, words)) + "\\n")
def recorded(job, *others):
    tell("begun", job.identity, os.getpid())
    outcome = jobs.as_ever(job, *others)
    tell("ended", job.identity, os.getpid())
    return outcome
if not hasattr(jobs, "as_ever"):  # dask may load a file twice
    jobs.as_ever, jobs.do = jobs.do, recorded
"""


class Record:
    """What workers that preload `script` have begun and ended: pairs of job and process."""

    def __init__(self, folder: Path) -> None:
        self.script, self._path = folder / "recorded.py", folder / "record"
        self.script.write_text(RECORDED.format(path=str(self._path)))
        self._path.touch()

    def told(self, what: str) -> list[tuple[str, int]]:
        lines = [line.split() for line in self._path.read_text().splitlines()]
        return [(job, int(pid)) for kind, job, pid in lines if kind == what]


@pytest.fixture
def record(tmp_path: Path) -> Record:
    return Record(tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("patient")
def test_a_worker_killed_in_mid_sweep_loses_nothing_and_repeats_only_what_it_was_at(
    machines: Machines, record: Record, small: Path, tmp_path: Path, lines: Callable
) -> None:
    (tmp_path / "plan.toml").write_text(PLAN)
    plan, out = read_plan(tmp_path / "plan.toml"), tmp_path / "out"
    for _ in range(2):
        machines.worker("--preload", str(record.script))
    executor = connected(machines, workers=2)
    pids = executor._client.run(os.getpid)
    killed: list[int] = []
    written: set[str] = set()  # jobs whose rows are on the disk when the worker is killed

    def kill_one(done: int, total: int) -> None:
        busy = {pid for job, pid in set(record.told("begun")) - set(record.told("ended"))}
        if done >= 3 and busy and not killed:
            written.update(row["identity"] for row in lines(out))
            killed.append(busy.pop())
            assert killed[0] in pids.values()
            os.kill(killed[0], signal.SIGKILL)

    report = sweep(plan, out, executor, on_progress=kill_one)
    assert killed
    rows = lines(out)
    assert [row["state"] for row in rows] == ["done"] * 13
    assert len({row["identity"] for row in rows}) == plan.jobs == 13
    assert (report.begun, report.waiting, report.failed) == (13, 0, [])
    assert {row["data"] for row in rows if row["kind"] == "train"} == {"small", "made"}

    # Begun again is what the killed worker had begun and what had not come back from it, no more.
    begun, ended = record.told("begun"), record.told("ended")
    times = Counter(job for job, _ in begun)
    again = {job for job in times if times[job] > 1}
    assert times.keys() == {row["identity"] for row in rows}
    assert again
    assert max(times.values()) == 2
    assert again <= {job for job, pid in begun if pid == killed[0]} - written
    # The other worker has begun and ended each of its jobs once; what it has not ended was done.
    theirs = [job for job, pid in ended if pid != killed[0]]
    assert sorted(theirs) == sorted({job for job, pid in begun if pid != killed[0]})
    assert times.keys() - theirs <= written

    # What comes back from workers, threads or not, is what this machine would have trained.
    data, settings = read_episode_set(small), settings_for("gru", epochs=6)
    mine = [row for row in rows if row["data"] == "small" and row["arch"] == "gru"]
    assert len(mine) == 3
    for row in mine:
        config = configure(data, "gru", seed=row["seed"], lead_s=0.0, hyper={"dropout": 0.2},
                           settings=settings)  # fmt: skip
        run = train(config, data, tmp_path)
        assert row["test"] == run.metrics.test.model_dump()
        assert load_run(out / row["run"]).metrics.weights_sha256 == run.metrics.weights_sha256

    again = sweep(plan, out, connected(machines, workers=1))
    assert (again.begun, len(lines(out))) == (0, 13)


@pytest.mark.whole
@pytest.mark.usefixtures("patient")
def test_a_scheduler_that_is_lost_ends_the_sweep_with_a_sentence(
    machines: Machines,
    small: Path,
    tmp_path: Path,
    lines: Callable,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machines.worker()
    executor, out = connected(machines, workers=1), tmp_path / "out"
    plan = read_plan(None, {"data": [str(small)], "arch": ["agile-mlp"], "seeds": 30})

    def lose(done: int, total: int) -> None:
        if done == 2:
            machines.processes[0].kill()

    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    with pytest.raises(CheckFailed, match=r"The connection to the scheduler at .* is lost; rows"):
        sweep(plan, out, executor, on_progress=lose)
    assert 2 <= len(lines(out)) < 30
    assert (out / "results.csv").exists()


@pytest.mark.whole
def test_an_unusable_cluster_is_told_before_anything_is_written(
    machines: Machines, small: Path, tmp_path: Path, wakedeploy: Callable,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    def sweep_there(address: str) -> str:
        told = wakedeploy(
            "sweep", "--data", small, "--out", tmp_path / "out", "--scheduler", address
        )
        assert told.exit_code == 2, told.output
        assert len(told.stderr.strip().splitlines()) == 1
        assert not (tmp_path / "out").exists()
        return told.stderr

    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    assert "No scheduler answers at tcp://127.0.0.1:1 (" in sweep_there("tcp://127.0.0.1:1")
    assert "No scheduler answers at nonsense://x (" in sweep_there("nonsense://x")
    monkeypatch.setattr(cluster, "CONNECT_S", 2.0)
    assert f"{machines.address} has no worker; start some with" in sweep_there(machines.address)
    (tmp_path / "other.py").write_text("import wakedeploy\nwakedeploy.__version__ = '0.0.9'\n")
    worker = machines.worker("--preload", str(tmp_path / "other.py"))
    monkeypatch.setattr(cluster, "CONNECT_S", 60.0)
    assert f"has wakedeploy 0.0.9, and this is {package.__version__}" in sweep_there(
        machines.address
    )
    worker.kill()
    (tmp_path / "none.py").write_text("import sys\nsys.modules['wakedeploy'] = None\n")
    worker.join()
    machines.worker("--preload", str(tmp_path / "none.py"))
    assert "has no wakedeploy; install there" in sweep_there(machines.address)


HERE = platform.python_version()
FITS = {"wakedeploy": package.__version__, "torch": "2.13.0", "training": TRAINING, "cuda": False}


@pytest.mark.parametrize(
    ("python", "there", "device", "says"),
    [
        (f"{HERE}.final.0", FITS, "auto", None),
        ("3.9.1.final.0", None, "auto", "The worker tcp://b runs Python 3.9, and this is 3."),
        (HERE, FITS | {"wakedeploy": None}, "auto", "The worker tcp://b has no wakedeploy; inst"),
        (HERE, FITS | {"torch": None}, "auto", "The worker tcp://b has no torch; install"),
        (HERE, FITS | {"wakedeploy": "9.9"}, "auto", "The worker tcp://b has wakedeploy 9.9, and"),
        (HERE, FITS | {"training": 0}, "auto", "The worker tcp://b trains by revision 0 of the"),
        (HERE, FITS, "cuda", "The worker tcp://b has no CUDA; leave --device out"),
        (HERE, FITS | {"cuda": True}, "cuda", None),
    ],
)
def test_workers_that_do_not_fit(
    python: str, there: dict | None, device: str, says: str | None
) -> None:
    told = misfit("tcp://b", python, there, device)
    assert (told is None) if says is None else (told or "").startswith(says)


def test_all_workers_are_looked_at_and_those_that_do_not_fit_once(
    machines: Machines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside one that fits another is told of, not an error; each is looked at a single time."""
    other, told, looks = tmp_path / "other.py", list[str](), list[set[str]]()
    other.write_text("import wakedeploy\nwakedeploy.__version__ = '0.0.9'\n")
    for options in ((), ("--preload", str(other))):
        machines.worker(*options)
    with distributed.Client(machines.address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
    problems = cluster._problems

    def looked(client: object, names: list[str], device: str) -> dict[str, str | None]:
        looks.append(set(names))
        return problems(client, names, device)

    monkeypatch.setattr(cluster, "_problems", looked)
    # A client of some releases tells of five workers by default; of one here.
    whole = distributed.Client.scheduler_info

    def few(self: object, n_workers: int = 1, **more: object) -> dict:
        info = whole(self, n_workers=-1, **more)
        kept = list(info["workers"].items())[: n_workers if n_workers >= 0 else None]
        return info | {"workers": dict(kept)}

    monkeypatch.setattr(distributed.Client, "scheduler_info", few)
    executor = Cluster(machines.address, told.append)
    try:
        assert len(executor._admit()) == 0
    finally:
        executor.cancel()
    assert len(looks) == 1
    assert len(looks[0]) == 2
    (sentence,) = told
    assert "has wakedeploy 0.0.9" in sentence


def test_a_job_that_takes_its_workers_along_is_given_up(small: Path) -> None:
    class Lost:
        def result(self, timeout: float) -> None:
            raise KilledWorker("wakedeploy-1", None, 3)

    data = read_episode_set(small)
    choices = [Choice("agile-mlp", 0, None, {}, {})]
    (job,) = train_jobs("small", small, data, choices, device="cpu")
    alone = Cluster.__new__(Cluster)
    alone._fetches = Counter()
    row = Cluster._outcome(alone, Lost(), job).row
    assert (row["state"], row["reason"]) == ("failed", "4 workers were lost while at it")


def test_a_job_whose_set_is_another_on_the_worker_is_told(
    small: Path, make_small: Callable
) -> None:
    choices = [Choice("agile-mlp", 0, None, {"epochs": 1}, {})]
    (job,) = train_jobs("small", small, make_small(), choices, device="cpu")
    changed = do(job, make_small(seed=1)).row
    assert "small is not the set that this sweep began with" in changed["reason"]


@pytest.mark.slow
@pytest.mark.usefixtures("patient")
def test_of_workers_that_join_later_those_that_fit_get_jobs(
    machines: Machines, record: Record, small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "_LOOK_S", 0.1)
    other, told = tmp_path / "other.py", list[str]()
    other.write_text(record.script.read_text() + "jobs.wakedeploy.__version__ = '0.0.9'\n")
    first = machines.worker("--preload", str(record.script))
    executor = Cluster(machines.address, told.append)
    joined: list[BaseProcess] = []

    def change(done: int, total: int) -> None:
        """An unfit worker joins; then the only fit one is lost, and another fit one joins."""
        if done == 2:
            joined.append(machines.worker("--preload", str(other)))
            executor._client.wait_for_workers(2, timeout=60)
        if done == 6:
            first.kill()
            joined.append(machines.worker("--preload", str(record.script)))

    plan = read_plan(None, {"data": [str(small)], "arch": ["agile-mlp"], "seeds": 12,
                            "settings": {"epochs": [1]}})  # fmt: skip
    report = sweep(plan, tmp_path / "out", executor, on_progress=change)
    assert [row["state"] for row in report.rows] == ["done"] * 12
    assert {pid for _, pid in record.told("begun")} == {first.pid, joined[1].pid}
    (sentence,) = told
    assert f"has wakedeploy 0.0.9, and this is {package.__version__}; install" in sentence


def test_without_dask_it_is_told_what_to_install(
    small: Path, wakedeploy: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, "wakedeploy.sweep.cluster")
    told = wakedeploy("sweep", "--data", small, "--scheduler", "tcp://127.0.0.1:1")
    assert told.exit_code == 2
    assert f"distributed is not installed; --scheduler needs: {installs('cluster')}." in told.stderr
