"""What a plan amounts to: jobs, each with an identity, and how one is carried out.

In: choices and a set. Out: jobs, and what became of each, as one row of results.
"""

import contextlib
import datetime
import functools
import hashlib
import json
import platform
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import wakedeploy
from trainers.preset import REFERENCE, chosen_preset
from trainers.trained_run import TrainedRun
from trainers.training.device import one_thread
from trainers.training.runs import BEST, CONFIG, METRICS, RunConfig, require_buildable, run_folder
from trainers.training.trainer import (
    chosen_lead_s,
    configure,
    idle_settings,
    require_enough,
    settings_for,
    train,
)
from wakedeploy.core.commit import present_commit
from wakedeploy.core.episodes import EpisodeSet, read_episode_set
from wakedeploy.core.errors import CheckFailed, UnusableInput, WakedeployError, is_full, one_line
from wakedeploy.core.files import write_bytes_whole
from wakedeploy.core.locks import scratch_folder
from wakedeploy.sweep.generate import Generate, make
from wakedeploy.sweep.plan import Choice

Row = dict[str, Any]

RUNS, SETS = "runs", "sets"  # folders inside the sweep's

_KEPT = (CONFIG, METRICS, BEST)  # of a run that was trained elsewhere
# A fit seeds torch's one generator of the process, so two fits must not run in one at a time.
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class GenerateJob:
    """A set to simulate."""

    identity: str
    asked: Generate

    @property
    def request(self) -> Row:
        """What the job's row says of what was asked for."""
        asked = self.asked
        return {
            "identity": self.identity,
            "kind": "generate",
            "data": asked.name,
            "domain": asked.domain,
            "minutes": asked.minutes,
            "seed": asked.seed,
            "settings": dict(asked.settings),
        }


@dataclass(frozen=True)
class TrainJob:
    """A run to train on the set in `folder`; `fresh` forgets what a failed attempt left."""

    identity: str
    data: str
    folder: Path
    config: RunConfig
    device: str
    presets: tuple[str, ...] = (REFERENCE,)  # several where one changes nothing of another
    fresh: bool = False

    @property
    def label(self) -> str:
        """The folder among the sweep's runs that is this job's."""
        return self.identity[:16]

    @property
    def request(self) -> Row:
        """What the job's row says of what was asked for."""
        config = self.config
        return {
            "identity": self.identity,
            "kind": "train",
            "data": self.data,
            "domain": config.domain,
            "data_sha256": config.data_sha256,
            "arch": config.arch,
            "seed": config.seed,
            "lead_s": config.lead_s,
            "preset": ", ".join(self.presets),
            "settings": dict(config.settings),
            "hyper": dict(config.hyper),
        }


@dataclass(frozen=True)
class UnfitJob:
    """A training that its set does not allow, and why; there is nothing to carry out."""

    identity: str
    request: Row
    reason: str


Job = GenerateJob | TrainJob


@dataclass(frozen=True)
class Outcome:
    """What became of a job: its row, and the set it made or the files of its run (name: bytes)."""

    row: Row
    made: EpisodeSet | None = None
    files: Mapping[str, bytes] = field(default_factory=dict)


def identity_of(kind: str, facts: Mapping[str, Any]) -> str:
    """The name of a job: a hash of all that determines its result, this version included.

    The order of the facts does not matter. The device is not among them: it rounds differently, and
    the row says which it was.
    """
    content = {"wakedeploy": wakedeploy.__version__, "kind": kind, "facts": facts}
    text = json.dumps(content, sort_keys=True, allow_nan=False, default=dict)
    return hashlib.sha256(text.encode()).hexdigest()


def generate_job(asked: Generate) -> GenerateJob:
    """The job that simulates a set; the set's name is part of it, since that is where it goes.

    Of a rig file the text is, and not where it lies.
    """
    settings = {name: value for name, value in asked.settings.items() if name != "rig"}
    facts = {"name": asked.name, "domain": asked.domain, "minutes": asked.minutes}
    facts |= {"seed": asked.seed, "settings": settings, "rig": asked.rig}
    return GenerateJob(identity_of("generate", facts), asked)


def train_jobs(
    name: str,
    folder: Path,
    data: EpisodeSet,
    choices: Sequence[Choice],
    *,
    device: str,
) -> list[TrainJob | UnfitJob]:
    """The jobs of all choices on one set, each once.

    Unfit are those for which the set is too small to train, validate and test on, and those whose
    hyper-parameters make too large a model of it.
    """
    enough: set[tuple[float, int]] = set()  # by lead and warm-up
    buildable: set[str] = set()  # what differs by its seed alone is looked at once
    jobs: dict[str, TrainJob | UnfitJob] = {}
    for choice in choices:
        try:
            config = _configured(data, choice)
            if (config.lead_s, config.warm_up_steps) not in enough:
                require_enough(data, config.lead_s, config.warm_up_steps)
                enough.add((config.lead_s, config.warm_up_steps))
            shape = config.model_copy(update={"seed": 0}).model_dump_json()
            if shape not in buildable:
                require_buildable(config)
                buildable.add(shape)
        except UnusableInput as error:
            unfit = _unfit(name, data, choice, f"{name}: {error}")
            jobs.setdefault(unfit.identity, unfit)
            continue
        identity = identity_of("train", config.model_dump(mode="json"))
        same = jobs.get(identity)
        before = same.presets if isinstance(same, TrainJob) else ()
        presets = tuple(dict.fromkeys((*before, choice.preset)))
        jobs[identity] = TrainJob(identity, name, folder.absolute(), config, device, presets)
    return list(jobs.values())


