"""Jobs on an existing dask.distributed cluster.

Sets travel with the jobs: workers need no folder in common with this machine, and each checks the
sha256 of what arrived. A set is handed to the scheduler once, as a task that returns it. So it
can be made again for any worker when the one that held it is lost; scattered data could not.

Jobs and sets go to admitted workers only: those that were looked at and fit. What they are admitted
by is a resource in dask's sense, which they are given for as long as they run.
"""

import collections
import contextlib
import logging
import platform
import time
import warnings
from collections.abc import Awaitable, Callable, Collection, Iterator, Mapping
from typing import Any

import wakedeploy
from trainers.training.runs import TRAINING
from wakedeploy.core.episodes import EpisodeSet, read_episode_set
from wakedeploy.core.errors import CheckFailed, UnusableInput, installs, one_line
from wakedeploy.sweep.jobs import Job, Outcome, TrainJob, do, failure

try:
    import distributed
    from distributed.scheduler import KilledWorker
except ModuleNotFoundError as missing:
    raise UnusableInput(
        f"{missing.name} is not installed; --scheduler needs: {installs('cluster')}."
    ) from missing

CONNECT_S = 5.0
_POLL_S = 0.05
_LOOK_S = 2.0  # between two looks at who has joined
_FETCH_S = 1.0  # for a result to arrive; doubled with each attempt
_FETCH_MOST_S = 30.0  # meanwhile no other job's row is written
_NEEDED = ("wakedeploy", "torch")
_ADMITTED = f"wakedeploy-{wakedeploy.__version__}"
_NO_LIMIT = 1e9  # of jobs side by side: the resource admits, it does not count


