"""What came of disturbing one command: counts, and a sentence for each thing that is not right.

In: how the command ended, its folder, its baseline. Out: a row of the record.
"""

from pathlib import Path
from typing import Any

from benchmarks.interruptions.baseline import Baseline
from benchmarks.interruptions.cases import Case
from benchmarks.interruptions.processes import Ended
from benchmarks.interruptions.whole import broken_files


class Row:
    """The account of one command; `found` has what is wrong, by kind."""

    def __init__(self, name: str) -> None:
        self.name, self.strokes, self.at_files, self.let_through = name, 0, 0, 0
        self.outside, self.longest_children_s, self.unfinished = 0, 0.0, 0
        self.found: dict[str, list[str]] = {
            "broken": [], "left_behind": [], "hung": [], "answer": [], "not_done": [], "other": []
        }  # fmt: skip

    def as_json(self) -> dict[str, Any]:
        """For the record."""
        return {
            "command": self.name,
            "strokes": self.strokes,
            "at_files": self.at_files,
            "outside": self.outside,
            "let_through": self.let_through,
            "longest_children_s": round(self.longest_children_s, 2),
            "unfinished_bytes": self.unfinished,
            **{name: len(problems) for name, problems in self.found.items()},
            "found": [
                f"{name}: {problem}"
                for name, problems in self.found.items()
                for problem in problems
            ],
        }

    def judge_files(self, folder: Path, ended: Ended, done: list[str]) -> None:
        """Every file is whole, no process is left, nothing hung."""
        broken = broken_files(folder)
        self.found["broken"] += [f"{problem} after {', '.join(done)}" for problem in broken]
        if ended.children_s is None:
            self.found["left_behind"].append(f"children after {', '.join(done)}")
        else:
            self.longest_children_s = max(self.longest_children_s, ended.children_s)
        if ended.hung:
            self.found["hung"].append(f"after {', '.join(done)}: {ended.stderr[-500:]}")

    def judge_result(
        self, case: Case, base: Baseline, folder: Path, ended: Ended, done: list[str]
    ) -> None:
        """A command that was let through came to what it comes to undisturbed."""
        self.let_through += 1
        if ended.status != 0:
            self.found["not_done"].append(f"after {', '.join(done)}: {ended.stderr[-3000:]}")
            return
        try:
            result = case.read_result(folder)
        except Exception as error:  # any failure to read what should be there
            self.found["other"].append(f"after {', '.join(done)}: {error!r}")
            return
        if result != base.result:
            self.found["other"].append(
                f"after {', '.join(done)}: {_difference(base.result, result)}"
            )


def _difference(wanted: Any, result: Any, where: str = "") -> str:
    """The first place where two results differ."""
    if isinstance(wanted, dict) and isinstance(result, dict) and wanted.keys() == result.keys():
        pairs = [(key, wanted[key], result[key]) for key in wanted]
    elif isinstance(wanted, list) and isinstance(result, list) and len(wanted) == len(result):
        pairs = list(zip(range(len(result)), wanted, result, strict=True))
    else:
        return f"{where}: {str(result)[:200]}, not {str(wanted)[:200]}"
    return next(_difference(w, t, f"{where}/{key}") for key, w, t in pairs if w != t)
