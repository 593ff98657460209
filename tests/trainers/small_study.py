"""Studies small enough for tests: a few trials of a few epochs on the echo set."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import optuna

from trainers.model import Predictor
from trainers.training.runs import RunConfig
from trainers.tuning.plan import Plan, make_plan
from trainers.tuning.workers import Work, run_trials
from wakedeploy.core.episodes import EpisodeSet

# Narrowed so that a trial takes a tenth of a second.
TINY = {
    "agile-mlp": ("hidden=4:16", "layers=1:2", "batch=128:512"),
    "gru": ("hidden=3:9", "lanes=4:8", "chunk_steps=32:64"),
    "esn": ("neurons=20:60",),
}


def plan_of(data: EpisodeSet, arch: str = "agile-mlp", **changes: object) -> Plan:
    asked = {
        "lead_s": 0.0, "epochs": 3, "budget": 100_000, "objective": ("rmse",), "seed": 0,
        "asked": TINY.get(arch, ()),
    }  # fmt: skip
    return make_plan(data, arch, **{**asked, **changes})


def work_of(
    data: EpisodeSet, out: Path, arch: str = "agile-mlp", trials: int = 4, **changes: object
) -> Work:
    kept = {
        name: changes.pop(name)
        for name in ("address", "study_name", "step_cost", "device")
        if name in changes
    }
    pruner = str(changes.pop("pruner", "median"))
    settled = {"address": None, "study_name": None, "step_cost": None, **kept}
    folder = out.parent / f"set-{data.sha256[:8]}"
    if not folder.exists():
        data.write(folder)
    return Work(
        plan_of(data, arch, **changes), folder, out, trials=trials, pruner=pruner, **settled
    )


def tuned(
    data: EpisodeSet,
    out: Path,
    arch: str = "agile-mlp",
    trials: int = 4,
    on_trials: Callable[[optuna.Study], None] = lambda study: None,
    **changes: object,
) -> optuna.Study:
    """The study after its trials, run in this process."""
    work = work_of(data, out, arch, trials, **changes)
    study = work.begin()
    run_trials(work, study, data, on_trials=on_trials)
    return study


def cheap_when_small(predictor: Predictor, config: RunConfig, observations: np.ndarray) -> float:
    """A step's cost in µs that needs no export."""
    assert observations.shape[1] == 2
    return 10.0 + predictor.trainable / 100
