"""Work that needs nothing of each other, on as many processes as asked for.

In: a function of one job, and jobs. Out: the results in the jobs' order, the same for any number of
processes if this one computes with one thread, as each of several does.
"""

import multiprocessing
import multiprocessing.connection
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from wakedeploy.errors import CheckFailed
from wakedeploy.processes import default_workers, end_with_parent

Job = TypeVar("Job")
Result = TypeVar("Result")


def side_by_side(
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    workers: int | None = None,
    on_done: Callable[[Job], None] = lambda job: None,
) -> list[Result]:
    """`work` of each job, on `workers` processes (None: `default_workers`).

    `work` must be a function of a module. `on_done` is called with each job that is done.
    """
    workers = min(workers or default_workers(), len(jobs))
    results: list[Result] = []
    if workers <= 1:
        for job in jobs:
            results.append(work(job))
            on_done(job)
        return results
    # torch does not survive a fork once it has computed; workers end at once when interrupted.
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=fresh, initializer=begin_worker) as pool:
        waiting = [pool.submit(work, job) for job in jobs]
        try:
            which = dict(zip(waiting, jobs, strict=True))
            for done in as_completed(waiting):
                done.result()  # the first failure ends it
                on_done(which[done])
            return [one.result() for one in waiting]
        except BrokenProcessPool as error:
            raise CheckFailed(
                f"A process of {workers} was killed; is there enough memory for so many?"
            ) from error
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def begin_worker() -> None:
    """One thread per process, which libraries read when they are imported; none outlives us."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.environ["OMP_NUM_THREADS"] = "1"
    end_with_parent()
