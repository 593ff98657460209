"""What a study found, as plain values: rows of trials, the best, the front, what mattered."""

import csv
import dataclasses
import io
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import optuna
from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances
from optuna.trial import FrozenTrial, TrialState

from trainers.build import ARCHITECTURES
from trainers.dimensions import Choice
from trainers.training.trainer import idle_settings
from trainers.tuning.plan import Plan
from trainers.tuning.sampler import AGAIN
from trainers.tuning.space import Point, split, trained_point
from trainers.tuning.study import (
    BUDGET,
    DEVICE,
    EPOCHS,
    INTERRUPTED,
    PARAMETERS,
    POINT,
    REASON,
    REFERENCE,
    all_trials,
    arch_of,
)
from wakedeploy.core.files import write_text_whole

FINISHED, BEHIND, OVER_BUDGET, IMPOSSIBLE = "finished", "pruned", "over budget", "impossible"
FAILED, LOST, RUNNING, WAITING = "failed", "lost", "running", "waiting"
_FIRST = b"number,state,reason,"
_FEWEST_FOR_IMPORTANCE = 15
_ENOUGH_AT_THE_TOP = 5  # trials that PED-ANOVA compares with the rest, as its authors advise


@dataclass(frozen=True)
class Row:
    """One trial. `error` is 1 for predicting the mean, `cost` what a step costs; None: unknown.

    `last_error` is the error after the last epoch of a trial that was ended early. `point` holds
    the dimensions that were searched, as trained. `front` says that no other trial beats it.
    `device` is where it was trained, "" if it was not.
    """

    number: int
    state: str
    reason: str
    error: float | None
    last_error: float | None
    cost: float | None
    parameters: int | None
    epochs: int
    seconds: float | None
    device: str
    started: str
    front: bool
    reference: bool
    point: Point


def rows_of(study: optuna.Study) -> list[Row]:
    """Every trial of the study, in order."""
    trials = all_trials(study)
    repeated = {trial.user_attrs.get(AGAIN) for trial in trials}
    front = {row.number for row in _front(trials)}
    arch = arch_of(study)
    return [_row(arch, trial, trial.number in repeated, trial.number in front) for trial in trials]


def best_of(rows: Sequence[Row]) -> Row | None:
    """The finished trial of the smallest error, the earliest of equals; None without any."""
    ended = [row for row in rows if row.state == FINISHED and row.error is not None]
    return min(ended, key=lambda row: (row.error, row.number), default=None)


def best_so_far(study: optuna.Study) -> tuple[int, float] | None:
    """Number and error of the trial of the smallest error; None without any."""
    pairs = [(trial.values[0], trial.number) for trial in _ended(all_trials(study))]
    return min(pairs)[::-1] if pairs else None


def front_of(rows: Sequence[Row]) -> list[Row]:
    """The trials that none beats in both error and cost, the most accurate first."""
    return sorted((row for row in rows if row.front), key=lambda row: row.error or 0.0)


def importances(study: optuna.Study) -> dict[str, float]:
    """How much each dimension decided whether a trial came among the best; they sum to 1.

    By PED-ANOVA (Watanabe et al. 2023), which needs no regression forest and asks for an order
    alone: what was ended early counts, behind all that came to their end. Empty for too few trials.
    """
    ranked = _ranked(all_trials(study))
    if len(ranked) < _FEWEST_FOR_IMPORTANCE:
        return {}
    share = min(0.5, max(0.1, _ENOUGH_AT_THE_TOP / len(ranked)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        copy = optuna.create_study(directions=study.directions)
        copy.add_trials(ranked)
        found = get_param_importances(
            copy, evaluator=PedAnovaImportanceEvaluator(target_quantile=share)
        )
    return dict(found)


def whole_point(plan: Plan, point: Point) -> tuple[dict[str, Any], dict[str, Any]]:
    """Every hyper-parameter and fit setting of a trial, those that were not searched included."""
    hyper, changed = split(plan.arch, {**fixed(plan), **point})
    usual = dataclasses.asdict(ARCHITECTURES[plan.arch].hyper())
    settings = dataclasses.asdict(plan.settings(changed))
    idle = idle_settings(plan.arch)
    return {**usual, **hyper}, {n: value for n, value in settings.items() if n not in idle}


def fixed(plan: Plan) -> Point:
    """The dimensions that are held at one value."""
    choices = [dimension for dimension in plan.dimensions if isinstance(dimension, Choice)]
    return {choice.name: choice.values[0] for choice in choices if len(choice.values) == 1}


def write_trials(path: Path, plan: Plan, rows: Sequence[Row]) -> None:
    """Every trial as a line of CSV, its point in the last columns."""
    names = [field.name for field in dataclasses.fields(Row) if field.name != "point"]
    searched = [dimension.name for dimension in plan.dimensions]
    known = fixed(plan)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*names, *searched])
    for row in rows:
        point = {**known, **row.point}
        cells = [getattr(row, name) for name in names] + [point.get(name) for name in searched]
        writer.writerow(["" if cell is None else cell for cell in cells])
    write_text_whole(path, text.getvalue())


