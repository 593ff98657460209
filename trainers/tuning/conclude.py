"""The end of a study: the best as a preset and as a trained run, every trial as CSV, figures.

Only here, and for the best trial alone, is the test split looked at.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import optuna
import torch

from trainers.inspection.pictures import write_pictures
from trainers.preset import Preset, stated, write_preset
from trainers.trained_run import TrainedRun
from trainers.training.runs import RunConfig, UnusableRun
from trainers.training.trainer import OnEpoch, train
from trainers.tuning.figure import write_figures
from trainers.tuning.plan import described
from trainers.tuning.report import (
    Row,
    best_of,
    front_of,
    importances,
    rows_of,
    whole_point,
    write_trials,
)
from trainers.tuning.study import PRUNER, all_trials, finished, running
from trainers.tuning.workers import BEST, TRIALS, Work
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.files import remove_unfinished
from wakedeploy.core.locks import one_at_a_time

# What a preset calls the cost of its trial.
_COSTS = {
    "latency": "step_p99_us",
    "flash": "flash_bytes",
    "ram": "ram_bytes",
    "instructions": "instructions",
}

FRONT, RUNS = "pareto", "best"


@dataclass(frozen=True, eq=False)
class Found:
    """What a study came to. `front` is the best alone where error is the only objective.

    `counts` are trials by state, of those that count; `run` is the best trial trained once more.
    """

    rows: list[Row]
    counts: dict[str, int]
    elsewhere: list[str]
    best: Row
    front: list[Row]
    importances: Mapping[str, float]
    run: TrainedRun


def conclude(
    work: Work,
    study: optuna.Study,
    data: EpisodeSet,
    on_epoch: OnEpoch = lambda done, total: None,
) -> Found:
    """Write what the study found into its folder, train the best once more and score it on test.

    Raises CheckFailed where no trial came to its end; `trials.csv` says why.
    """
    torch.set_num_threads(1)
    with one_at_a_time(work.out, "conclude"):  # another process may have come to the end, too
        remove_unfinished(work.out)
        return _concluded(work, study, data, on_epoch)


def _concluded(work: Work, study: optuna.Study, data: EpisodeSet, on_epoch: OnEpoch) -> Found:
    with work.place.reachable():
        rows, trials = rows_of(study), all_trials(study)
        shares = importances(study)
    counting = {trial.number for trial in finished(trials)}
    counts = dict(Counter(row.state for row in rows if row.number in counting))
    write_trials(work.out / TRIALS, work.plan, rows)
    best, front = best_of(rows), front_of(rows)
    if best is None:
        said = ", ".join(f"{count} {state}" for state, count in counts.items())
        raise CheckFailed(
            f"No trial came to its end ({said}); {work.out / TRIALS} says why: change the"
            " dimensions or the budget, and choose another --out."
        )
    write_preset(work.out / BEST, *_preset(work, study, best, counts))
    _write_front(work, study, front if work.plan.cost is not None else [], counts)
    title = f"{work.plan.arch} on {work.plan.domain}: {sum(counts.values())} trials"
    write_figures(work.out, title, rows, shares, work.plan.cost)
    config = work.plan.configured(data, _point(work, best))
    run = _trained(config, data, work.out, work.device, on_epoch)
    write_pictures(run, data)
    hosts = [trial.user_attrs.get("worker", {}).get("host", "?") for trial in running(trials)]
    return Found(rows, counts, hosts, best, front, shares, run)


def _point(work: Work, row: Row) -> dict[str, float]:
    hyper, settings = whole_point(work.plan, row.point)
    return {**hyper, **settings}


def _preset(
    work: Work, study: optuna.Study, row: Row, counts: Mapping[str, int]
) -> tuple[Preset, str]:
    """A trial as a preset, and the comment above it."""
    hyper, settings = whole_point(work.plan, row.point)
    counting = finished(all_trials(study))
    ended = [t.datetime_complete for t in counting if t.datetime_complete is not None]
    record: dict[str, Any] = {
        **described(work.plan, work.data),
        "pruner": ", ".join(dict.fromkeys(t.user_attrs.get(PRUNER, "unknown") for t in counting)),
        "name": study.study_name,
        "kept_in": work.place.portable_name,
        "date": max(ended).date().isoformat(),
        "trials": sum(counts.values()),
        "trials_by_state": dict(counts),
        "trial": row.number,
        "validation_error": row.error,
        **_reference_error(study),
        "trainable": row.parameters,
        "device": row.device,
    }
    if row.cost is not None:
        record[_COSTS[str(work.plan.cost)]] = round(row.cost, 1)
    heading = (
        "Found by `wakedeploy tune`; train with it: wakedeploy train --preset FILE --data SET\n"
        "# validation_error: root of the validation loss, 1 = predicting the mean."
    )
    preset = Preset(arch=work.plan.arch, hyper=stated(hyper), settings=settings, study=record)
    return preset, heading


def _reference_error(study: optuna.Study) -> dict[str, float]:
    """The validation error of the reference's trial, where it came to its end."""
    errors = [row.error for row in rows_of(study) if row.reference and row.error is not None]
    return {"reference_error": min(errors)} if errors else {}


def _write_front(
    work: Work, study: optuna.Study, front: list[Row], counts: Mapping[str, int]
) -> None:
    """One preset for each trial on the front; those of an earlier front are removed."""
    folder = work.out / FRONT
    names = {f"trial-{row.number:04d}.toml": row for row in front}
    for path in folder.glob("trial-*.toml"):
        if path.name not in names:
            path.unlink()
    for name, row in names.items():
        write_preset(folder / name, *_preset(work, study, row, counts))


def _trained(
    config: RunConfig, data: EpisodeSet, out: Path, device: str, on_epoch: OnEpoch
) -> TrainedRun:
    """The best trial's run, taken as it lies there or trained anew."""
    root = out / RUNS
    try:
        return train(config, data, root, on_epoch=on_epoch, device=device)
    except UnusableRun:  # damaged, or of a trial that was the best before
        return train(config, data, root, on_epoch=on_epoch, device=device, fresh=True)
