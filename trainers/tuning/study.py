"""One study: made or found again, its trials counted, and those of dead workers given back.

A trial that was interrupted, or whose worker died, is failed, and its point is put back into the
queue.
"""

import contextlib
import os
import platform
import warnings
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import optuna
from optuna.storages import BaseStorage
from optuna.trial import FrozenTrial, TrialState

from trainers.build import ARCHITECTURES
from trainers.tuning.plan import COSTS, Plan
from trainers.tuning.sampler import AGAIN, SeededByTrial
from trainers.tuning.sound import fixed_params, problem_of
from trainers.tuning.space import Point, in_effect, trained_point
from trainers.tuning.storage import Place
from wakedeploy.core.errors import UnusableInput

# What a trial says of itself.
REASON, PARAMETERS, EPOCHS, WORKER = "reason", "parameters", "epochs", "worker"
DEVICE, PRUNER = "device", "pruner"
POINT = "point"  # with the values in effect, where they are not those that were drawn
INTERRUPTED, LOST_BEFORE, REFERENCE = "interrupted", "lost before", "reference"
Study = optuna.Study
_IDENTITY = "wakedeploy"
_UNSIGNED_S = 60.0  # a trial that has not said who runs it by then never will
BUDGET, SHAPE = "budget", "shape"  # the limits that keep a trial from being trained


def open_study(place: Place, plan: Plan, name: str | None, pruner: str) -> optuna.Study:
    """The study of this plan in that place, made if it is not there; one process at a time.

    Raises UnusableInput for a study of another plan, with nothing changed, and as `Place.open`.
    """
    storage = place.open(give_back)
    with place.reachable():
        asked = name or default_name(plan)
        there = [study.study_name for study in storage.get_all_studies()]
        if asked not in there and there and place.is_journal:
            _require_same(place, _load(storage, there[0]), plan)
            _refuse(place, there[0], f"is named so, not {asked}")
        study = _load(storage, asked) if asked in there else _made(storage, asked, plan)
        _require_same(place, study, plan)
        _require_sound(place, study, plan)
        study.sampler = SeededByTrial(plan.seed, study)
        study.pruner = _pruner(pruner, plan)
    return study


def default_name(plan: Plan) -> str:
    """What a study is called where nobody says it."""
    return f"{plan.domain}-{plan.arch}"


def is_new(study: optuna.Study, point: Point) -> bool:
    """Whether the study neither tried a point nor has it in the queue, as it would be trained."""
    arch, rate_hz = arch_of(study), study.user_attrs[_IDENTITY]["rate_hz"]
    asked = in_effect(arch, point, rate_hz)
    tried = ({**fixed_params(trial), **trained_point(arch, trial)} for trial in all_trials(study))
    return all(in_effect(arch, known, rate_hz) != asked for known in tried)


def alike(study: optuna.Study, trial: FrozenTrial | optuna.Trial) -> FrozenTrial | None:
    """The first trial that came to its end with the very same point; None without one."""
    point = trial.user_attrs[POINT]
    ended = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    return next((other for other in ended if other.user_attrs.get(POINT) == point), None)


def waiting(study: optuna.Study) -> int:
    """How many points are in the queue."""
    return sum(trial.state == TrialState.WAITING for trial in all_trials(study))


def arch_of(study: optuna.Study) -> str:
    """Whose hyper-parameters it searches."""
    arch: str = study.user_attrs[_IDENTITY]["arch"]
    return arch


def give_back(study: optuna.Study, trial: FrozenTrial) -> None:
    """Put the point of a trial whose worker died back into the queue, unless a worker did before.

    A point that needs more memory than there is would end one worker after the other.
    """
    if LOST_BEFORE not in trial.user_attrs:
        _enqueue_again(study, trial, {LOST_BEFORE: True})


def begin_again(study: optuna.Study, number: int) -> None:
    """Put an interrupted trial's point back into the queue."""
    _enqueue_again(study, all_trials(study)[number], {})


def taken_from_us(study: optuna.Study) -> bool:
    """Whether a trial that this process ran was given up by others, who took us for dead.

    A computer that slept lets no heart beat.
    """
    mine = [t for t in all_trials(study) if t.user_attrs.get(WORKER) == this_worker()]
    last = max(mine, key=lambda trial: trial.number, default=None)
    return last is not None and last.state == TrialState.FAIL and REASON not in last.user_attrs


def give_back_of_the_dead(study: optuna.Study, elsewhere: bool = False) -> int:
    """Fail the running trials whose process on this machine is gone; how many there were.

    With `elsewhere` those of all other machines count as gone, too. One that is not goes on with
    another trial when it is done.
    """
    lost = 0
    for trial in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
        if not (_is_dead(trial) or (elsewhere and is_elsewhere(trial))):
            continue
        # Of two that notice it at once, one gets the error.
        with contextlib.suppress(ValueError, optuna.exceptions.UpdateFinishedTrialError):
            study.tell(trial.number, state=TrialState.FAIL)
            give_back(study, trial)
            lost += 1
    return lost


def is_elsewhere(trial: FrozenTrial) -> bool:
    """Whether a trial is run by another machine: nothing here can tell if its process lives."""
    worker = trial.user_attrs.get(WORKER)
    machine = (platform.node(), _machine())
    return worker is not None and (worker["host"], worker["machine"]) != machine


