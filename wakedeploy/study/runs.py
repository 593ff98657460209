"""What studies train: one run folder per configuration, trained once.

In: sets and what to train on them. Out: predictors; a stopped run goes on where it was.
"""

import hashlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wakedeploy.episodes import EpisodeSet

if TYPE_CHECKING:
    from trainers.model import Predictor


@dataclass(frozen=True)
class Wanted:
    """One run on a set: `epochs` None trains as usual, `present_only` names hidden channels."""

    arch: str
    seed: int
    epochs: int | None = None
    lead_s: float = 0.0
    hyper: Mapping[str, Any] = field(default_factory=dict)
    present_only: tuple[str, ...] = ()

    def folder(self, data: EpisodeSet, runs: Path) -> Path:
        """Where such runs lie: sets, leads and hyper-parameters may share `runs`."""
        told = [data.sha256[:8], *(f"{name}={value:g}" for name, value in self.hyper.items())]
        if self.lead_s:
            told.append(f"lead={1e3 * self.lead_s:.1f}ms")
        if self.present_only:
            names = hashlib.sha256(",".join(self.present_only).encode()).hexdigest()
            told.append(f"present-only-{names[:6]}")
        return runs / "-".join(told)


def trained(
    data: EpisodeSet,
    arch: str,
    seed: int,
    runs: Path,
    *,
    epochs: int | None = None,
    lead_s: float = 0.0,
    hyper: Mapping[str, Any] | None = None,
    present_only: tuple[str, ...] = (),
) -> "Predictor":
    """The predictor of this configuration, trained now if it is not there."""
    return obtained(data, Wanted(arch, seed, epochs, lead_s, hyper or {}, present_only), runs)


def obtained(data: EpisodeSet, wanted: Wanted, runs: Path) -> "Predictor":
    """The predictor of a wanted run, trained now if it is not there."""
    from trainers.training import configure, settings_for, train

    config = configure(
        data,
        wanted.arch,
        seed=wanted.seed,
        lead_s=wanted.lead_s,
        hyper=wanted.hyper,
        settings=settings_for(wanted.arch, epochs=wanted.epochs),
        present_only=wanted.present_only,
    )
    return train(config, data, wanted.folder(data, runs)).predictor


def train_all(
    jobs: Sequence[tuple[EpisodeSet, Wanted]],
    runs: Path,
    *,
    workers: int | None = None,
    on_run: Callable[[], None] = lambda: None,
) -> None:
    """Train what is not trained yet, as many runs at once as there are cores (or `workers`)."""
    workers = min(workers or os.cpu_count() or 1, len(jobs))
    if workers <= 1:
        for data, wanted in jobs:
            obtained(data, wanted, runs)
            on_run()
        return
    # torch does not survive a fork once it has computed; workers end at once when interrupted.
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=fresh, initializer=_begin) as pool:
        waiting = [pool.submit(_run, data, wanted, runs) for data, wanted in jobs]
        try:
            for done in as_completed(waiting):
                done.result()
                on_run()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _begin() -> None:
    import torch

    signal.signal(signal.SIGINT, signal.SIG_DFL)
    torch.set_num_threads(1)


def _run(data: EpisodeSet, wanted: Wanted, runs: Path) -> None:
    obtained(data, wanted, runs)
