"""Files are whole or not there: what a full disk, a killed writer and a device make of it."""

import errno
import os
import threading
from pathlib import Path

import pytest

from wakedeploy.core import files
from wakedeploy.core.errors import is_full, relief
from wakedeploy.core.files import begun, remove_unfinished, write_text_whole, write_whole


def full(path: Path) -> None:
    """A writer whose disk is full in the middle; such an error names no file."""
    path.write_text("half")
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_is_told_with_the_name_of_the_file_and_leaves_the_old_one(tmp_path):
    path = tmp_path / "a.json"
    write_text_whole(path, "old")
    with pytest.raises(OSError, match="No space left") as failed:
        write_whole(path, full)
    assert failed.value.filename == str(path)
    assert is_full(failed.value)
    assert "free some space" in relief(failed.value)
    assert [p.read_text() for p in tmp_path.iterdir()] == ["old"]


def test_an_error_about_another_file_keeps_its_name(tmp_path):
    with pytest.raises(FileNotFoundError) as failed:
        write_whole(tmp_path / "a.json", lambda _: (tmp_path / "input").read_text())
    assert failed.value.filename == str(tmp_path / "input")
    assert relief(failed.value) == ""


def test_what_is_written_to_a_pipe_goes_through_it(tmp_path):
    """A device in the way of a rename would be gone, and `/dev/null` with it."""
    pipe, heard = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: heard.append(pipe.read_text()))
    reader.start()
    write_text_whole(pipe, "told")
    reader.join(60)
    assert heard == ["told"]
    assert pipe.is_fifo()
    assert [*tmp_path.iterdir()] == [pipe]


def test_what_a_killed_writer_left_is_removed_and_nothing_else(tmp_path, monkeypatch):
    write_text_whole(tmp_path / "a.json", "whole")
    (tmp_path / ".mine").write_text("kept")

    def killed(path: Path) -> None:
        path.write_text("half")
        monkeypatch.setattr(Path, "unlink", lambda *_, **__: None)  # a killed one removes nothing
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "a.json", killed)
    monkeypatch.undo()
    assert len([*tmp_path.iterdir()]) == 3
    remove_unfinished(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".mine", "a.json"]


def test_a_file_that_is_begun_has_no_name_before_and_goes_on_after(tmp_path):
    path = tmp_path / "a.log"
    with begun(path) as file:
        written = file.open("w")
        written.write("head\n")
        written.flush()
        assert not path.exists()
    assert path.read_text() == "head\n"
    written.write("more\n")
    written.close()
    assert path.read_text() == "head\nmore\n"
    assert [*tmp_path.iterdir()] == [path]


@pytest.mark.parametrize("links", [True, False])
def test_of_two_that_begin_one_file_the_second_is_refused(tmp_path, monkeypatch, links):
    if not links:
        monkeypatch.setattr(files.os, "link", _no_links)
    path = tmp_path / "a.log"

    def both() -> None:
        with begun(path) as second:
            second.write_text("second")
            with begun(path) as first:
                first.write_text("first")

    with pytest.raises(FileExistsError):
        both()
    assert [p.read_text() for p in tmp_path.iterdir()] == ["first"]


def test_an_empty_file_gives_way_to_one_that_is_begun(tmp_path):
    (tmp_path / "a.log").touch()
    with begun(tmp_path / "a.log") as file:
        file.write_text("begun")
    assert [p.read_text() for p in tmp_path.iterdir()] == ["begun"]


def _no_links(*_: object) -> None:
    raise PermissionError(errno.EPERM, "Operation not permitted")