def this_worker() -> dict[str, Any]:
    """Who runs a trial: machine, process, and when that began, since numbers are given again."""
    machine = {"host": platform.node(), "machine": _machine()}
    return {**machine, "pid": os.getpid(), "born": _born(os.getpid())}


def finished(trials: Sequence[FrozenTrial]) -> list[FrozenTrial]:
    """The trials that count: those that ended, but for those that were begun again."""
    repeated = {trial.user_attrs.get(AGAIN) for trial in trials}
    return [t for t in trials if t.state.is_finished() and t.number not in repeated]


def running(trials: Sequence[FrozenTrial]) -> list[FrozenTrial]:
    """The trials that are being trained, here or elsewhere."""
    return [trial for trial in trials if trial.state == TrialState.RUNNING]


def all_trials(study: optuna.Study) -> list[FrozenTrial]:
    """Every trial of the study as it stands now, in order."""
    return study.get_trials(deepcopy=False)


def _enqueue_again(study: optuna.Study, trial: FrozenTrial, marks: dict[str, Any]) -> None:
    kept = {name: True for name in (LOST_BEFORE, REFERENCE) if name in trial.user_attrs}
    study.enqueue_trial(_point(trial), user_attrs={AGAIN: trial.number, **kept, **marks})


def _point(trial: FrozenTrial) -> dict[str, Any]:
    """A trial's point: what was drawn for it, and what was set before."""
    return {**fixed_params(trial), **trial.params}


def _made(storage: BaseStorage, name: str, plan: Plan) -> optuna.Study:
    study = optuna.create_study(
        storage=storage, study_name=name, directions=["minimize"] * len(plan.objective)
    )
    _mark(study, plan)
    return study


def _mark(study: optuna.Study, plan: Plan) -> None:
    """Say what it is a study of."""
    study.set_user_attr(_IDENTITY, plan.identity)
    metric_names = {"rmse": "validation error"} | COSTS
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        study.set_metric_names([metric_names[name] for name in plan.objective])


def _load(storage: BaseStorage, name: str) -> optuna.Study:
    return optuna.load_study(study_name=name, storage=storage)


def _require_same(place: Place, study: optuna.Study, plan: Plan) -> None:
    if _IDENTITY not in study.user_attrs:
        if all_trials(study) or len(study.directions) != len(plan.objective):
            _refuse(place, study.study_name, "was not made by `wakedeploy tune`")
        _mark(study, plan)  # who made it was killed before it could say so
    there = study.user_attrs[_IDENTITY]
    if not isinstance(there, dict):
        _refuse(place, study.study_name, "does not say what it is a study of")
    for name, value in plan.identity.items():
        if there.get(name) != value:
            _refuse(place, study.study_name, _difference(name, there.get(name), value))


def _require_sound(place: Place, study: optuna.Study, plan: Plan) -> None:
    searched = {dimension.name for dimension in plan.dimensions}
    for trial in all_trials(study):
        if problem := problem_of(trial, searched, len(plan.objective)):
            _refuse(place, study.study_name, problem)


def _difference(name: str, there: Any, asked: Any) -> str:
    if name == "data_sha256":
        return f"was made for another data set (sha256 {str(there)[:12]}…, not {asked[:12]}…)"
    if name == "dimensions":
        before, now = str(there).split(), str(asked).split()
        there, asked = (
            ", ".join(library for library in here if library not in other) or "without it"
            for here, other in ((before, now), (now, before))
        )
    return f"was made with {name} = {there}, not {asked}"


def _refuse(place: Place, name: str, why: str) -> None:
    another = "--out" if place.is_journal else "--study-name"
    raise UnusableInput(
        f"{place.name}: the study {name} {why}; repeat its options, or choose another {another}."
    )


def pruner_of(study: Study) -> str:
    """What ends trials of this process early."""
    names = {optuna.pruners.NopPruner: "none", optuna.pruners.HyperbandPruner: "hyperband"}
    return names.get(type(study.pruner), "median")


def _pruner(name: str, plan: Plan) -> optuna.pruners.BasePruner:
    """One that ends nothing where there are no epochs, or several objectives."""
    if name == "none" or plan.cost is not None or ARCHITECTURES[plan.arch].solved:
        return optuna.pruners.NopPruner()
    if name == "hyperband":
        return optuna.pruners.HyperbandPruner(min_resource=1, max_resource=plan.epochs)
    # The learning rate anneals: before a quarter of the epochs the errors say little.
    return optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=max(1, plan.epochs // 4))


def _is_dead(trial: FrozenTrial) -> bool:
    worker = trial.user_attrs.get(WORKER)
    if worker is None:
        began = trial.datetime_start
        return began is not None and datetime.now() - began > timedelta(seconds=_UNSIGNED_S)
    return not is_elsewhere(trial) and worker["born"] != _born(worker["pid"])


def _machine() -> str:
    """What tells machines of the same name apart, where the system has it."""
    try:
        return Path("/etc/machine-id").read_text().strip()[:8]
    except OSError:
        return ""


def _born(pid: int) -> str | None:
    """When a process began, in the kernel's ticks; None where there is no such process.

    If the kernel does not say, processes are known by their number alone.
    """
    if not Path("/proc/self/stat").exists():
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return None
        except PermissionError:
            pass
        return "unknown"
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    dead, ticks = fields[0] in "ZX", fields[19]
    boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    return None if dead else f"{boot[:8]}-{ticks}"
