"""What can be scored on a set: a finished run, or what was exported from one.

In: runs, packages, folders of C, or where they lie. Out: contenders, which know what they read,
what they learned from, and their forces over a tape of episodes.
"""

import functools
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from runtime.flyable import Flyable, predictor_of, read_flyable
from wakedeploy.api.inputs import PathLike
from wakedeploy.api.predictors import Predictor
from wakedeploy.api.scores import About, about_run
from wakedeploy.core.caller import Warn
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import path_from
from wakedeploy.core.manifest import FloatArray, ObservationChannel, Quantity
from wakedeploy.core.misfit import misfit
from wakedeploy.gap.progress import Progress

if TYPE_CHECKING:
    from trainers.trained_run import TrainedRun
    from trainers.training.tape import Tape
    from wakedeploy.core.episodes import Episode, EpisodeSet

    Scored = TrainedRun | Predictor

Read = TypeVar("Read")
_EPISODES_AT_ONCE = 32  # bounds memory; they are stepped side by side


@dataclass(frozen=True)
class Contender:
    """One predictor to score, wherever it comes from.

    `forces` gives those (N, o) of every sample of a tape, in the channels' units. Errors count from
    sample `warm_up_steps` of an episode. `learned_from` has the first digits of the hashes of the
    episodes that it learned from, if that is on record; a package knows its set alone.
    """

    about: About
    observation: tuple[ObservationChannel, ...]
    force: tuple[Quantity, ...]
    rate_hz: float
    warm_up_steps: int
    forces: "Callable[[Tape], FloatArray]"
    learned_from: Collection[str] = ()

    def has_learned(self, data: "EpisodeSet", episode: "Episode") -> bool:
        """Whether it was trained on an episode of a set; by its split where no hash is known."""
        from trainers.training.runs import SHORT_HASH

        if not self.learned_from:
            is_its_set = self.about.data_sha256 == data.sha256
            return is_its_set and data.split[episode.name] == "train"
        return episode.sha256[:SHORT_HASH] in self.learned_from


def contenders(
    given: "Scored | Sequence[Scored] | PathLike",
    data: "EpisodeSet",
    place: object,
    progress: Progress,
    warn: Warn,
) -> list[Contender]:
    """What is to be scored on a set that lies in `place`, in the order of the paper's table.

    Of a folder, those that can be read and fit the set; `warn` hears of the others. UnusableInput
    where there is none, where none fits, and where one that was named does not fit.
    """
    if isinstance(given, str | os.PathLike):
        found = _at(path_from(given, "runs"), data, place, progress, warn)
    else:
        found = [_contender(each) for each in _several(given)]
        _require_fit(found, data, place)
    return sorted(found, key=_place_in_table)


def _several(given: "Scored | Sequence[Scored]") -> "list[Scored]":
    """UnusableInput for what is neither a run nor a package, nor some of them."""
    from trainers.trained_run import TrainedRun

    several = list(given) if isinstance(given, Sequence) else [given]
    kinds = TrainedRun | Predictor
    strange = next((each for each in several if not isinstance(each, kinds)), None)
    if isinstance(strange, str | os.PathLike):
        raise UnusableInput(
            f"{os.fspath(strange)!r:.60} is a path, and several are given as runs or packages: read"
            " a package by wd.load, or give one folder that holds all of them."
        )
    if strange is not None:
        raise UnusableInput(
            f"A value of type {type(strange).__name__} cannot be evaluated; give what train"
            " returned, a run of it, what load or export returned, a package, or a folder of runs."
        )
    if not several:
        raise UnusableInput("There is no run to evaluate; give what train returned, or a folder.")
    return several


def _at(
    root: Path, data: "EpisodeSet", place: object, progress: Progress, warn: Warn
) -> list[Contender]:
    """A package, a folder of C, the finished runs below a folder, or else its packages."""
    from trainers.trained_run import load_run
    from trainers.training.runs import finished_runs

    def package(path: Path) -> Contender:
        found = of_package(Predictor(read_flyable(path), path))
        _require_fit([found], data, place)
        return found

    packages = _packages_at(root)
    if packages:
        return _usable(packages, package, warn)
    folders = _that_fit(finished_runs(root), data, place, warn)

    def run(folder: Path) -> Contender:
        return of_run(load_run(folder))

    return _usable(folders, run, warn, functools.partial(progress, "Reading the runs"))


