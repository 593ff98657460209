"""The same work on many jobs, side by side: the one way in which results are made in processes.

In: a function of one job, and jobs. Out: the results in the jobs' order, the same for any number of
processes if this one computes with one thread, as each fresh one does.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.processes import default_workers, may_start_others, one_thread, pool

Job = TypeVar("Job")
Result = TypeVar("Result")


def parallel_map(
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    workers: int | None = None,
    fresh: bool = False,
    on_done: Callable[[Job, Result], None] = lambda job, result: None,
    steps: Callable[[int, int], object] = lambda done, total: None,
) -> list[Result]:
    """`work` of each job, on `workers` processes (None: `default_workers`), in this one if it is 1.

    So it is in a process that may start none, as a worker of a `multiprocessing.Pool`. `work` must
    be a function of a module. Processes are copies of this one, or `fresh` ones of one thread:
    torch does not survive a copy. `on_done(job, result)` and `steps(done, total)` are called as
    jobs are done, in any order. The first failure, Ctrl-C included, ends all processes.
    Raises what `work` raises, and CheckFailed where the system killed a process.
    """
    workers = min(workers or default_workers(), len(jobs)) if may_start_others() else 1
    results: dict[int, Result] = {}

    def keep(place: int, result: Result) -> None:
        results[place] = result
        on_done(jobs[place], result)
        steps(len(results), len(jobs))

    if workers <= 1:
        for place, job in enumerate(jobs):
            keep(place, work(job))
    else:
        _share_out(work, jobs, workers, fresh, keep)
    return [results[place] for place in range(len(jobs))]


def _share_out(
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: int,
    fresh: bool,
    keep: Callable[[int, Result], None],
) -> None:
    try:
        with pool(workers, fresh=fresh, begin=one_thread if fresh else None) as several:
            places: dict[Any, int] = {several.submit(work, job): i for i, job in enumerate(jobs)}
            for done in as_completed(places):
                keep(places[done], done.result())
    except BrokenProcessPool as error:
        raise CheckFailed(
            f"A process of {workers} was killed; is there enough memory for so many?"
        ) from error