class Cluster:
    """The workers of a scheduler. A job whose worker is lost is done again by another.

    Workers that join later are used as well, if they fit; those that do not get no job, and
    `on_misfit` gets one sentence about each.

    A worker does one training at a time, however many threads it has. What a worker is at when the
    sweep is stopped runs to its end there and is not used.
    """

    def __init__(
        self,
        address: str,
        on_misfit: Callable[[str], None] = lambda sentence: None,
        *,
        device: str = "auto",
    ) -> None:
        """Connect and look at the workers; with `device` "cuda" only those that have it fit.

        Raises UnusableInput for a scheduler that cannot be reached within CONNECT_S, has no
        worker, or has none that fits.
        """
        self._address, self._on_misfit, self._device = address, on_misfit, device
        self._jobs: dict[str, tuple[Job, Any]] = {}  # with their futures
        self._sets: dict[str, Any] = {}
        self._fetches: collections.Counter[str] = collections.Counter()
        self._refused: set[str] = set()  # addresses of workers that do not fit
        self._reported: set[str] = set()  # what was said of them
        # This module reports lost workers and connections.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        self._client = _connected(address)
        try:
            _require_workers(self._client, address)
            problems = self._admit()
            if problems and len(problems) == len(self._workers()):
                raise UnusableInput(problems[0])
            self._tell(problems)
        except BaseException:
            self._client.close()
            raise
        self._looked = time.monotonic()

    def submit(self, job: Job) -> None:
        """Take on a job."""
        data = self._shipped(job) if isinstance(job, TrainJob) else None
        future = self._client.submit(
            do, job, data, key=f"wakedeploy-{job.identity}", resources={_ADMITTED: 1}
        )
        self._jobs[future.key] = job, future

    def finished(self) -> Iterator[tuple[Job, Outcome]]:
        """Jobs with what became of them, as they finish.

        Raises CheckFailed when the connection to the scheduler is lost.
        """
        # Looked at rather than waited for, so that a scheduler that is gone is noticed in any case.
        while self._jobs:
            ended = [key for key, (_, future) in self._jobs.items() if future.status != "pending"]
            for key in ended:
                job, future = self._jobs[key]
                if future.status == "pending":  # its result went with a worker since we looked
                    continue
                outcome = self._outcome(future, job)
                if outcome is not None:
                    del self._jobs[key]
                    # Before anything else: a result that is still asked for is computed again if
                    # the worker that holds it is lost meanwhile.
                    future.release()
                    yield job, outcome
            if self._client.status != "running":
                raise self._lost()
            self._look_again()
            if not ended:
                time.sleep(_POLL_S)

    def cancel(self) -> None:
        """Take back what waits and leave the cluster to itself."""
        with contextlib.suppress(Exception):  # the scheduler may be what is gone
            waiting = [future for _, future in self._jobs.values()]
            self._client.cancel([*waiting, *self._sets.values()])
        with contextlib.suppress(Exception):
            self._client.close(timeout=CONNECT_S)

    def _look_again(self) -> None:
        """Now and then: workers may have joined."""
        if time.monotonic() - self._looked < _LOOK_S:
            return
        with contextlib.suppress(OSError):  # of a scheduler or a worker that is just lost
            self._tell(self._admit())
        self._looked = time.monotonic()

    def _tell(self, problems: Collection[str]) -> None:
        for problem in problems:
            if problem not in self._reported:
                self._reported.add(problem)
                self._on_misfit(problem)

    def _workers(self) -> Mapping[str, Any]:
        """What the scheduler says of each worker, by its address."""
        # Releases of a year report five workers only, unless asked for all (distributed #9045).
        workers: Mapping[str, Any] = self._client.scheduler_info(n_workers=-1)["workers"]
        return workers

    def _admit(self) -> list[str]:
        """Let new workers that fit have jobs; what is wrong with each of the others."""
        strangers = [
            name
            for name, facts in self._workers().items()
            if _ADMITTED not in facts["resources"] and name not in self._refused
        ]
        problems = _problems(self._client, strangers, self._device) if strangers else {}
        fit = [name for name, problem in problems.items() if problem is None]
        if fit:
            self._client.run(_admission(), workers=fit, on_error="ignore")
        self._refused |= problems.keys() - set(fit)
        return [problem for problem in problems.values() if problem is not None]

    def _shipped(self, job: TrainJob) -> Any:
        """The job's set as a task of the cluster, the same for all jobs on it."""
        sha256 = job.config.data_sha256
        if sha256 not in self._sets:
            with warnings.catch_warnings():  # of a graph that is large: that is the point
                warnings.simplefilter("ignore", UserWarning)
                self._sets[sha256] = self._client.submit(
                    _itself,
                    read_episode_set(job.folder),
                    key=f"wakedeploy-set-{sha256}",
                    resources={_ADMITTED: 1},
                )
        return self._sets[sha256]

    def _lost(self) -> CheckFailed:
        return CheckFailed(
            f"The connection to the scheduler at {self._address} is lost; rows that were written"
            " stay, and the same command goes on when it is back."
        )

    def _outcome(self, future: Any, job: Job) -> Outcome | None:
        """What became of a job; None where it did not arrive in time, being large or just lost.

        A result that is lost with its worker is computed again, maybe by one that joins meanwhile.
        """
        self._fetches[job.identity] += 1
        try:
            limit_s = min(_FETCH_S * 2 ** self._fetches[job.identity], _FETCH_MOST_S)
            outcome: Outcome = future.result(timeout=limit_s)
        except KilledWorker as error:
            return failure(job, f"{error.allowed_failures + 1} workers were lost while at it")
        except TimeoutError:
            return None
        except (distributed.CancelledError, OSError) as error:
            raise self._lost() from error
        except Exception as error:
            return failure(job, f"unexpected {type(error).__name__}: {one_line(error)}")
        return outcome


def _itself(data: EpisodeSet) -> EpisodeSet:
    return data


def _connected(address: str) -> Any:
    try:
        # A client of an address that is none complains once more when it is thrown away.
        distributed.comm.get_address_host_port(address, strict=True)
        return distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise UnusableInput(
            f"No scheduler answers at {address} ({one_line(error).rstrip('.')}); start one with"
            " `dask scheduler`, or leave --scheduler out."
        ) from error


