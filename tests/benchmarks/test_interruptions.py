"""The instrument that disturbs commands: it strikes where it says, and it notices what is wrong."""

import json
import signal
import sys
import time
from pathlib import Path

import pytest

from benchmarks.interruptions import processes
from benchmarks.interruptions.processes import Command, Stroke
from benchmarks.interruptions.whole import broken_files
from benchmarks.results import interrupted
from benchmarks.results.section import Records
from wakedeploy.domains.gantry import record
from wakedeploy.rig.file import default_rig

WRITES = """
from pathlib import Path
for number in range(5):
    Path(f"{number}.txt").write_text("")
"""
LEAVES_A_CHILD = """
import subprocess, sys
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
"""


@pytest.fixture
def here(tmp_path: Path) -> Path:
    folder = tmp_path / "here"
    folder.mkdir()
    return folder


def python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


@pytest.mark.parametrize("at_file", [1, 3])
def test_a_command_is_killed_before_its_nth_file(here: Path, at_file: int) -> None:
    ended = Command(python(WRITES), here, Stroke(signal.SIGKILL, at_file=at_file)).ended()
    assert (ended.status, ended.struck, ended.files) == (-signal.SIGKILL, True, at_file)
    assert sorted(path.name for path in here.iterdir()) == [f"{n}.txt" for n in range(at_file - 1)]


def test_a_command_that_ends_before_its_stroke_was_not_struck(here: Path) -> None:
    ended = Command(python(WRITES), here, Stroke(signal.SIGKILL, at_file=9)).ended()
    assert (ended.status, ended.struck, ended.files) == (0, False, 5)
    assert ended.children_s is not None
    assert len(list(here.iterdir())) == 5


def test_a_child_that_is_left_behind_is_noticed_and_ended(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "CHILDREN_LIMIT_S", 0.3)
    command = Command(python(LEAVES_A_CHILD), here)
    ended = command.ended()
    assert (ended.status, ended.children_s) == (0, None)
    end_s = time.monotonic() + 60.0
    while command._marked_pids() and time.monotonic() < end_s:
        time.sleep(0.02)
    assert command._marked_pids() == []


def test_what_computes_nothing_any_more_hangs(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "IDLE_LIMIT_S", 0.5)
    monkeypatch.setattr(processes, "_LOOK_AT_WORK_S", 0.1)
    assert Command(python("import time; time.sleep(600)"), here).ended().hung


def test_half_a_file_is_noticed_whatever_it_is(tmp_path: Path) -> None:
    default_rig().write(tmp_path / "rig.toml")
    record(None, seconds=6, seed=0).write_mcap(tmp_path / "flight.mcap")
    (tmp_path / "a.json").write_text('{"a": [1, 2, 3]}')
    (tmp_path / "a.csv").write_text("a,b\n1,2\n")
    (tmp_path / "a.html").write_text("<html><body></body></html>\n")
    assert broken_files(tmp_path) == []
    for path in [*tmp_path.iterdir()]:
        data = path.read_bytes()
        path.write_bytes(data[: 2 * len(data) // 3] if path.suffix != ".mcap" else data[:20])
        (told,) = broken_files(tmp_path)
        assert told.startswith(path.name)
        path.write_bytes(data)
    (tmp_path / ".a.json.unfinished-12345678.json").write_text("{")
    assert broken_files(tmp_path) == []  # it has no name of its own yet


def test_the_table_counts_what_came_out_right(tmp_path: Path) -> None:
    row = {"command": "train", "strokes": 10, "longest_children_s": 0.25, "found": ["hung: …"]}
    kinds = {"kills": [row], "requests": [], "disks": [row | {"found": []}], "twice": []}
    stamped = {"measured": "2026-01-01", "commit": "abc", **kinds}
    (tmp_path / "interruptions.json").write_text(json.dumps(stamped))
    section = interrupted.interrupted(Records(tmp_path))
    assert "| train | 9 of 10 | – | 10 of 10 | – | 0.2 s |" in section.body
    assert "19 of 20 came out right" in section.body