def are_trials(path: Path) -> bool:
    """Whether a file is what `write_trials` writes."""
    with path.open("rb") as file:
        return file.read(len(_FIRST)) == _FIRST


def _row(arch: str, trial: FrozenTrial, repeated: bool, front: bool) -> Row:
    values = trial.values if trial.state == TrialState.COMPLETE else None
    seconds = trial.duration.total_seconds() if trial.duration is not None else None
    return Row(
        number=trial.number,
        state=_state(trial),
        reason=_reason(trial, repeated),
        error=None if values is None else values[0],
        last_error=None if values is not None else _last_error(trial),
        cost=None if values is None or len(values) < 2 else values[-1],
        parameters=trial.user_attrs.get(PARAMETERS),
        epochs=trial.user_attrs.get(EPOCHS, len(trial.intermediate_values)),
        seconds=None if seconds is None else round(seconds, 3),
        device=trial.user_attrs.get(DEVICE, ""),
        started=trial.datetime_start.isoformat(" ", "seconds") if trial.datetime_start else "",
        front=front,
        reference=REFERENCE in trial.user_attrs,
        point=trial.user_attrs.get(POINT) or trained_point(arch, trial),
    )


def _last_error(trial: FrozenTrial) -> float | None:
    values = trial.intermediate_values
    return values[max(values)] if values else None


def _state(trial: FrozenTrial) -> str:
    reason = trial.user_attrs.get(REASON)
    if trial.state == TrialState.FAIL:
        if reason == INTERRUPTED:
            return INTERRUPTED
        return LOST if reason is None else FAILED
    if trial.state == TrialState.PRUNED:
        if trial.intermediate_values:
            return BEHIND
        return OVER_BUDGET if BUDGET in trial.constraints else IMPOSSIBLE
    return {TrialState.COMPLETE: FINISHED, TrialState.RUNNING: RUNNING}.get(trial.state, WAITING)


def _reason(trial: FrozenTrial, repeated: bool) -> str:
    reason: str = trial.user_attrs.get(REASON, "")
    if trial.state == TrialState.FAIL and not reason:
        reason = "its process ended"
    return f"{reason}; begun again" if repeated else reason


def _front(trials: Sequence[FrozenTrial]) -> list[FrozenTrial]:
    """Finished trials that none beats; of one objective, the best alone. The first of equals."""
    front: list[FrozenTrial] = []
    for trial in sorted(_ended(trials), key=lambda trial: (trial.values, trial.number)):
        if not front or trial.values[-1] < front[-1].values[-1]:
            front.append(trial)
    return front


def _ranked(trials: Sequence[FrozenTrial]) -> list[FrozenTrial]:
    """All that were trained, in an order: what was ended early stands behind all others.

    Of two that were ended early the one that came farther is before, then the one with less error.
    """
    values = {trial.number: trial.values for trial in _ended(trials)}
    worst = max((pair[0] for pair in values.values()), default=0.0)
    early = [
        (-trial.last_step, trial.intermediate_values[trial.last_step], trial.number)
        for trial in trials
        if trial.state == TrialState.PRUNED and trial.last_step is not None
    ]
    for place, (*_, number) in enumerate(sorted(early), start=1):
        values[number] = [worst + place]
    return [
        optuna.trial.create_trial(
            params=trial.params, distributions=trial.distributions, values=values[trial.number]
        )
        for trial in trials
        if trial.number in values
    ]


def _ended(trials: Sequence[FrozenTrial]) -> list[FrozenTrial]:
    return [trial for trial in trials if trial.state == TrialState.COMPLETE]
