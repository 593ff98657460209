"""The journal's lock: whatever ends or interrupts its holder, nobody waits for it for ever."""

import fcntl
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from trainers.tuning import storage
from trainers.tuning.storage import KernelLock


def test_the_journals_lock_ends_with_a_killed_holder(tmp_path: Path) -> None:
    journal = tmp_path / "a.journal"
    code = (
        "import sys, time; from pathlib import Path\n"
        "from trainers.tuning.storage import KernelLock\n"
        "KernelLock(Path(sys.argv[1])).acquire(); print('held', flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", code, str(journal)], stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    lock = KernelLock(journal)
    assert lock.acquire()
    lock.release()


def test_an_interruption_while_the_lock_is_taken_lets_go_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Optuna lets go only of a lock that it was given; the process would then wait for itself."""

    def interrupted(journal: Path) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(storage, "_drop_broken_line", interrupted)
    with pytest.raises(KeyboardInterrupt):
        KernelLock(tmp_path / "a.journal").acquire()
    with (tmp_path / ".a.journal.lock").open("r+") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # BlockingIOError if it is still held
