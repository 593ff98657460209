"""Work on several processes: results in order, failures told, nobody left behind."""

import math
import os
import signal
import subprocess
import sys
import time

import pytest

from wakedeploy.core.parallel import parallel_map

SCRIPT = """
import os
import time
from wakedeploy.core.parallel import parallel_map

def work(job):
    os.write(1, b"%d\\n" % os.getpid())  # whole, whoever else writes
    time.sleep(60.0)

if __name__ == "__main__":
    parallel_map(work, [0, 1], workers=2, fresh=True)
"""


@pytest.mark.parametrize("workers", [1, 2])
def test_results_are_in_the_jobs_order_and_each_is_told(workers: int) -> None:
    done: list[tuple[float, float]] = []
    told = parallel_map(
        math.sqrt, [9.0, 1.0, 4.0], workers=workers, on_done=lambda *both: done.append(both)
    )
    assert told == [3.0, 1.0, 2.0]
    assert sorted(done) == [(1.0, 1.0), (4.0, 2.0), (9.0, 3.0)]


def _process(_: int) -> int:
    return os.getpid()


def test_one_worker_is_this_process_and_several_are_others() -> None:
    assert parallel_map(_process, [0, 1], workers=1) == [os.getpid()] * 2
    assert os.getpid() not in parallel_map(_process, [0, 1], workers=2)
    assert parallel_map(_process, [], workers=2) == []


def test_steps_count_and_fresh_processes_have_one_thread() -> None:
    counted: list[tuple[int, int]] = []
    told = parallel_map(
        os.getenv, ["OMP_NUM_THREADS"] * 2, workers=2, fresh=True,
        steps=lambda *both: counted.append(both),
    )  # fmt: skip
    assert told == ["1", "1"]
    assert counted == [(1, 2), (2, 2)]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_failure_is_raised(workers: int) -> None:
    with pytest.raises(ValueError, match="math domain error"):
        parallel_map(math.sqrt, [1.0, -1.0], workers=workers)


def test_workers_end_with_a_parent_that_is_killed(tmp_path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    parent = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    workers = [int(parent.stdout.readline()) for _ in range(2)]
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    for _ in range(100):
        left = [pid for pid in workers if _is_there(pid)]
        if not left:
            break
        time.sleep(0.1)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert left == []


def _is_there(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    with open(f"/proc/{pid}/stat") as stat:  # who is dead but not yet waited for is gone
        return stat.read().rpartition(")")[2].split()[0] != "Z"