def do(job: Job, data: EpisodeSet | None = None, runs: Path | None = None) -> Outcome:
    """Carry out a job; whatever goes wrong with it becomes a row with the reason.

    `data` is the set where it came with the job; otherwise it is read from the job's folder. `runs`
    is where a training run is kept and goes on; without it the run's files come with the outcome.
    A full disk says nothing about the job: where that is the sweep's own, OSError is raised.
    """
    began = time.monotonic()
    try:
        with _ONE_AT_A_TIME, one_thread():
            if isinstance(job, TrainJob):
                return _trained(job, data, runs)
            made = make(job.asked)
    except WakedeployError as error:
        reason, _, _ = one_line(error).partition(";")  # the advice is for other commands
        return failure(job, reason.rstrip("."), time.monotonic() - began)
    except Exception as error:
        if runs is not None and is_full(error):
            raise
        reason = f"unexpected {type(error).__name__}: {one_line(error)}"
        return failure(job, reason, time.monotonic() - began)
    facts = {"data_sha256": made.sha256, "device": "cpu"}
    return Outcome(_row(job, facts, time.monotonic() - began), made=made)


def failure(job: Job | UnfitJob, reason: str, seconds: float | None = None) -> Outcome:
    """The outcome of a job that could not be done."""
    return Outcome(_row(job, {"state": "failed", "reason": reason}, seconds))


def keep_run(job: TrainJob, files: Mapping[str, bytes], runs: Path) -> None:
    """Write the files of a run that was trained elsewhere; the one that closes it comes last."""
    folder = run_folder(runs / job.label, job.config)
    for name in sorted(files, key=lambda name: name == METRICS):
        write_bytes_whole(folder / name, files[name])


def _configured(data: EpisodeSet, choice: Choice) -> RunConfig:
    preset = chosen_preset(choice.preset, choice.arch, data.domain)
    hyper, settings = ({}, {}) if preset is None else (preset.hyper, preset.settings)
    fitted = settings_for(choice.arch, others={**settings, **choice.settings})
    usual = settings_for(choice.arch)
    # What an architecture does not use makes no other run of it.
    idle = {name: getattr(usual, name) for name in idle_settings(choice.arch)}
    return configure(
        data,
        choice.arch,
        seed=choice.seed,
        lead_s=chosen_lead_s(data, choice.lead_s),
        hyper={**hyper, **choice.hyper},
        settings=replace(fitted, **idle),
    )


def _unfit(name: str, data: EpisodeSet, choice: Choice, reason: str) -> UnfitJob:
    """Known by what was asked for: there may be no configuration to know it by."""
    asked = {
        "arch": choice.arch,
        "seed": choice.seed,
        "lead_s": choice.lead_s,
        "preset": choice.preset,
        "settings": dict(choice.settings),
        "hyper": dict(choice.hyper),
    }
    identity = identity_of("train", {"data_sha256": data.sha256, "asked": asked})
    facts = {"identity": identity, "kind": "train", "data": name, "domain": data.domain}
    return UnfitJob(identity, facts | {"data_sha256": data.sha256} | asked, reason)


def _trained(job: TrainJob, data: EpisodeSet | None, runs: Path | None) -> Outcome:
    # What came with the job may bring along a hash that was computed elsewhere; a copy does not.
    there = _read(job.folder, job.config.data_sha256) if data is None else replace(data)
    if there.sha256 != job.config.data_sha256:
        raise UnusableInput(
            f"{job.data} is not the set that this sweep began with: its sha256 is"
            f" {there.sha256[:12]}, not {job.config.data_sha256[:12]}"
        )
    with _root(job, runs) as root:
        try:
            run = train(job.config, there, root, device=job.device, fresh=job.fresh)
        except CheckFailed as error:
            reason = str(error).removeprefix(f"{run_folder(root, job.config)}: ")
            raise CheckFailed(reason) from error
        files = {} if runs else {name: (run.folder / name).read_bytes() for name in _KEPT}
        return Outcome(_row(job, _scores(job, run), run.metrics.seconds), files=files)


@contextlib.contextmanager
def _root(job: TrainJob, runs: Path | None) -> Iterator[Path]:
    """Where a run is trained: its place among `runs`, or a folder that is gone afterwards.

    A cluster's worker that is killed leaves that folder, and the next job there removes it.
    """
    if runs is not None:
        yield runs / job.label
        return
    with scratch_folder("wakedeploy-sweep-job-") as folder:
        yield folder


@functools.lru_cache(maxsize=2)
def _read(folder: Path, sha256: str) -> EpisodeSet:  # the hash, so that another set is read anew
    return read_episode_set(folder)


def _scores(job: TrainJob, run: TrainedRun) -> Row:
    """What `wakedeploy train` reports of a run."""
    metrics = run.metrics
    return {
        "trainable": metrics.trainable,
        "frozen": metrics.frozen,
        "epochs": metrics.epochs,
        "best_epoch": metrics.best_epoch,
        "validation": metrics.validation.model_dump(),
        "test": metrics.test.model_dump(),
        "test_r2_ceiling": metrics.test_r2_ceiling,
        "device": metrics.device,
        "run": str(run_folder(Path(RUNS) / job.label, run.config)),
    }


def _row(job: Job | UnfitJob, facts: Row, seconds: float | None) -> Row:
    """What was asked for, what came of it, and where, when and by which code."""
    row = job.request | {"state": "done", "reason": None} | facts
    return row | {
        "seconds": None if seconds is None else round(seconds, 3),
        "host": platform.node(),
        "commit": present_commit(),
        "wakedeploy": wakedeploy.__version__,
        "python": platform.python_version(),
        "finished_utc": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
