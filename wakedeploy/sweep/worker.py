"""One of this machine's processes that do a sweep's jobs.

Imports little: what heavy libraries read from the environment has to be set before they are loaded.
"""

import multiprocessing
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from wakedeploy.core.processes import deaf_to_ctrl_c, end_with_parent, one_thread

if TYPE_CHECKING:
    from wakedeploy.sweep.jobs import Job, Outcome


class Worker:
    """A process that does one job at a time; `job` is the one it is at."""

    def __init__(self, runs: Path) -> None:
        # torch does not survive a fork once it has computed.
        fresh = multiprocessing.get_context("spawn")
        self.job: Job | None = None
        self.pipe, theirs = fresh.Pipe()
        self.process = fresh.Process(target=_serve, args=(theirs, runs))
        with deaf_to_ctrl_c():
            self.process.start()
        theirs.close()

    def begin(self, job: "Job") -> None:
        """Send a job; a worker that was killed while idle is noticed when its answer is read."""
        self.job = job
        try:
            self.pipe.send(job)
        except OSError:
            return


def _serve(pipe: Connection, runs: Path) -> None:
    one_thread()
    end_with_parent()
    from wakedeploy.sweep.jobs import do

    while True:
        try:
            job = pipe.recv()
        except EOFError:
            return
        try:
            answer: Outcome | OSError = do(job, runs=runs)
        except OSError as error:
            answer = error
        pipe.send(answer)