def _require_workers(client: Any, address: str) -> None:
    """UnusableInput unless there are workers."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError as error:
        raise UnusableInput(
            f"The scheduler at {address} has no worker; start some with `dask worker {address}"
            " --nthreads 1`."
        ) from error


def _admission() -> Callable[[Any], Awaitable[None]]:
    name, limit = _ADMITTED, _NO_LIMIT

    async def admit(dask_worker: Any) -> None:  # a closure, as below
        from distributed.core import Status

        await dask_worker.set_resources(**{name: limit})
        # Jobs that wait because all workers before this one are lost go to workers that join or
        # return from a pause, and not by themselves to one that is given a resource.
        if dask_worker.status == Status.running:
            dask_worker.status = Status.paused
            dask_worker.status = Status.running

    return admit


def _problems(client: Any, names: Collection[str], device: str) -> dict[str, str | None]:
    """What keeps each of these workers from doing jobs, None if nothing does.

    Workers that are lost meanwhile are left out.
    """
    versions = client.get_versions()["workers"]
    # One that is just starting or ending may say nothing of itself; it is looked at again.
    hosts = {name: versions[name]["host"] for name in names if "host" in (versions.get(name) or {})}
    problems = {name: misfit(name, str(host["python"]), None) for name, host in hosts.items()}
    # Code that travels is understood by the same Python only.
    alike = [name for name, problem in problems.items() if problem is None]
    found = client.run(_looker(), workers=alike, on_error="ignore") if alike else {}
    others = {name: problem for name, problem in problems.items() if problem is not None}
    return others | {name: misfit(name, None, there, device) for name, there in found.items()}


def misfit(
    name: str,
    python: str | None,
    there: Mapping[str, Any] | None,
    device: str = "auto",
) -> str | None:
    """What keeps a worker from doing this machine's jobs, in one sentence; None if nothing does.

    `python` is its version, `there` what `_looker` found: its versions of wakedeploy and torch,
    None where one is missing, the revision of its training code and whether it has CUDA. What is
    None was not asked for.
    """
    ours = ".".join(platform.python_version_tuple()[:2])
    if python is not None and (theirs := ".".join(python.split(".")[:2])) != ours:
        # Neither functions nor results would be understood.
        return f"The worker {name} runs Python {theirs}, and this is {ours}; use one for both."
    if there is None:
        return None
    for library in _NEEDED:
        if there[library] is None:
            return (
                f"The worker {name} has no {library}; install there, in wakedeploy's checkout:"
                " pip install --constraint constraints.txt '.[train,cluster]'."
            )
    if there["wakedeploy"] != wakedeploy.__version__:
        return (
            f"The worker {name} has wakedeploy {there['wakedeploy']}, and this is"
            f" {wakedeploy.__version__}; install the same there."
        )
    if there["training"] != TRAINING:
        return (
            f"The worker {name} trains by revision {there['training']} of the training code, and"
            f" this is {TRAINING}; install the same commit there."
        )
    if device == "cuda" and not there["cuda"]:
        return f"The worker {name} has no CUDA; leave --device out, or start workers that have it."
    return None


def _looker() -> Callable[[], dict[str, Any]]:
    def look() -> dict[str, Any]:  # a closure travels as code: wakedeploy may be missing there
        found: dict[str, Any] = {"wakedeploy": None, "torch": None, "training": None, "cuda": False}
        try:
            import wakedeploy as there
        except Exception:  # whatever is there, it is not what is needed
            return found
        found["wakedeploy"] = there.__version__
        try:
            from trainers.training.device import require_cuda
            from trainers.training.runs import TRAINING as revision
            from wakedeploy.core.errors import UnusableInput as Refused
        except Exception:  # they need torch
            return found
        found |= {"torch": "there", "training": revision}
        with contextlib.suppress(Refused):
            require_cuda()
            found["cuda"] = True
        return found

    return look
