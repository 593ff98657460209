"""What an undisturbed command does: how long it takes, its files, their bytes, what it comes to."""

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.interruptions.cases import Case
from benchmarks.interruptions.processes import Command, Ended, Stroke, wakedeploy
from benchmarks.interruptions.whole import broken_files

_ENDLESS_S = 10.0
_ENDLESS_BYTES = 60_000  # what a recording of some seconds takes


@dataclass(frozen=True)
class Baseline:
    """One undisturbed run; `begins_s` is what the command line takes to begin."""

    seconds: float
    begins_s: float
    files: int
    bytes: int
    result: Any


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
        """Run the command here to its end."""
        return Command(wakedeploy(*case.arguments), self.folder, stroke).ended()


def measured(case: Case, work: Path) -> Baseline:
    """Run a command undisturbed; RuntimeError where even that fails."""
    begins_s = _begins_s(work)
    if case.endless:
        return Baseline(_ENDLESS_S, begins_s, 0, _ENDLESS_BYTES, None)
    with Place(work) as place:
        ended = place.run(case)
        broken = broken_files(place.folder)
        if ended.status != 0 or broken or ended.children_s is None:
            raise RuntimeError(f"{case.name} fails undisturbed: {broken} {ended.stderr}")
        used = sum(p.stat().st_size for p in place.folder.rglob("*") if p.is_file())
        return Baseline(ended.seconds, begins_s, ended.files, used, case.read_result(place.folder))


def _begins_s(work: Path) -> float:
    """Twice what the quickest command takes, for machines that are busy now and then."""
    with Place(work) as place:
        return 2.0 * Command(wakedeploy("--version"), place.folder).ended().seconds