def _usable(
    paths: Sequence[Path],
    read: Callable[[Path], Read],
    warn: Warn,
    steps: Callable[[int, int], None] | None = None,
) -> list[Read]:
    """What `read` makes of each path; one that is refused is told, and is an error if all are.

    `steps(done, total)` is called after each path, also after one that is refused.
    """
    found, refused = [], []
    for number, path in enumerate(paths, 1):
        try:
            found.append(read(path))
        except UnusableInput as error:
            refused.append(error)
        if steps is not None:  # not in the try: what a person's function raises is no damaged run
            steps(number, len(paths))
    if not found:
        raise refused[0]
    for why in refused:
        warn(f"Left out: {why}")
    return found


def _packages_at(root: Path) -> list[Path]:
    """The package or folder of C at a path; of a folder without any run, the packages in it."""
    from trainers.training.runs import METRICS

    if root.is_file() or any(root.glob("*.c")):
        return [root]
    if not root.is_dir() or next(root.rglob(METRICS), None) is not None:
        return []
    return sorted(root.rglob("*.onnx"))


def _contender(scored: "Scored") -> Contender:
    return of_package(scored) if isinstance(scored, Predictor) else of_run(scored)


def of_run(run: "TrainedRun") -> Contender:
    """A finished run. The records of an earlier version may begin to score too early."""
    from trainers.training.predict import predict

    return Contender(
        about=about_run(run),
        observation=run.config.observation,
        force=run.config.force,
        rate_hz=run.config.rate_hz,
        warm_up_steps=max(run.config.warm_up_steps, run.predictor.memory.reach),
        forces=lambda tape: predict(run.predictor, tape).numpy(),
        learned_from=run.metrics.learned_from,
    )


def of_package(predictor: Predictor) -> Contender:
    """A package or a folder of C, as it would fly: by onnxruntime, or compiled here."""
    manifest = predictor.manifest
    return Contender(
        about=About(
            run=str(predictor.path),
            arch=manifest.arch,
            seed=manifest.seed,
            lead_s=manifest.lead_s,
            hyper=dict(manifest.hyper),
            settings={},
            kept_from=[],
            data_sha256=manifest.data_sha256,
            trainable=manifest.trainable,
            frozen=manifest.frozen,
            device=None,
        ),
        observation=manifest.observation,
        force=tuple(Quantity(name=c.name, unit=c.unit) for c in manifest.force),
        rate_hz=manifest.rate_hz,
        warm_up_steps=manifest.warm_up_steps - 1,  # there counted from 1
        forces=lambda tape: _stepped(predictor.package, tape),
    )


def _stepped(package: Flyable, tape: "Tape") -> FloatArray:
    """Forces (N, o) of a tape's samples, each episode from a cold start."""
    forces = np.empty(tuple(tape.force.shape), np.float32)
    observation = tape.observation.numpy()
    both = list(zip(tape.starts, tape.lengths, strict=True))
    for first in range(0, len(both), _EPISODES_AT_ONCE):
        some = both[first : first + _EPISODES_AT_ONCE]
        runner = predictor_of(package, batch=len(some))
        for k in range(max(length for _, length in some)):
            # An episode that has ended goes on with its last observation, unread.
            at = [start + min(k, length - 1) for start, length in some]
            newest = runner.step(observation[at])
            there = [row for row, (_, length) in enumerate(some) if k < length]
            forces[np.asarray(at)[there]] = newest[there]
    return forces


def _that_fit(folders: list[Path], data: "EpisodeSet", place: object, warn: Warn) -> list[Path]:
    """The runs whose channels and rate are the set's; warns of how many others there are."""
    from trainers.training.runs import read_config

    def of_run(folder: Path) -> tuple[Path, str | None]:
        config = read_config(folder)
        return folder, misfit(config.observation, config.force, config.rate_hz, data)

    misfits = dict(_usable(folders, of_run, warn))
    fitting = [folder for folder, why in misfits.items() if why is None]
    first, why = next(((f, w) for f, w in misfits.items() if w is not None), (None, None))
    if not fitting:
        raise _unfit(first, place, why)
    if first is not None:
        others = len(misfits) - len(fitting)
        warn(f"Left out {others} runs that do not fit the set; {first}: {why}.")
    return fitting


def _require_fit(found: Iterable[Contender], data: "EpisodeSet", place: object) -> None:
    for each in found:
        if why := misfit(each.observation, each.force, each.rate_hz, data):
            raise _unfit(each.about.run, place, why)


def _unfit(run: object, place: object, why: str | None) -> UnusableInput:
    where = f"this {place.domain} set" if hasattr(place, "domain") else str(place)
    return UnusableInput(f"{run} cannot be evaluated on {where}: {why}.")


def _place_in_table(each: Contender) -> tuple[int, int]:
    """Architectures in the order of Table I, then seeds; those not installed here come last."""
    from trainers.build import ARCHITECTURES

    order = list(ARCHITECTURES)
    arch = each.about.arch
    return order.index(arch) if arch in order else len(order), each.about.seed
