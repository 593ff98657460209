"""Commands whose disk is full before they are done, and which are given again once there is room.

In: a case, its baseline, a number of disks. Out: a row of the record. Each disk is a file system of
its own in memory, with part of the room that the command needs.
"""

import contextlib
import random
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.interruptions.baseline import Baseline, Place
from benchmarks.interruptions.cases import Case
from benchmarks.interruptions.judge import Row
from benchmarks.interruptions.processes import Ended

_PAGE_BYTES = 4096
_OF_NAMES = 0.25  # of the disks run out of names for files
_ENOUGH = "size=256m,nr_inodes=1m"
# What happened, where, and what to do.
_SENTENCE = re.compile(r"^(Error: )?.*/?\S+.*No space left on device.*; .+\.$", re.MULTILINE)


def are_possible(work: Path) -> bool:
    """Whether this user may mount a disk."""
    folder = work / "disk"
    folder.mkdir()
    with (
        contextlib.suppress(subprocess.CalledProcessError, FileNotFoundError),
        _disk(folder, "size=8k"),
    ):
        return True
    return False


def filled(case: Case, base: Baseline, work: Path, count: int, seed: str) -> dict[str, Any]:
    """Run a command on `count` disks that are too small for it, and again with room."""
    rng, row = random.Random(f"{seed} {case.name} disks"), Row(case.name)
    for _ in range(count):
        room = _room(base, rng)
        with Place(work) as place, _disk(place.folder, room):
            done = [f"a disk of {room}"]
            ended = place.run(case)
            row.judge_files(place.folder, ended, done)
            if "No space left" in ended.stderr or ended.status:
                row.strokes += 1
                _judge_answer(ended, row, done)
            _mount(place.folder, f"remount,{_ENOUGH}")
            ended = place.run(case)
            done.append("room")
            row.judge_files(place.folder, ended, done)
            row.judge_result(case, base, place.folder, ended, done)
    return row.as_json()


def _room(base: Baseline, rng: random.Random) -> str:
    """Too few pages for what the command writes, or too few files, whichever comes first."""
    pages = rng.randint(1, max(1, base.bytes // _PAGE_BYTES))
    names = rng.randint(1, 4) if rng.random() < _OF_NAMES else 1_000_000
    return f"size={_PAGE_BYTES * pages},nr_inodes={names}"


def _judge_answer(ended: Ended, row: Row, done: list[str]) -> None:
    """One sentence; a status of 0 only where nothing but a picture is missing."""
    is_told = _SENTENCE.search(ended.stderr) and "Traceback" not in ended.stderr
    is_right = ended.status in (1, 2) or "No pictures:" in ended.stderr
    if not (is_told and is_right):
        row.found["answer"].append(f"status {ended.status} on {done[0]}: {ended.stderr[-3000:]}")


@contextlib.contextmanager
def _disk(folder: Path, room: str) -> Iterator[None]:
    _mount(folder, room)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def _mount(folder: Path, options: str) -> None:
    words = ["mount", "-t", "tmpfs", "-o", options, "wakedeploy", folder]
    subprocess.run(words, check=True, stderr=subprocess.DEVNULL)
