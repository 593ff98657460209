"""Commands struck at random moments, again and again in one folder, until they are let through.

In: a case, its baseline, a number of strokes. Out: a row of the record, with a sentence for each
thing that is not as it should be.
"""

import random
import signal
from pathlib import Path
from typing import Any

from benchmarks.interruptions.baseline import Baseline, Place
from benchmarks.interruptions.cases import Case
from benchmarks.interruptions.processes import Ended, Stroke
from benchmarks.interruptions.whole import broken_files, unfinished_bytes

KILLS = (signal.SIGKILL,)
REQUESTS = (signal.SIGINT, signal.SIGTERM)
_MOST_IN_ONE_FOLDER = 5
_STOPPED = ("Interrupted.", "Stopped")  # begins the last line of a command that was asked to stop
_MOST_ROUNDS = 3  # rounds for each stroke that is asked for: many find the command done


def struck(
    case: Case, base: Baseline, work: Path, count: int, numbers: tuple[signal.Signals, ...], seed: str
) -> dict[str, Any]:
    """Strike a command `count` times, and let it through after some strokes each time."""
    rng = random.Random(f"{seed} {case.name} {numbers}")
    row = Row(case.name)
    for _ in range(_MOST_ROUNDS * count):
        if row.strokes >= count:
            break
        with Place(work) as place:
            most = min(count - row.strokes, rng.randint(1, _MOST_IN_ONE_FOLDER))
            _round(case, base, place, [_drawn(base, numbers, rng) for _ in range(most)], row)
    return row.as_json()


class Row:
    """What came of the strokes on one command."""

    def __init__(self, name: str) -> None:
        self.name, self.strokes, self.at_files, self.let_through = name, 0, 0, 0
        self.before_it_began, self.longest_children_s, self.unfinished = 0, 0.0, 0
        self.found: dict[str, list[str]] = {
            "broken": [], "left_behind": [], "hung": [], "answer": [], "not_done": [], "other": []
        }  # fmt: skip

    def as_json(self) -> dict[str, Any]:
        """For the record: counts, and the sentences behind those that are not zero."""
        return {
            "command": self.name,
            "strokes": self.strokes,
            "at_files": self.at_files,
            "before_it_began": self.before_it_began,
            "let_through": self.let_through,
            "longest_children_s": round(self.longest_children_s, 2),
            "unfinished_bytes": self.unfinished,
            **{name: len(told) for name, told in self.found.items()},
            "found": [f"{name}: {one}" for name, told in self.found.items() for one in told],
        }


def _drawn(base: Baseline, numbers: tuple[signal.Signals, ...], rng: random.Random) -> Stroke:
    number, group = rng.choice(numbers), rng.random() < 0.5
    group = group and number == signal.SIGINT  # as a terminal does; others are sent to one
    if base.files and rng.random() < 0.5:
        return Stroke(number, group, at_file=rng.randint(1, base.files))
    return Stroke(number, group, after_s=rng.uniform(0.0, base.seconds))


def _round(case: Case, base: Baseline, place: Place, strokes: list[Stroke], row: Row) -> None:
    done: list[str] = []
    for stroke in strokes:
        ended = place.run(case, stroke)
        done.append(stroke.words)
        _judge_files(place, ended, row, done)
        if not ended.struck or ended.status == 0:
            _judge_result(case, base, place, ended, row, done)
            return
        row.strokes += 1
        row.at_files += stroke.at_file is not None
        if stroke.number != signal.SIGKILL:
            _judge_answer(ended, row, done)
    row.unfinished = max(row.unfinished, unfinished_bytes(place.folder))
    if not case.endless:
        ended = place.run(case)
        done.append("nothing")
        _judge_files(place, ended, row, done)
        _judge_result(case, base, place, ended, row, done)


def _judge_files(place: Place, ended: Ended, row: Row, done: list[str]) -> None:
    broken = broken_files(place.folder)
    row.found["broken"] += [f"{one} after {', '.join(done)}" for one in broken]
    if ended.children_s is None:
        row.found["left_behind"].append(f"children after {', '.join(done)}")
    else:
        row.longest_children_s = max(row.longest_children_s, ended.children_s)
    if ended.hung:
        row.found["hung"].append(f"after {', '.join(done)}: {_last_words(ended)}")


def _judge_answer(ended: Ended, row: Row, done: list[str]) -> None:
    """130 and one sentence; nothing at all where the signal came before the first line of code."""
    if ended.status < 0 and not ended.stderr and ended.files == 0:
        row.before_it_began += 1
        return
    last = _last_words(ended)
    if ended.status != 130 or "Traceback" in ended.stderr or not last.startswith(_STOPPED):
        row.found["answer"].append(
            f"status {ended.status} after {', '.join(done)}: {ended.stderr[-3000:]}"
        )


def _judge_result(
    case: Case, base: Baseline, place: Place, ended: Ended, row: Row, done: list[str]
) -> None:
    row.let_through += 1
    if ended.status != 0:
        row.found["not_done"].append(f"after {', '.join(done)}: {ended.stderr[-3000:]}")
        return
    try:
        told = case.told(place.folder)
    except Exception as error:  # any failure to read what should be there
        row.found["other"].append(f"after {', '.join(done)}: {error!r}")
        return
    if told != base.told:
        row.found["other"].append(f"after {', '.join(done)}: {_difference(base.told, told)}")


def _last_words(ended: Ended) -> str:
    lines = ended.stderr.strip().splitlines()
    return lines[-1] if lines else ""


def _difference(wanted: Any, told: Any, where: str = "") -> str:
    """The first place where two results differ."""
    if isinstance(wanted, dict) and isinstance(told, dict) and wanted.keys() == told.keys():
        pairs = [(key, wanted[key], told[key]) for key in wanted]
    elif isinstance(wanted, list) and isinstance(told, list) and len(wanted) == len(told):
        pairs = list(zip(range(len(told)), wanted, told, strict=True))
    else:
        return f"{where}: {str(told)[:200]}, not {str(wanted)[:200]}"
    return next(_difference(w, t, f"{where}/{key}") for key, w, t in pairs if w != t)
