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
from benchmarks.interruptions.judge import Row
from benchmarks.interruptions.processes import Ended, Stroke
from benchmarks.interruptions.whole import unfinished_bytes

KILLS = (signal.SIGKILL,)
REQUESTS = (signal.SIGINT, signal.SIGTERM)
_MOST_IN_ONE_FOLDER = 5
_STOPPED = ("Interrupted.", "Stopped")  # begins the last line of a command that was asked to stop
_MOST_ROUNDS = 3  # rounds for each stroke that is asked for: many find the command done


def struck(
    numbers: tuple[signal.Signals, ...],
    case: Case,
    base: Baseline,
    work: Path,
    count: int,
    seed: str,
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
        row.judge_files(place.folder, ended, done)
        if case.endless and not ended.struck:
            return
        if ended.struck and ended.status == 0 and _went_on(stroke, ended):
            row.found["answer"].append(f"went on after {', '.join(done)}: {ended.stderr[-3000:]}")
        if not ended.struck or ended.status == 0:
            row.judge_result(case, base, place.folder, ended, done)
            return
        row.strokes += 1
        row.at_files += stroke.at_file is not None
        if stroke.number != signal.SIGKILL:
            _judge_answer(case, base, place, ended, row, done)
    row.unfinished = max(row.unfinished, unfinished_bytes(place.folder))
    if not case.endless:
        ended = place.run(case)
        done.append("nothing")
        row.judge_files(place.folder, ended, done)
        row.judge_result(case, base, place.folder, ended, done)


def _went_on(stroke: Stroke, ended: Ended) -> bool:
    """Whether a command did much after its stroke: it should have ended."""
    if stroke.at_file is not None:
        return ended.files - stroke.at_file > 3 + 0.2 * ended.files
    assert stroke.after_s is not None
    return ended.seconds - stroke.after_s > 1.0 + 0.3 * ended.seconds


def _judge_answer(
    case: Case, base: Baseline, place: Place, ended: Ended, row: Row, done: list[str]
) -> None:
    """130 and one sentence, where the signal came between the first line of code and the last."""
    if _is_before(base, ended) or _is_after(case, base, place, ended):
        row.outside += 1
        return
    is_told = _last_words(ended).startswith(_STOPPED) and "Traceback" not in ended.stderr
    if ended.status != 130 or not is_told:
        row.found["answer"].append(
            f"status {ended.status} after {', '.join(done)}: {ended.stderr[-3000:]}"
        )


def _is_before(base: Baseline, ended: Ended) -> bool:
    """While Python starts nobody can answer."""
    return ended.status < 0 and ended.files == 0 and ended.seconds < base.begins_s


def _is_after(case: Case, base: Baseline, place: Place, ended: Ended) -> bool:
    """The work is done, and only the process is left."""
    if ended.status >= 0 or ended.stderr.rstrip().endswith("Interrupted.") or case.endless:
        return False
    try:
        return (
            bool(case.read_result(place.folder) == base.result) and "Traceback" not in ended.stderr
        )
    except Exception:  # any failure to read what is not there
        return False


def _last_words(ended: Ended) -> str:
    lines = ended.stderr.strip().splitlines()
    return lines[-1] if lines else ""
