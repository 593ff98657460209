"""Run the benchmark: fly each case, let the workflow close the gap, judge; resumable.

In: cases and a folder. Out: `cases.jsonl`, one line per finished case. Each line is appended in one
write, so a killed run loses the cases under way and nothing else; the next run does what is
missing, if it is a run of the same code.
"""

import functools
import shutil
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.hidden_effects.cases import Case
from benchmarks.hidden_effects.flown import TRACKED, tracked
from benchmarks.hidden_effects.judge import FAILED, judge
from benchmarks.hidden_effects.lines import LINES, read_lines
from benchmarks.hidden_effects.worlds import write_world
from wakedeploy.core.commit import frozen_at
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import append_json_line, write_text_whole
from wakedeploy.core.processes import pool
from wakedeploy.gap.systems.gantry.artefacts import Result

Close = Callable[..., Result]


@dataclass(frozen=True)
class Job:
    """One case to do; `close` is the workflow under test, `keep` whether its files stay."""

    case: Case
    out: Path
    close: Close
    keep: bool
    frozen_at: str


def run_cases(
    cases: Sequence[Case],
    out: Path,
    *,
    workers: int = 1,
    keep: bool = False,
    close: Close | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """Do the cases that `out` lacks and return the lines of all of `cases`, in their order.

    `close` is the gantry's `workflow.close` unless given. `progress(done, total)` counts what is
    done, earlier runs included. A case on which the workflow fails is a line with its error, judged
    wrong, and is tried again by the next run.

    Raises UnusableInput where cases are missing and the lines that are there came of other code.
    """
    lines, commit = read_lines(out), frozen_at()
    done = {line["name"]: line for line in lines if "error" not in line}
    workflow = close if close is not None else _workflow()
    jobs = [Job(c, out, workflow, keep, commit) for c in cases if c.name not in done]
    if jobs:
        _require_same_code(out, lines, commit)
    out.mkdir(parents=True, exist_ok=True)
    if progress is not None:
        progress(len(cases) - len(jobs), len(cases))
    for count, line in enumerate(_lines(jobs, workers), start=len(cases) - len(jobs) + 1):
        append_json_line(out / LINES, line)
        done[line["name"]] = line
        if progress is not None:
            progress(count, len(cases))
    return [done[c.name] for c in cases if c.name in done]


def _require_same_code(out: Path, lines: Sequence[Mapping[str, Any]], commit: str) -> None:
    """UnusableInput where lines of a run would be joined by lines that other code makes."""
    others = sorted({str(line.get("commit", "")) or "no commit" for line in lines})
    if others and (others != [commit or "no commit"] or commit.endswith("-dirty")):
        raise UnusableInput(
            f"{out / LINES}: made at {', '.join(others)}, and this is {commit or 'no commit'}; a "
            "run is continued only by the same committed code: give another --out folder."
        )


def do_case(job: Job) -> dict[str, Any]:
    """Fly, close, judge; the line of one case. A failure anywhere is a wrong answer."""
    label = job.case.name.replace("/", "_").replace("+", "_")
    world, truth = job.out / "worlds" / label, job.out / "truth" / f"{label}.json"
    started = time.process_time()
    line = unjudged(job.case) | {"commit": job.frozen_at}
    result: dict[str, Any] = {"verdict": FAILED}
    try:
        logs = write_world(job.case, world, truth)
        flown = time.process_time()
        try:
            answer = job.close(world / "rig.toml", logs, world / "answer", workers=1)
            result = answer.as_json()
            line |= {"seconds": time.process_time() - flown, "seconds_flying": flown - started}
        except Exception as error:
            line["error"] = _failure(error, job.out / "errors" / f"{label}.txt")
        closed = time.process_time()
        line |= judge(world, result, truth)
        line["seconds_judging"] = time.process_time() - closed
        if job.case.name in TRACKED:
            line |= _tracked(job.case, world, job.out / "errors" / f"{label}-tracking.txt")
    except Exception as error:  # a failure of the benchmark's own
        failure = _failure(error, job.out / "errors" / f"{label}-judge.txt")
        line["error"] = "; ".join(filter(None, (line.get("error"), failure)))
    if not job.keep and "error" not in line:
        shutil.rmtree(world, ignore_errors=True)
    return line


def unjudged(case: Case) -> dict[str, Any]:
    """The line of a case on which all failed: wrong, at the strength that it was meant to have."""
    line = {"name": case.name, "kind": case.kind, "plant": case.plant, "seed": case.seed}
    line |= {"target_nats": case.nats, "nats": float(case.nats), "hidden": [*case.truth_names]}
    line |= {"verdict": FAILED, "right": False, "partial": False, "named": [], "class": []}
    return line | {"named_intervals": [], "closed": None, "seconds": None}


def _tracked(case: Case, world: Path, failures: Path) -> dict[str, Any]:
    """What a tracked case's line has besides; a failure here makes the answer no less right."""
    started = time.monotonic()
    try:
        tracking: dict[str, Any] = {"tracking": tracked(case, world)}
    except Exception as error:
        tracking = {"tracking": None, "tracking_error": _failure(error, failures)}
    return tracking | {"seconds_tracking": time.monotonic() - started}


def _failure(error: Exception, path: Path) -> str:
    """One line about an exception; its traceback goes to a file."""
    write_text_whole(path, traceback.format_exc())
    return " ".join(f"{type(error).__name__}: {error}".split())


def _lines(jobs: Sequence[Job], workers: int) -> Iterator[dict[str, Any]]:
    """Finished lines as they come."""
    if workers <= 1:
        yield from map(do_case, jobs)
        return
    with pool(workers) as several:
        for future in as_completed([several.submit(do_case, job) for job in jobs]):
            yield future.result()


def _workflow() -> Close:
    from wakedeploy.gap.systems.gantry.workflow import close

    return functools.partial(close, report=False, plan=False)  # nobody looks at three hundred
