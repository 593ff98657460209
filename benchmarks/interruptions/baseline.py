"""What an undisturbed command does: how long it takes, its files, their bytes, what it comes to."""

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.interruptions.cases import Case
from benchmarks.interruptions.processes import Command, Ended, Stroke, wakedeploy
from benchmarks.interruptions.whole import broken_files

_LIMIT_S = 120.0  # for what takes some seconds
_ENDLESS_S = 20.0


@dataclass(frozen=True)
class Baseline:
    """One undisturbed run."""

    seconds: float
    files: int
    bytes: int
    told: Any


class Place:
    """A folder for one command at a time; empty at the beginning, gone at the end."""

    def __init__(self, work: Path) -> None:
        self.folder = Path(tempfile.mkdtemp(dir=work)) / "here"
        self.folder.mkdir()

    def __enter__(self) -> "Place":
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.folder.parent)

    def run(self, case: Case, stroke: Stroke | None = None) -> Ended:
        """Run the command here to its end, or to that of its patience."""
        return Command(wakedeploy(*case.arguments), self.folder, stroke).ended(_LIMIT_S)


def measured(case: Case, work: Path) -> Baseline:
    """Run a command undisturbed; RuntimeError where even that fails."""
    if case.endless:
        return Baseline(_ENDLESS_S, 0, 0, None)
    with Place(work) as place:
        ended = place.run(case)
        broken = broken_files(place.folder)
        if ended.status != 0 or broken or ended.children_s is None:
            raise RuntimeError(f"{case.name} fails undisturbed: {broken} {ended.stderr}")
        used = sum(p.stat().st_size for p in place.folder.rglob("*") if p.is_file())
        return Baseline(ended.seconds, ended.files, used, case.told(place.folder))
