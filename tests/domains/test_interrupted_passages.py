"""Ctrl-C while passages are simulated: nobody goes on, and only the parent says so."""

import os
import signal
import subprocess
import sys

import pytest

from wakedeploy.core import processes
from wakedeploy.domains import ship

SCRIPT = """
import os
import time
from wakedeploy.domains import ship

def sail(job):
    os.write(1, b"begun\\n")  # whole, whoever else writes
    time.sleep(60.0)

ship._sail = sail
ship.make_set(minutes=1.0, seed=0, workers=2)
"""


def test_workers_end_at_once_and_print_nothing() -> None:
    started = subprocess.Popen(
        [sys.executable, "-c", SCRIPT],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert started.stdout is not None
        assert [started.stdout.readline() for _ in range(2)] == ["begun\n"] * 2
        os.killpg(started.pid, signal.SIGINT)  # as a terminal does: to the parent and its workers
        _, said = started.communicate(timeout=20.0)
    finally:
        if started.poll() is None:
            os.killpg(started.pid, signal.SIGKILL)
    assert started.returncode != 0
    assert "Process ForkProcess" not in said
    assert "Process SpawnProcess" not in said


def test_what_waits_is_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[dict[str, bool]] = []

    class Pool(processes.ProcessPoolExecutor):
        def map(self, *_: object, **__: object):  # type: ignore[override]
            raise KeyboardInterrupt

        def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
            asked.append({"wait": wait, "cancel_futures": cancel_futures})
            super().shutdown(wait, cancel_futures=cancel_futures)

    monkeypatch.setattr(processes, "ProcessPoolExecutor", Pool)
    with pytest.raises(KeyboardInterrupt):
        ship.make_set(minutes=1.0, seed=0)
    assert asked[0] == {"wait": False, "cancel_futures": True}


def pid_and_root(number: float) -> tuple[int, float]:
    return os.getpid(), number**0.5


def test_one_worker_is_this_process_and_results_are_in_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with processes.processes(2) as each:
        two = list(each(pid_and_root, [9.0, 4.0, 1.0]))
    monkeypatch.setattr(processes, "ProcessPoolExecutor", None)
    with processes.processes(1) as each:
        one = list(each(pid_and_root, [9.0, 4.0, 1.0]))
    assert [root for _, root in one] == [root for _, root in two] == [3.0, 2.0, 1.0]
    assert {pid for pid, _ in one} == {os.getpid()}
    assert os.getpid() not in {pid for pid, _ in two}
