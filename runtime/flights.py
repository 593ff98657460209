"""Many flights of one request, in simulated time: what one flight's chance hides.

In: a `RunRequest` and a number of flights. Out: each flight's tracking error, PID alone beside the
package's feedforward on the same plans and the same chance. Flights differ by their seed.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from runtime.loop.tally import Tally
from runtime.request import RunRequest, wanted
from runtime.run import fly
from wakedeploy.core.errors import CheckFailed, UnusableInput, is_full, why
from wakedeploy.core.parallel import parallel_map

PID, FEEDFORWARD = "pid", "feedforward"
WHOLE = "whole"


@dataclass(frozen=True)
class Flight:
    """One flight: which controller, seed, how it ended, its RMS error of the true height [m]."""

    controller: str
    seed: int
    ended: str
    rmse_m: float

    @property
    def log_name(self) -> str:
        """The file of its recording, in the folder of them all."""
        return log_name(self.controller, self.seed)


def log_name(controller: str, seed: int) -> str:
    """The file of a flight's recording, in the folder of them all."""
    return f"{controller}-{seed:04d}.mcap"


@dataclass(frozen=True)
class Mean:
    """Mean over flights [m] and its standard error, NaN for a single flight."""

    value_m: float
    standard_error_m: float
    flights: int


def fly_many(
    request: RunRequest,
    flights: int,
    *,
    workers: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Flight]:
    """Fly seeds `request.seed` to `seed + flights - 1`, each with PID and, if given, the package.

    A flight that a failsafe ends is a result, not an error. With `request.log`, a folder, each is
    recorded there as CONTROLLER-SEED.mcap. Raises UnusableInput when none can begin.
    """
    wanted(request)  # what none of them can fly is said once, before processes are started
    jobs = _jobs(request, flights)
    return parallel_map(_flown, jobs, workers=workers, steps=progress)


def mean_of(flown: Sequence[Flight], controller: str) -> Mean:
    """The mean error of a controller's whole flights."""
    return _mean([f.rmse_m for f in flown if f.controller == controller and f.ended == WHOLE])


def gain_of(flown: Sequence[Flight]) -> Mean:
    """PID's error less that with feedforward, flight by flight, where both ended whole."""
    whole = {(f.controller, f.seed): f.rmse_m for f in flown if f.ended == WHOLE}
    seeds = [seed for controller, seed in whole if controller == FEEDFORWARD]
    gains = [whole[PID, seed] - whole[FEEDFORWARD, seed] for seed in seeds if (PID, seed) in whole]
    return _mean(gains)


def _mean(values_m: Sequence[float]) -> Mean:
    count = len(values_m)
    value_m = float(np.mean(values_m)) if count else math.nan
    error_m = float(np.std(values_m, ddof=1) / math.sqrt(count)) if count > 1 else math.nan
    return Mean(value_m, error_m, count)


def _jobs(request: RunRequest, flights: int) -> list[tuple[str, RunRequest]]:
    folder = _folder(request.log)
    controllers = {PID: None} | ({FEEDFORWARD: request.package} if request.package else {})
    return [
        (
            controller,
            replace(
                request,
                seed=seed,
                package=package,
                log=folder / log_name(controller, seed) if folder else None,
            ),
        )
        for seed in range(request.seed, request.seed + flights)
        for controller, package in controllers.items()
    ]


def _folder(log: Path | None) -> Path | None:
    if log is None:
        return None
    if log.suffix or log.is_file():
        raise UnusableInput(f"{log}: several flights need a folder for their logs.")
    log.mkdir(parents=True, exist_ok=True)
    return log


def _of_several(error: UnusableInput, log: Path | None) -> UnusableInput:
    """What keeps one of several flights from being recorded, told of the folder of them all.

    On a full disk that is a later one than the first that was cut, which is still in the air.
    """
    from runtime.io.recorder import Taken  # with MCAP and its compressors

    if log is None:
        return error
    if isinstance(error, Taken):
        return UnusableInput(f"{log}: there is already a recording; name another folder for --log.")
    if error.__cause__ is not None and is_full(error.__cause__):
        return UnusableInput(
            f"{log.parent}: the logs of these flights have no room ({why(error.__cause__)}); free "
            "some space there, then name another folder for --log, as this one keeps what it has."
        )
    return error


def _flown(job: tuple[str, RunRequest]) -> Flight:
    controller, request = job
    tallies: list[Tally] = []
    try:
        fly(request, tell=tallies.append)
    except UnusableInput as error:
        told = _of_several(error, request.log)
        if told is error:
            raise
        raise told from error
    except CheckFailed:
        if not tallies or not tallies[0].ended.startswith("failsafe"):
            raise  # not a flight's end: a recording that is not whole, a hook that fails
    (tally,) = tallies
    return Flight(controller, request.seed, tally.ended, tally.true_rmse_m)
