"""What the corrected rig is worth to a predictor: training on the old and on the new simulation.

In: a rig and the corrected one, measured logs. Out: two packages, their errors on the measured
flights, and how well each pair of rig and package flies a plant that still hides the effect.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from runtime.predictor import PackagePredictor
from runtime.replay import rolled_out
from wakedeploy.core.episodes import Episode
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.package import Package, read_package
from wakedeploy.core.parallel import parallel_map
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.core.runlog import RunLog, read_run_log
from wakedeploy.domains.gantry import make_set, record
from wakedeploy.domains.gantry_measured import measured_stretches
from wakedeploy.gap.progress import Progress, StepsDone, quiet, uncounted
from wakedeploy.gap.systems.gantry.findings import Interval, Retraining, Scores
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import parse_rig

FloatArray = npt.NDArray[np.float64]
Flown = Mapping[str, Sequence[Episode]]  # airborne stretches by flight

ARCH = "history-mlp"  # of the cores with a memory, the fastest to train
MINUTES = 8.0
EPOCHS = 25
LEVEL = 0.9
FLIGHT_S = 20.0


@dataclass(frozen=True)
class Pilot:
    """What flies: the rig that estimator and controller believe, and a package or PID alone."""

    rig: Rig
    package: Path | None = None


@dataclass(frozen=True)
class TrackingError:
    """Root mean square of the height error [mm] over flights, with its 90 % interval.

    `rmse` is None if a failsafe ended a flight; that flight's `per_flight` is None, too. One flight
    has no interval.
    """

    rmse: float | None
    low: float | None
    high: float | None
    per_flight: list[float | None]


@dataclass(frozen=True)
class EitherRig:
    """With the rig as it was, and with the corrected one."""

    before: TrackingError
    after: TrackingError


@dataclass(frozen=True)
class FlownAgain:
    """Flights of `seconds` on the same references and noise: by PID alone, and with predictors."""

    unit: str
    seconds: float
    seeds: list[int]
    pid: EitherRig
    feedforward: EitherRig


def retrain(
    old: Rig,
    new: Rig,
    measured: Sequence[RunLog | Path],
    out: Path,
    *,
    minutes: float = MINUTES,
    seed: int = 0,
    arch: str = ARCH,
    epochs: int = EPOCHS,
    workers: int = 2,
    progress: Progress = quiet,
) -> Retraining:
    """Train the same small predictor on both rigs' simulations; score both on measured flights.

    Give flights that took no part in finding what the corrected rig has, if there are any.

    Both see `minutes` of the same commands and seeds, and each predicts the force at its own rig's
    lead. They are packages `old.onnx` and `new.onnx` in `out`. The result is `show.json`'s
    `retrain`: root-mean-square errors [N] with 90 % intervals over flights (None for one flight),
    and the `ratio` of the new error to the old, flights paired.

    The force is measured from the logs with the *corrected* rig for both predictors, because the
    thrust's lag must be removed to see it. A wrong name would favour its own predictor there, so
    `by_old_label` has the same errors on the force as the *old* rig measures it. A predictor learns
    the drag of the wake alone: an effect that cuts thrust, or adds another force, is in the
    measured force but in neither simulation's label, and raises both errors.

    Raises UnusableInput without logs, without a flight long enough, or for an unknown `arch`.
    """
    from trainers.build import hyper_parameters

    hyper_parameters(arch, {})  # refuses an unknown architecture before anything is simulated
    if not measured:
        raise UnusableInput("Retraining is judged on measured flights; give at least one log.")
    progress("measuring the force in the flights")
    logs = {f"flight{i}": _opened(log) for i, log in enumerate(measured)}
    truth, by_old = measured_stretches(logs, new), measured_stretches(logs, old)
    if not any(truth.values()):
        raise UnusableInput("In none of the measured flights the sufferer is in the air.")
    rigs = {"old": old, "new": new}
    jobs = [_Job(r.text, minutes, seed, arch, epochs, out, name) for name, r in rigs.items()]
    stage = f"training {arch} on {minutes:g} min of either simulation"
    progress(stage)
    packages = _in_processes(jobs, workers, functools.partial(progress, stage))
    predictors = {name: read_package(path) for name, path in packages.items()}
    return Retraining(
        **dict(_scores(predictors, truth)),
        by_old_label=_scores(predictors, by_old),
        scored_on=[
            str(log) if isinstance(log, Path) else n for n, log in zip(logs, measured, strict=True)
        ],
        label_sd=_rms(truth, "sd"),
        measured_rms=_rms(truth, "force"),
        arch=arch,
        minutes=minutes,
        lead_s={name: default_lead_s(rig) for name, rig in rigs.items()},
        packages={name: str(path) for name, path in packages.items()},
    )


def fly_both(
    world: Rig,
    before: Pilot,
    after: Pilot,
    seeds: Sequence[int],
    *,
    seconds: float = FLIGHT_S,
    workers: int = 2,
    steps: StepsDone = uncounted,
) -> FlownAgain:
    """Height error of either pilot on the plant `world`, which still hides the effect.

    Both fly the same references and noise, with their packages and by PID alone.
    """
    pilots = [Pilot(before.rig), Pilot(after.rig), before, after]
    jobs = [(world, pilot, seed, seconds) for pilot in pilots for seed in seeds]
    errors = parallel_map(_tracking_mm, jobs, workers=workers, steps=steps)
    rows = [_tracking(errors[i * len(seeds) : (i + 1) * len(seeds)]) for i in range(len(pilots))]
    return FlownAgain("mm", seconds, list(seeds), EitherRig(*rows[:2]), EitherRig(*rows[2:]))


@dataclass(frozen=True)
class _Job:
    """One training, with all that its process needs."""

    rig_text: str
    minutes: float
    seed: int
    arch: str
    epochs: int
    out: Path
    name: str


def _in_processes(jobs: Sequence[_Job], workers: int, steps: StepsDone) -> dict[str, Path]:
    """Train side by side, each in a fresh process with one thread: models this small need no more.

    The number of threads is read when torch is imported; a forked process may have done that
    before.
    """
    packages = parallel_map(_trained, jobs, workers=max(workers, 1), fresh=True, steps=steps)
    return {job.name: package for job, package in zip(jobs, packages, strict=True)}


def _trained(job: _Job) -> Path:
    """Simulate, train, export; return the package's path."""
    from export.packaging import export_run
    from trainers.training.trainer import configure, settings_for, train

    rig = parse_rig(job.rig_text)
    data = make_set(rig, minutes=job.minutes, seed=job.seed, workers=1)
    settings = settings_for(job.arch, epochs=job.epochs)
    config = configure(data, job.arch, seed=job.seed, lead_s=default_lead_s(rig), settings=settings)
    run = train(config, data, job.out / f"runs-{job.name}", fresh=True)
    path = job.out / f"{job.name}.onnx"
    export_run(run, data, path)
    return path


