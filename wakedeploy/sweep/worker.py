"""One of this machine's processes that do a sweep's jobs.

Imports little: what heavy libraries read from the environment has to be set before they are loaded.
"""

import multiprocessing
import signal
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from wakedeploy.study.side_by_side import begin_worker

if TYPE_CHECKING:
    from wakedeploy.sweep.jobs import Job


class Worker:
    """A process that does one job at a time; `job` is the one it is at."""

    def __init__(self, runs: Path) -> None:
        # torch does not survive a fork once it has computed.
        fresh = multiprocessing.get_context("spawn")
        self.job: Job | None = None
        self.pipe, theirs = fresh.Pipe()
        self.process = fresh.Process(target=_serve, args=(theirs, runs))
        resource_tracker.ensure_running()  # which would otherwise let Ctrl-C through again
        # Ctrl-C is the parent's to act on: a child that is still starting would print a traceback.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self.process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()

    def begin(self, job: "Job") -> None:
        """Send a job; a worker that was killed while idle is noticed when its answer is read."""
        self.job = job
        try:
            self.pipe.send(job)
        except OSError:
            return


def _serve(pipe: Connection, runs: Path) -> None:
    begin_worker()
    from wakedeploy.sweep.jobs import do

    while True:
        try:
            job = pipe.recv()
        except EOFError:
            return
        pipe.send(do(job, runs=runs))
