"""Sweeps on a dask cluster: a real scheduler and workers, each a process on this machine."""

import os
import platform
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="dask is not installed: pip install '.[cluster]'")

from distributed.scheduler import KilledWorker

import wakedeploy as package
from trainers.runs import load_run
from trainers.training import configure, settings_for, train
from wakedeploy.episodes import read_episode_set
from wakedeploy.errors import CheckFailed
from wakedeploy.sweep import cluster
from wakedeploy.sweep.cluster import Cluster, misfit
from wakedeploy.sweep.jobs import train_jobs
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
        self.folder, self.processes = folder, list[subprocess.Popen]()
        self.address = ""

    def scheduler(self) -> subprocess.Popen:
        told = self.folder / "address"
        code = (
            "import asyncio, sys\n"
            "from pathlib import Path\n"
            "from distributed import Scheduler\n"
            "async def main():\n"
            "    async with Scheduler(host='127.0.0.1', port=0, dashboard=False) as one:\n"
            "        Path(sys.argv[1] + '.new').write_text(one.address)\n"
            "        Path(sys.argv[1] + '.new').rename(sys.argv[1])\n"
            "        await one.finished()\n"
            "asyncio.run(main())\n"
        )
        process = self._start("-c", code, str(told))
        while not told.exists():
            assert process.poll() is None
            time.sleep(0.05)
        self.address = told.read_text()
        return process

    def worker(self, *options: str) -> subprocess.Popen:
        return self._start(
            "-m", "distributed.cli.dask_worker", self.address, "--nthreads", "2", "--no-nanny",
            "--no-dashboard", "--host", "127.0.0.1", "--local-directory", str(self.folder),
            *options,
        )  # fmt: skip

    def _start(self, *arguments: str) -> subprocess.Popen:
        log = (self.folder / f"log{len(self.processes)}").open("w")
        process = subprocess.Popen(
            [sys.executable, *arguments], stdout=log, stderr=log, cwd=self.folder,
            env=os.environ | {"PYTHONPATH": str(Path(package.__file__).parents[1])},
        )  # fmt: skip
        log.close()
        self.processes.append(process)
        return process

    def end(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()


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


@pytest.mark.usefixtures("patient")
def test_a_worker_killed_in_mid_sweep_loses_nothing_and_repeats_nothing(
    machines: Machines, small: Path, tmp_path: Path, lines: Callable
) -> None:
    (tmp_path / "plan.toml").write_text(PLAN)
    plan, out = read_plan(tmp_path / "plan.toml"), tmp_path / "out"
    for _ in range(2):
        machines.worker()
    executor = connected(machines, workers=2)
    pids = executor._client.run(os.getpid)
    killed: list[int] = []

    def kill_one(done: int, total: int) -> None:
        busy = [name for name, keys in executor._client.processing().items() if keys]
        if done >= 3 and busy and not killed:
            killed.append(pids[busy[0]])
            os.kill(killed[0], signal.SIGKILL)

    report = sweep(plan, out, executor, on_progress=kill_one)
    assert killed
    rows = lines(out)
    assert [row["state"] for row in rows] == ["done"] * 13
    assert len({row["identity"] for row in rows}) == plan.jobs == 13
    assert (report.begun, report.waiting, report.failed) == (13, 0, [])
    assert {row["data"] for row in rows if row["kind"] == "train"} == {"small", "made"}

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
    monkeypatch.setattr(cluster, "CONNECT_S", 5.0)
    assert f"{machines.address} has no worker; start some with" in sweep_there(machines.address)
    (tmp_path / "other.py").write_text("import wakedeploy\nwakedeploy.__version__ = '0.0.9'\n")
    worker = machines.worker("--preload", str(tmp_path / "other.py"))
    monkeypatch.setattr(cluster, "CONNECT_S", 60.0)
    assert f"has wakedeploy 0.0.9, and this is {package.__version__}" in sweep_there(
        machines.address
    )
    worker.kill()
    (tmp_path / "none.py").write_text("import sys\nsys.modules['wakedeploy'] = None\n")
    worker.wait()
    machines.worker("--preload", str(tmp_path / "none.py"))
    assert "has no wakedeploy; install there" in sweep_there(machines.address)


HERE = platform.python_version()
FITS = {"wakedeploy": package.__version__, "torch": "there"}


@pytest.mark.parametrize(
    ("python", "libraries", "says"),
    [
        (f"{HERE}.final.0", FITS, None),
        ("3.9.1.final.0", None, "The worker tcp://b runs Python 3.9, and this is 3."),
        (HERE, FITS | {"wakedeploy": None}, "The worker tcp://b has no wakedeploy; install"),
        (HERE, FITS | {"torch": None}, "The worker tcp://b has no torch; install"),
        (HERE, FITS | {"wakedeploy": "9.9"}, "The worker tcp://b has wakedeploy 9.9, and this is"),
    ],
)
def test_workers_that_do_not_fit(python: str, libraries: dict | None, says: str | None) -> None:
    told = misfit(
        {"tcp://a": HERE, "tcp://b": python},
        None if libraries is None else {"tcp://a": FITS, "tcp://b": libraries},
    )
    assert (told is None) if says is None else (told or "").startswith(says)


def test_a_job_that_takes_its_workers_along_is_given_up(small: Path) -> None:
    class Lost:
        def result(self) -> None:
            raise KilledWorker("wakedeploy-1", None, 3)

    data = read_episode_set(small)
    choices = [Choice("agile-mlp", 0, None, {}, {})]
    (job,) = train_jobs("small", small, data, choices, device="cpu")
    row = Cluster._outcome(Cluster.__new__(Cluster), Lost(), job).row
    assert (row["state"], row["reason"]) == ("failed", "4 workers were lost while at it")


def test_a_worker_of_another_version_that_joins_later_is_told(
    small: Path, make_small: Callable
) -> None:
    choices = [Choice("agile-mlp", 0, None, {"epochs": 1}, {})]
    (job,) = train_jobs("small", small, make_small(), choices, device="cpu")
    other = cluster.do_there(job, make_small(), "9.9").row
    assert other["state"] == "failed"
    assert other["reason"].endswith(f"{package.__version__}, and the sweep is of 9.9")
    changed = cluster.do_there(job, make_small(seed=1), package.__version__).row
    assert "small is not the set that this sweep began with" in changed["reason"]


def test_without_dask_it_is_told_what_to_install(
    small: Path, wakedeploy: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, "wakedeploy.sweep.cluster")
    told = wakedeploy("sweep", "--data", small, "--scheduler", "tcp://127.0.0.1:1")
    assert told.exit_code == 2
    assert (
        "distributed is not installed; --scheduler needs: pip install 'wakedeploy[" in told.stderr
    )
