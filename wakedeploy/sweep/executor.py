"""Where jobs are carried out: one small interface, and this machine's processes behind it.

`core.parallel` takes all its jobs at once. Here jobs may be added while others finish: a set that
was generated is trained on. A job that fails or takes its process along does not end the others,
and all can be stopped at once.
"""

import collections
import multiprocessing.connection
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Protocol

from wakedeploy.core.processes import default_workers
from wakedeploy.sweep.jobs import Job, Outcome, failure
from wakedeploy.sweep.worker import Worker

ATTEMPTS = 3  # of a job whose process is killed


class Executor(Protocol):
    """Carries out jobs somewhere, in any order."""

    def submit(self, job: Job) -> None:
        """Take on a job; also while `finished` is being iterated."""

    def finished(self) -> Iterator[tuple[Job, Outcome]]:
        """Jobs with what became of them, as they finish, until none is left."""

    def cancel(self) -> None:
        """Give up what is not finished, and let go of what was held."""


class LocalProcesses:
    """As many processes as asked for (None: `default_workers`), each with one thread.

    Runs lie in `runs` and go on where they were stopped. A job whose process is killed is done
    again, up to ATTEMPTS times.
    """

    def __init__(self, runs: Path, workers: int | None = None) -> None:
        self._runs = runs.absolute()
        self._limit = workers or default_workers()
        self._waiting: collections.deque[Job] = collections.deque()
        self._workers: list[Worker] = []
        self._attempts: collections.Counter[str] = collections.Counter()

    def submit(self, job: Job) -> None:
        """Take on a job."""
        self._waiting.append(job)

    def finished(self) -> Iterator[tuple[Job, Outcome]]:
        """Jobs with what became of them, as they finish; OSError where the disk is full."""
        while self._waiting or any(worker.job for worker in self._workers):
            self._hand_out()
            busy = {worker.pipe: worker for worker in self._workers if worker.job}
            for pipe in multiprocessing.connection.wait(list(busy)):
                assert isinstance(pipe, Connection)
                ended = self._collect(busy[pipe])
                if ended is not None:
                    yield ended

    def cancel(self) -> None:
        """End the processes at once."""
        self._waiting.clear()
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join()
        self._workers.clear()

    def _hand_out(self) -> None:
        idle = [worker for worker in self._workers if worker.job is None]
        while self._waiting and (idle or len(self._workers) < self._limit):
            if not idle:
                idle.append(Worker(self._runs))
                self._workers.append(idle[0])
            worker = idle.pop()
            worker.begin(self._waiting.popleft())

    def _collect(self, worker: Worker) -> tuple[Job, Outcome] | None:
        """What a worker sends; None where it was killed and its job is to be done again."""
        job = worker.job
        assert job is not None
        try:
            outcome: Outcome | OSError = worker.pipe.recv()
        except (EOFError, OSError):
            worker.process.join()
            self._workers.remove(worker)
            self._attempts[job.identity] += 1
            if self._attempts[job.identity] < ATTEMPTS:
                self._waiting.appendleft(job)
                return None
            return job, failure(job, f"its process was killed {ATTEMPTS} times")
        worker.job = None
        if isinstance(outcome, OSError):
            raise outcome
        return job, outcome
