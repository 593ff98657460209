"""Locks between processes: who waits, who is refused, and what a killed holder leaves."""

import multiprocessing
import os
import signal
import tempfile
from pathlib import Path

import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.locks import alone, one_at_a_time, scratch_folder


def _hold(folder: str, how: str, begun: object) -> None:
    held = alone(Path(folder), "It", "a") if how == "alone" else one_at_a_time(Path(folder), "a")
    with held:
        begun.set()
        signal.pause()


@pytest.mark.parametrize("how", ["alone", "in turn"])
def test_a_holder_that_is_killed_keeps_nobody_out(tmp_path, how):
    spawn = multiprocessing.get_context("spawn")
    begun = spawn.Event()
    holder = spawn.Process(target=_hold, args=(str(tmp_path), how, begun))
    holder.start()
    assert begun.wait(60)
    with (
        pytest.raises(UnusableInput, match=r"^It is at work in .*; wait"),
        alone(tmp_path, "It", "a"),
    ):
        pass
    holder.kill()
    holder.join()
    with alone(tmp_path, "It", "a"):
        pass


def _add_and_take(folder: str) -> None:
    """Never more than one in here: a file that is made must not be there already."""
    for _ in range(300):
        with one_at_a_time(Path(folder), "a", traceless=True):
            os.close(os.open(Path(folder) / "here", os.O_CREAT | os.O_EXCL))
            os.unlink(Path(folder) / "here")


def test_a_lock_without_a_trace_lets_one_in_at_a_time(tmp_path):
    spawn = multiprocessing.get_context("spawn")
    several = [spawn.Process(target=_add_and_take, args=(str(tmp_path),)) for _ in range(4)]
    for one in several:
        one.start()
    for one in several:
        one.join()
    assert [one.exitcode for one in several] == [0] * 4
    assert list(tmp_path.iterdir()) == []


def _scratch(place: str, begun: object) -> None:
    tempfile.tempdir = place
    with scratch_folder("wakedeploy-test-") as folder:
        (folder / "toy").mkdir()
        os.utime(folder, (0, 0))
        begun.set()
        signal.pause()


def test_a_scratch_folder_of_a_killed_process_goes_with_the_next(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    (tmp_path / "wakedeploy-test-link").symlink_to(tmp_path)
    (tmp_path / "another").mkdir()
    spawn = multiprocessing.get_context("spawn")
    begun = spawn.Event()
    holder = spawn.Process(target=_scratch, args=(str(tmp_path), begun))
    holder.start()
    assert begun.wait(60)
    (held,) = [path for path in tmp_path.glob("wakedeploy-test-*") if not path.is_symlink()]
    with scratch_folder("wakedeploy-test-") as own:
        assert own.is_dir()
        assert held.is_dir()
    assert not own.exists()
    holder.kill()
    holder.join()
    os.utime(held)  # as one that was made just now, and is not locked yet
    with scratch_folder("wakedeploy-test-"):
        assert held.is_dir()
    os.utime(held, (0, 0))
    with scratch_folder("wakedeploy-test-"):
        assert not held.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["another", "wakedeploy-test-link"]
