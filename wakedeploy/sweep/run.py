"""A sweep from its plan to its results: what is missing is done, each job once.

In: a plan, a folder, an executor. Out: rows in the folder, and which of them the plan asked for.
"""

import collections
import contextlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from wakedeploy.core.episodes import EpisodeSet, read_episode_set
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import json_of, remove_unfinished, text_of, write_text_whole
from wakedeploy.core.locks import alone
from wakedeploy.sweep.executor import Executor
from wakedeploy.sweep.jobs import (
    RUNS,
    SETS,
    GenerateJob,
    Job,
    Outcome,
    Row,
    TrainJob,
    UnfitJob,
    failure,
    generate_job,
    keep_run,
    train_jobs,
)
from wakedeploy.sweep.plan import Plan
from wakedeploy.sweep.results import Results

MARK = "sweep.json"  # says that a folder is a sweep's
_FORMAT = 1

OnProgress = Callable[[int, int], None]


@dataclass
class Report:
    """How a sweep ended: the rows of the jobs that the plan asks for, in the plan's order.

    `waiting` counts trainings whose set could not be generated, `begun` the jobs done this time.
    """

    rows: list[Row] = field(default_factory=list)
    waiting: int = 0
    begun: int = 0

    @property
    def failed(self) -> list[Row]:
        """The rows of the jobs that failed."""
        return [row for row in self.rows if row["state"] == "failed"]

    def of_other_commits(self, present: str) -> collections.Counter[str]:
        """How many of the rows each other commit has made; those unknown aside.

        Earlier sweeps into this folder have, or workers of a cluster with another checkout.
        """
        made_by = [row.get("commit") for row in self.rows]
        known = [commit for commit in made_by if commit and present]
        return collections.Counter(commit for commit in known if commit != present)


def sweep(
    plan: Plan,
    out: Path,
    executor: Executor,
    *,
    device: str = "auto",
    retry_failed: bool = False,
    on_progress: OnProgress = lambda done, total: None,
) -> Report:
    """Do what the plan asks for and `out` lacks; every finished job's row is written at once.

    `on_progress(done, total)` counts jobs, those of earlier sweeps into this folder included. The
    executor is let go of in any case. Raises UnusableInput for a folder of something else, and for
    a set that is there and cannot be trained on; of a generated one that is a failed row for each
    training that does not fit it.
    """
    try:
        require_ours(out)
        work = _Sweep(plan, out, executor, device, retry_failed, on_progress)
        known = work.known_sets()  # refused before anything is written
        with _opened(out):
            work.begin(known)
            try:
                work.carry_out()
            finally:
                # Of what is on the disk: an interruption may strike between a row and its keeping.
                Results(out).write_table()
        return work.report()
    finally:
        executor.cancel()


