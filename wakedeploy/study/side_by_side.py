"""Work that needs nothing of each other, on as many processes as asked for.

In: a function of one job, and jobs. Out: the results in the jobs' order, the same for any number of
processes if this one computes with one thread, as each of several does.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.processes import default_workers, one_thread, pool

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
    try:
        with pool(workers, fresh=True, begin=one_thread) as several:
            waiting = [several.submit(work, job) for job in jobs]
            which = dict(zip(waiting, jobs, strict=True))
            for done in as_completed(waiting):
                done.result()  # the first failure ends it
                on_done(which[done])
            return [one.result() for one in waiting]
    except BrokenProcessPool as error:
        raise CheckFailed(
            f"A process of {workers} was killed; is there enough memory for so many?"
        ) from error