def _opened(log: RunLog | Path) -> RunLog:
    return log if isinstance(log, RunLog) else read_run_log(log)


def _scores(packages: Mapping[str, Package], flights: Flown) -> Scores:
    """Both packages' errors with intervals, and the ratio of the new one's to the old one's."""
    sums = {
        name: np.array([_squares(package, episodes) for episodes in flights.values()])
        for name, package in packages.items()
    }  # (k, 2) each
    scored = np.all([each[:, 1] > 0.0 for each in sums.values()], axis=0)  # (k,)
    if not scored.any():
        raise UnusableInput(
            "No measured flight is longer than the predictor's memory and lead; fly 8 s or more."
        )
    old, new = sums["old"][scored], sums["new"][scored]
    (old_rmse, of_old), (new_rmse, of_new) = rms_over_flights(old), rms_over_flights(new)
    ratio, of_ratio = rms_ratio(old, new)
    return Scores(
        old_rmse=old_rmse,
        old_rmse_interval=of_old,
        new_rmse=new_rmse,
        new_rmse_interval=of_new,
        ratio=ratio,
        ratio_interval=of_ratio,
        flights=int(scored.sum()),
    )


def rms_over_flights(sums: FloatArray) -> tuple[float, Interval]:
    """Root mean square from each flight's sum of squares and count (k, 2), and its 90 % interval.

    Flights are the clusters of a ratio estimate; its logarithm is taken as t distributed with
    k − 1 degrees of freedom. One flight has no interval.
    """
    value, influence = _log_rms(sums)
    return math.exp(value), _interval(value, influence)


