"""Processes that this one starts: what reaches them."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

# A process of its own, since multiprocessing starts its resource tracker with the first child only.
FIRST_AND_SECOND = """
import multiprocessing, os, signal
from wakedeploy.core.processes import deaf_to_ctrl_c

def waits(pipe):
    pipe.send("up")
    pipe.recv()
    pipe.send("alive")

def main():
    spawn = multiprocessing.get_context("spawn")
    pairs = [spawn.Pipe() for _ in range(2)]
    members = [spawn.Process(target=waits, args=(theirs,)) for _, theirs in pairs]
    for member in members:
        with deaf_to_ctrl_c():
            member.start()
    for _, theirs in pairs:
        theirs.close()
    for ours, _ in pairs:
        ours.recv()
    heard = []
    signal.signal(signal.SIGINT, lambda *_: heard.append("parent"))
    os.killpg(0, signal.SIGINT)
    for ours, _ in pairs:
        ours.send("go on")
    print(*(ours.recv() for ours, _ in pairs), *heard)
    for member in members:
        member.join()

if __name__ == "__main__":
    main()
"""


def test_ctrl_c_reaches_the_parent_and_none_of_its_processes(tmp_path):
    script = tmp_path / "family.py"
    script.write_text(FIRST_AND_SECOND)
    run = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True, text=True, timeout=120, start_new_session=True,
    )  # fmt: skip
    assert run.stdout == "alive alive parent\n", run.stderr
    assert run.stderr == ""


LEFT_BY_AN_ERROR = """
import multiprocessing, sys, threading, time
from wakedeploy.core.processes import pool

if __name__ == "__main__":
    try:
        with pool(2, fresh=sys.argv[1] == "fresh") as several:
            several.map(time.sleep, [600.0] * 4)
            raise ValueError
    except ValueError:
        print(threading.active_count() - 1, len(multiprocessing.active_children()))
"""


@pytest.mark.parametrize("kind", ["copied", "fresh"])
def test_left_by_an_error_a_pool_leaves_neither_threads_nor_processes(tmp_path, kind):
    script = tmp_path / "left.py"
    script.write_text(LEFT_BY_AN_ERROR)
    run = subprocess.run(
        [sys.executable, str(script), kind], capture_output=True, text=True, timeout=120
    )
    assert run.stdout == "0 0\n", run.stderr
    assert run.stderr == ""


AT_WORK = """
import os, sys, time
from wakedeploy.core.interruption import interruptible
from wakedeploy.core.processes import pool

def work(_):
    os.write(1, f"{os.getpid()}\\n".encode())  # whole, whoever else writes
    time.sleep(600.0)

if __name__ == "__main__":
    with interruptible(), pool(2, fresh=sys.argv[1] == "fresh") as several:
        list(several.map(work, range(4)))
"""


@pytest.mark.parametrize("kind", ["copied", "fresh"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_however_the_parent_alone_is_ended_no_process_outlives_it(tmp_path, kind, number):
    with at_work(tmp_path, kind) as (parent, children):
        parent.send_signal(number)
        said = parent.communicate(timeout=60)[1]
        end_s = time.monotonic() + 60.0
        while any(alive(pid) for pid in children) and time.monotonic() < end_s:
            time.sleep(0.02)
        assert not any(alive(pid) for pid in children)
    assert said.count("Traceback") == (0 if number == signal.SIGKILL else 1), said


@contextlib.contextmanager
def at_work(folder, kind):
    """A parent whose two processes are at work, and their numbers."""
    script = folder / "family.py"
    script.write_text(AT_WORK)
    parent = subprocess.Popen(
        [sys.executable, str(script), kind],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        yield parent, [int(parent.stdout.readline()) for _ in range(2)]
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(parent.pid, signal.SIGKILL)


def alive(pid):
    """Whether a process runs; one that only waits to be asked how it ended does not."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (ProcessLookupError, FileNotFoundError):
        return False