def require_ours(out: Path) -> None:
    """Raise UnusableInput for a folder that is there, not empty and not a sweep's."""
    mark = out / MARK
    if not out.exists() or (out.is_dir() and not any(out.iterdir())):
        return
    try:
        version = json_of(text_of(mark))["wakedeploy_sweep"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UnusableInput(
            f"{out} is not the folder of a sweep; give --out a new folder, or one that a sweep has"
            " made."
        ) from error
    if version != _FORMAT:
        raise UnusableInput(
            f"{mark}: format {version} is not the one of this wakedeploy ({_FORMAT}); give another"
            " --out."
        )


@contextlib.contextmanager
def _opened(out: Path) -> Iterator[None]:
    """Mark a folder as a sweep's and keep other sweeps out of it while the block runs."""
    out.mkdir(parents=True, exist_ok=True)
    if not (out / MARK).exists():
        write_text_whole(out / MARK, json.dumps({"wakedeploy_sweep": _FORMAT}) + "\n")
    with alone(out, "Another sweep", "sweep"):
        remove_unfinished(out)
        yield


class _Sweep:
    """One sweep at work: what is asked for, what is done, what depends on a set being made."""

    def __init__(
        self,
        plan: Plan,
        out: Path,
        executor: Executor,
        device: str,
        retry_failed: bool,
        on_progress: OnProgress,
    ) -> None:
        self.plan, self.out, self.executor = plan, out, executor
        self.device, self.retry_failed, self.on_progress = device, retry_failed, on_progress
        self.generate = [generate_job(asked) for asked in plan.generate]
        self.asked: dict[str, Job | UnfitJob] = {}
        self.total = plan.jobs
        self.settled, self.begun = 0, 0
        self.results: Results  # read once the folder is ours alone

    def known_sets(self) -> list[TrainJob]:
        """The trainings on sets that are there already; raises UnusableInput for unusable sets."""
        known: list[TrainJob] = []
        for name, folder in self.plan.data.items():
            jobs = [] if folder is None else self._on(name, folder, read_episode_set(folder))
            for job in jobs:
                if isinstance(job, UnfitJob):
                    raise UnusableInput(job.reason)
                known.append(job)
        return known

    def begin(self, known: list[TrainJob]) -> None:
        """Read what is done, and hand the rest out."""
        self.results = Results(self.out)
        self.results.require_sound()
        for making in self.generate:
            self._begin_making(making)
        for job in known:
            self._ask_for(job)
        self.on_progress(self.settled, self.total)

    def carry_out(self) -> None:
        """Take what finishes until nothing is left."""
        for job, outcome in self.executor.finished():
            self.begun += 1
            self._take(job, outcome)
            self.settled += 1
            self.on_progress(self.settled, self.total)

    def report(self) -> Report:
        """The rows of what was asked for."""
        rows = [self.results.rows[identity] for identity in self.asked]
        return Report(rows, waiting=self.total - len(rows), begun=self.begun)

    def _begin_making(self, job: GenerateJob) -> None:
        """Generate a set, unless it lies there as it was made."""
        folder = self.out / SETS / job.asked.name
        row = self.results.rows.get(job.identity, {})
        self.asked[job.identity] = job
        there = _whole(folder) if self.results.done(job.identity) else None
        if there is not None and there.sha256 == row["data_sha256"]:
            self.settled += 1
            self._train_on(job.asked.name, folder, there)
        elif self.results.failed(job.identity) and not self.retry_failed:
            self.settled += 1
        else:
            self.executor.submit(job)

    def _ask_for(self, job: TrainJob | UnfitJob) -> None:
        """Hand out a training unless it is done, or failed and is not to be tried again."""
        if job.identity in self.asked:
            self.total -= 1
            return
        self.asked[job.identity] = job
        failed = self.results.failed(job.identity)
        if self.results.done(job.identity) or (failed and not self.retry_failed):
            self.settled += 1
        elif isinstance(job, UnfitJob):
            self.results.add(failure(job, job.reason).row)
            self.settled += 1
        else:
            self.executor.submit(replace(job, fresh=failed))

    def _take(self, job: Job, outcome: Outcome) -> None:
        """Keep what a job made, then its row: a row speaks only of what is on the disk."""
        if isinstance(job, TrainJob):
            if outcome.files:
                keep_run(job, outcome.files, self.out / RUNS)
            self.results.add(outcome.row)
            return
        if outcome.made is None:
            self.results.add(outcome.row)
            return
        name, folder = job.asked.name, self.out / SETS / job.asked.name
        outcome.made.write(folder)
        self.results.add(outcome.row)
        self._train_on(name, folder, outcome.made)

    def _train_on(self, name: str, folder: Path, data: EpisodeSet) -> None:
        if name in self.plan.data:
            for job in self._on(name, folder, data):
                self._ask_for(job)

    def _on(self, name: str, folder: Path, data: EpisodeSet) -> list[TrainJob | UnfitJob]:
        jobs = train_jobs(name, folder, data, self.plan.choices, device=self.device)
        self.total -= len(self.plan.choices) - len(jobs)
        return jobs


def _whole(folder: Path) -> EpisodeSet | None:
    """The set in a folder; None where it is gone or damaged, and so has to be made again."""
    try:
        return read_episode_set(folder)
    except UnusableInput:
        return None