def rms_ratio(old: FloatArray, new: FloatArray) -> tuple[float, Interval]:
    """Root mean square of `new` over that of `old`, (k, 2) each, flights paired, and its interval.

    What makes a flight hard for both, such as a rough wake, does not widen the interval.
    """
    (first, of_first), (second, of_second) = _log_rms(old), _log_rms(new)
    return math.exp(second - first), _interval(second - first, of_second - of_first)


def _log_rms(sums: FloatArray) -> tuple[float, FloatArray]:
    """The logarithm of the root mean square, and how far each flight moves it (k,)."""
    squares, counts = sums.T
    mean = max(float(squares.sum() / counts.sum()), 1e-30)
    influence = (squares - mean * counts) / (2.0 * mean * counts.sum())
    return 0.5 * math.log(mean), np.asarray(influence)


def _interval(value: float, influence: FloatArray) -> Interval:
    k = len(influence)
    if k < 2:
        return None
    spread = math.sqrt(k / (k - 1) * float(np.square(influence).sum()))
    reach = float(student.ppf(0.5 + LEVEL / 2.0, k - 1)) * spread
    return math.exp(value - reach), math.exp(value + reach)


def _squares(package: Package, episodes: Sequence[Episode]) -> tuple[float, float]:
    """The sum of squared errors [N²] and the number of ticks, once the memory is full."""
    from trainers.training.targets import shift_ahead

    predictor, total, count = PackagePredictor(package), 0.0, 0
    for episode in episodes:
        target = shift_ahead(episode.force, predictor.lead_s, LOOP_RATE_HZ)
        warm = max(predictor.warm_up_steps - 1, 0)
        if len(target) <= warm:
            continue
        forecast = rolled_out(predictor, episode.observation[: len(target)])
        error = (forecast - target)[warm:].astype(np.float64)
        total, count = total + float(np.square(error).sum()), count + len(error)
    return total, float(count)


def _rms(flights: Flown, of: str) -> float:
    """Root mean square [N] of the measured force or of its standard deviation."""
    episodes = [episode for stretches in flights.values() for episode in stretches]
    parts = [e.force if of == "force" else e.extras["force_sd_n"] for e in episodes]
    return float(np.sqrt(np.mean(np.square(np.concatenate(parts)))))


def _tracking_mm(job: tuple[Rig, Pilot, int, float]) -> float | None:
    """One flight's error [mm]; None if a failsafe ended it."""
    world, pilot, seed, seconds = job
    log = record(world, seconds=seconds, seed=seed, package=pilot.package, model_rig=pilot.rig)
    if (log["mode"] == "FAILSAFE").any():
        return None
    return 1e3 * log.tracking_rmse_m("true_z_m")


def _tracking(errors: Sequence[float | None]) -> TrackingError:
    known = [error for error in errors if error is not None]
    if not known or len(known) < len(errors):
        return TrackingError(None, None, None, list(errors))
    rmse = float(np.mean(known))
    if len(known) == 1:
        return TrackingError(rmse, None, None, list(errors))
    quantile = float(student.ppf(0.5 + LEVEL / 2.0, len(known) - 1))
    half = quantile * float(np.std(known, ddof=1)) / math.sqrt(len(known))
    return TrackingError(rmse, rmse - half, rmse + half, list(errors))
