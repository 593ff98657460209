"""What studies train: one run folder per configuration, trained once.

In: sets and what to train on them. Out: predictors; a stopped run goes on where it was.
"""

import hashlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.parallel import parallel_map

if TYPE_CHECKING:
    from trainers.model import Predictor
    from trainers.trained_run import TrainedRun
    from trainers.training.runs import RunConfig


def choice(names: Collection[str]) -> str:
    """What was chosen for the models of a figure, with a space before it; "" where nothing was."""
    from trainers.build import ARCHITECTURES

    tried = {n: 1 + len(ARCHITECTURES[n].starts) for n in sorted(names) if n in ARCHITECTURES}
    chosen = ", ".join(f"{name} (one of {count})" for name, count in tried.items() if count > 1)
    if not chosen:
        return ""
    return (
        f" Only of {chosen} are hyper-parameters chosen for each set, on validation; all others are"
        " trained as they are."
    )


@dataclass(frozen=True)
class Wanted:
    """One run on a set: `epochs` None trains as usual, `present_only` names hidden channels."""

    arch: str
    seed: int
    epochs: int | None = None
    lead_s: float = 0.0
    hyper: Mapping[str, Any] = field(default_factory=dict)
    present_only: tuple[str, ...] = ()

    @property
    def hyper_text(self) -> str:
        """What differs from the architecture's usual hyper-parameters, empty where nothing does."""
        return " ".join(f"{name}={value:g}" for name, value in self.hyper.items())

    def folder(self, data: EpisodeSet, runs: Path) -> Path:
        """Where such runs lie: sets, leads and hyper-parameters may share `runs`."""
        words = [data.sha256[:8], *(f"{name}={value:g}" for name, value in self.hyper.items())]
        if self.lead_s:
            words.append(f"lead={1e3 * self.lead_s:.1f}ms")
        if self.present_only:
            names = hashlib.sha256(",".join(self.present_only).encode()).hexdigest()
            words.append(f"present-only-{names[:6]}")
        return runs / "-".join(words)


def candidates(wanted: Wanted) -> list[Wanted]:
    """What is trained for one line of any study; the best on validation is taken."""
    from trainers.build import ARCHITECTURES

    tried = ARCHITECTURES[wanted.arch].starts
    return [wanted, *(replace(wanted, hyper={**wanted.hyper, **hyper}) for hyper in tried)]


def best_run(data: EpisodeSet, wanted: Wanted, runs: Path) -> "tuple[TrainedRun, Wanted]":
    """The candidate for a wanted run that is best on validation; trains those that are missing."""
    tried = [(obtained_run(data, candidate, runs), candidate) for candidate in candidates(wanted)]
    return min(tried, key=lambda candidate: min(candidate[0].metrics.history))


def obtained(data: EpisodeSet, wanted: Wanted, runs: Path) -> "Predictor":
    """The predictor of a wanted run, trained now if it is not there."""
    return obtained_run(data, wanted, runs).predictor


def obtained_run(data: EpisodeSet, wanted: Wanted, runs: Path) -> "TrainedRun":
    """A wanted run, trained now if it is not there.

    Raises UnusableInput, with the folder to delete where that helps; CheckFailed where training
    diverged.
    """
    from trainers.training.runs import UnusableRun, run_folder
    from trainers.training.trainer import train

    config = _configured(data, wanted)
    root = wanted.folder(data, runs)
    try:
        return train(config, data, root)
    except UnusableRun as error:
        reason, _, _ = str(error).partition(";")
        raise UnusableInput(
            f"{reason}; delete {run_folder(root, config)} and start the study again."
        ) from error
    except CheckFailed as error:  # it would diverge again
        reason, _, _ = str(error).partition(";")
        raise CheckFailed(f"{reason}; leave {wanted.arch} out with --arch.") from error


def _configured(data: EpisodeSet, wanted: Wanted) -> "RunConfig":
    from trainers.training.trainer import configure, settings_for

    return configure(
        data,
        wanted.arch,
        seed=wanted.seed,
        lead_s=wanted.lead_s,
        hyper=wanted.hyper,
        settings=settings_for(wanted.arch, epochs=wanted.epochs),
        present_only=wanted.present_only,
    )


def untrained(
    jobs: Sequence[tuple[EpisodeSet, Wanted]], runs: Path
) -> list[tuple[EpisodeSet, Wanted]]:
    """The jobs that have no finished run yet, each once."""
    from trainers.training.runs import METRICS, run_folder

    waiting: dict[Path, tuple[EpisodeSet, Wanted]] = {}
    for data, wanted in jobs:
        folder = run_folder(wanted.folder(data, runs), _configured(data, wanted))
        if not (folder / METRICS).exists():
            waiting.setdefault(folder, (data, wanted))
    return list(waiting.values())


def train_all(
    jobs: Sequence[tuple[EpisodeSet, Wanted]],
    runs: Path,
    *,
    on_run: Callable[[int], None],
) -> None:
    """Train what is not trained yet, as many runs at once as there are cores.

    `on_run` is called with the `work` of each run that is done.
    """
    parallel_map(
        _run,
        [(*job, runs) for job in jobs],
        fresh=True,
        on_done=lambda job, done: on_run(work(job[0], job[1])),
    )


def work(data: EpisodeSet, wanted: Wanted) -> int:
    """How long a run takes beside others, roughly: samples times what each costs its architecture.

    Only the shares matter. Where training ends early, or windows are longer, they are off.
    """
    from trainers.build import ARCHITECTURES
    from trainers.training.fit import FitSettings

    samples = sum(len(e) for e in data.part("train"))
    usual = FitSettings().epochs
    known = ARCHITECTURES[wanted.arch]
    epochs = usual if wanted.epochs is None or known.solved else wanted.epochs
    return round(samples * known.training_s * epochs / usual)


def _run(job: tuple[EpisodeSet, Wanted, Path]) -> None:
    obtained(*job)
