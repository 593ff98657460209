"""Jobs on an existing dask.distributed cluster.

Sets travel with the jobs: workers need no folder in common with this machine, and each checks the
sha256 of what arrived. A set is handed to the scheduler once, as a task that returns it, so that it
can be made again for any worker when the one that held it is lost (scattered data could not).
"""

import contextlib
import logging
import platform
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import wakedeploy
from wakedeploy.episodes import EpisodeSet, read_episode_set
from wakedeploy.errors import CheckFailed, UnusableInput, one_line
from wakedeploy.sweep.jobs import Job, Outcome, TrainJob, do, failure

try:
    import distributed
    from distributed.scheduler import KilledWorker
except ModuleNotFoundError as missing:
    raise UnusableInput(
        f"{missing.name} is not installed; --scheduler needs: pip install 'wakedeploy[cluster]'."
    ) from missing

CONNECT_S = 5.0
Library = str | None
_POLL_S = 0.05
_NEEDED = ("wakedeploy", "torch")


class Cluster:
    """The workers of a scheduler. A job whose worker is lost is done again by another.

    A worker does one training at a time, however many threads it has. What a worker is at when the
    sweep is stopped runs to its end there and is not used.
    """

    def __init__(self, address: str) -> None:
        """Connect and look at the workers.

        Raises UnusableInput for a scheduler that cannot be reached within CONNECT_S, has no
        worker, or whose workers lack wakedeploy or have another version of it or of Python.
        """
        self._address = address
        self._jobs: dict[str, tuple[Job, Any]] = {}  # with their futures
        self._sets: dict[str, Any] = {}
        # Lost workers and connections are this module's to tell of.
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        self._client = _connected(address)
        try:
            _require_workers(self._client, address)
        except BaseException:
            self._client.close()
            raise

    def submit(self, job: Job) -> None:
        """Take on a job."""
        data = self._shipped(job) if isinstance(job, TrainJob) else None
        future = self._client.submit(
            do_there, job, data, wakedeploy.__version__, key=f"wakedeploy-{job.identity}"
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
                job, future = self._jobs.pop(key)
                yield job, self._outcome(future, job)
            if not ended:
                if self._client.status != "running":
                    raise self._lost()
                time.sleep(_POLL_S)

    def cancel(self) -> None:
        """Take back what waits and leave the cluster to itself."""
        with contextlib.suppress(Exception):  # the scheduler may be what is gone
            waiting = [future for _, future in self._jobs.values()]
            self._client.cancel([*waiting, *self._sets.values()])
        with contextlib.suppress(Exception):
            self._client.close(timeout=CONNECT_S)

    def _shipped(self, job: TrainJob) -> Any:
        """The job's set as a task of the cluster, the same for all jobs on it."""
        sha256 = job.config.data_sha256
        if sha256 not in self._sets:
            with warnings.catch_warnings():  # of a graph that is large: that is the point
                warnings.simplefilter("ignore", UserWarning)
                self._sets[sha256] = self._client.submit(
                    _itself, read_episode_set(job.folder), key=f"wakedeploy-set-{sha256}"
                )
        return self._sets[sha256]

    def _lost(self) -> CheckFailed:
        return CheckFailed(
            f"The connection to the scheduler at {self._address} is lost; rows that were written"
            " stay, and the same command goes on when it is back."
        )

    def _outcome(self, future: Any, job: Job) -> Outcome:
        try:
            outcome: Outcome = future.result()
        except KilledWorker as error:
            return failure(job, f"{error.allowed_failures + 1} workers were lost while at it")
        except (distributed.CancelledError, OSError) as error:
            raise self._lost() from error
        except Exception as error:
            return failure(job, f"unexpected {type(error).__name__}: {one_line(error)}")
        return outcome


def do_there(job: Job, data: EpisodeSet | None, version: str) -> Outcome:
    """Carry out a job on a worker, if it is of this version: it may have joined since we looked."""
    if wakedeploy.__version__ != version:
        told = f"the worker on {platform.node()} has wakedeploy {wakedeploy.__version__}"
        return failure(job, f"{told}, and the sweep is of {version}")
    return do(job, data)


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
    """UnusableInput unless there are workers, and all of them can do what this machine asks for."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError as error:
        raise UnusableInput(
            f"The scheduler at {address} has no worker; start some with `dask worker {address}"
            " --nthreads 1`."
        ) from error
    told = client.get_versions()["workers"]
    pythons = {name: str(worker["host"]["python"]) for name, worker in told.items()}
    problem = misfit(pythons, None) or misfit(pythons, client.run(_looker()))
    if problem:
        raise UnusableInput(problem)


def misfit(
    pythons: Mapping[str, str], libraries: Mapping[str, Mapping[str, Library]] | None
) -> str | None:
    """What keeps the workers from doing this machine's jobs, in one sentence; None if nothing does.

    `pythons` has each worker's version, `libraries` its versions of wakedeploy and torch, None
    where one is missing.
    """
    own = ".".join(platform.python_version_tuple()[:2])
    for name, version in pythons.items():
        theirs = ".".join(version.split(".")[:2])
        if theirs != own:  # neither functions nor results would be understood
            return f"The worker {name} runs Python {theirs}, and this is {own}; use one for both."
    for name, found in (libraries or {}).items():
        for library in _NEEDED:
            if found[library] is None:
                return (
                    f"The worker {name} has no {library}; install there:"
                    " pip install 'wakedeploy[train,cluster]'."
                )
        if found["wakedeploy"] != wakedeploy.__version__:
            return (
                f"The worker {name} has wakedeploy {found['wakedeploy']}, and this is"
                f" {wakedeploy.__version__}; install the same there."
            )
    return None


def _looker() -> Callable[[], dict[str, Library]]:
    def look() -> dict[str, Library]:  # a closure travels as code: wakedeploy may be missing there
        import importlib.util

        try:
            import wakedeploy as there
        except ImportError:
            return {"wakedeploy": None, "torch": None}
        torch = importlib.util.find_spec("torch")
        return {"wakedeploy": there.__version__, "torch": None if torch is None else "there"}

    return look
