"""Studies: what a trial may see, how one goes on, what it refuses, and what it leaves."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import optuna
import pytest
import torch
from optuna.trial import TrialState
from small_study import cheap_when_small, plan_of, tuned, work_of

from trainers.training.fit import Fit
from trainers.training.trainer import new_fit
from trainers.tuning import study as studies
from trainers.tuning.conclude import conclude
from trainers.tuning.report import rows_of
from trainers.tuning.storage import JOURNAL
from trainers.tuning.study import finished, give_back_of_the_dead, this_worker
from trainers.tuning.trial import Objective
from trainers.tuning.workers import run_trials
from wakedeploy.core.episodes import EpisodeSet


def points_and_values(study: optuna.Study) -> list[tuple[dict, list[float] | None]]:
    ended = finished(study.trials)
    return sorted([(sorted(t.params.items()), t.state.name, t.values) for t in ended], key=str)


def states(study: optuna.Study) -> list[str]:
    return [row.state for row in rows_of(study)]


def interrupted_in(epoch: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C at the end of the study's `epoch`th epoch, once."""
    run_epoch, seen = Fit.run_epoch, []

    def interrupted(self: Fit) -> object:
        standing = run_epoch(self)
        seen.append(1)
        if len(seen) == epoch:
            raise KeyboardInterrupt
        return standing

    monkeypatch.setattr(Fit, "run_epoch", interrupted)


# --- one trial ----------------------------------------------------------------------------------


def test_over_the_budget_nothing_is_trained_and_the_count_is_recorded(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Fit, "run_epoch", lambda self: pytest.fail("trained"))
    study = tuned(echo, tmp_path / "out", budget=10)
    for trial in study.trials:
        assert trial.state == TrialState.PRUNED
        assert trial.user_attrs["parameters"] >= 10
        assert "budget fewer than 10" in trial.user_attrs["reason"]
    assert states(study) == ["over budget"] * 4


def test_a_point_that_cannot_be_built_is_pruned_with_the_reason(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    study = tuned(echo, tmp_path / "out", "cross-attention", 2, asked=("embed=9", "heads=2"))
    assert states(study) == ["impossible"] * 2
    assert "multiple of 2" in study.trials[0].user_attrs["reason"]


def test_a_trial_behind_the_others_ends_early(echo: EpisodeSet, tmp_path: Path) -> None:
    study = tuned(echo, tmp_path / "out", trials=12, epochs=6)
    early = [row for row in rows_of(study) if row.state == "pruned"]
    assert early
    assert all(0 < row.epochs < 6 and "behind the others" in row.reason for row in early)
    assert all(row.epochs == 6 for row in rows_of(study) if row.state == "finished")


def test_with_two_objectives_too_nothing_over_the_budget_is_trained(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    study = tuned(
        echo, tmp_path / "out", trials=12, objective=("rmse", "latency"), budget=60,
        step_cost=cheap_when_small,
    )  # fmt: skip
    assert set(states(study)) == {"finished", "over budget"}


@pytest.mark.parametrize("pruner", ["hyperband", "none"])
def test_other_pruners_do_as_they_are_called(pruner: str, echo: EpisodeSet, tmp_path: Path) -> None:
    study = tuned(echo, tmp_path / "out", trials=8, epochs=6, pruner=pruner)
    assert ("pruned" in states(study)) == (pruner == "hyperband")


def test_a_diverged_training_fails_alone(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    validate, seen = Fit.validate, []

    def broken(self: Fit) -> float:
        seen.append(1)
        return float("nan") if len(seen) == 2 else validate(self)

    monkeypatch.setattr(Fit, "validate", broken)
    study = tuned(echo, tmp_path / "out", trials=3)
    assert states(study) == ["failed", "finished", "finished"]
    assert study.trials[0].user_attrs["reason"] == "training diverged in epoch 2"


def test_trials_train_where_they_are_told(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def fit_on(config: object, predictor: object, learned: object, held_out: object, device: str):
        asked.append(device)
        return new_fit(config, predictor, learned, held_out)

    monkeypatch.setattr("torch.cuda.is_available", lambda: True)
    monkeypatch.setattr("trainers.tuning.trial.new_fit", fit_on)
    rows = rows_of(tuned(echo, tmp_path / "out", trials=2, device="cuda"))
    tuned(echo, tmp_path / "auto", trials=1, device="auto")  # small work stays on the CPU
    assert asked == ["cuda", "cuda", "cpu"]
    assert [row.device for row in rows] == ["cuda", "cuda"]


@pytest.mark.whole
def test_the_test_episodes_are_looked_at_once_for_the_best_at_the_end(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    part = EpisodeSet.part
    work = work_of(echo, tmp_path / "out", trials=3)
    study = work.begin()
    monkeypatch.setattr(
        EpisodeSet, "part", lambda self, split: asked.append(split) or part(self, split)
    )
    run_trials(work, study, echo)
    assert asked
    assert "test" not in asked
    found = conclude(work, study, echo)
    looked = asked.count("test")
    assert looked > 0
    again = conclude(work, study, echo)  # the run lies there
    assert asked.count("test") == looked
    assert again.run.metrics == found.run.metrics


# --- a study that goes on -----------------------------------------------------------------------


@pytest.mark.whole
@pytest.mark.parametrize("arch", ["agile-mlp", pytest.param("gru", marks=pytest.mark.slow), "esn"])
def test_a_study_in_two_sessions_is_the_study_in_one(
    arch: str, echo: EpisodeSet, tmp_path: Path
) -> None:
    whole = tuned(echo, tmp_path / "whole", arch, 14)
    tuned(echo, tmp_path / "parts", arch, 5)
    parts = tuned(echo, tmp_path / "parts", arch, 14)
    assert len(parts.trials) == 14
    assert points_and_values(parts) == points_and_values(whole)
    assert len({str(t.params) for t in whole.trials}) == 14


@pytest.mark.whole
def test_an_interrupted_trial_is_begun_again_and_nothing_else_changes(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = tuned(echo, tmp_path / "whole", trials=13)
    with monkeypatch.context() as patched:
        interrupted_in(8, patched)
        with pytest.raises(KeyboardInterrupt):
            tuned(echo, tmp_path / "cut", trials=13)
    resumed = tuned(echo, tmp_path / "cut", trials=13)
    rows = rows_of(resumed)
    (lost,) = [row for row in rows if row.state == "interrupted"]
    assert lost.reason == "interrupted; begun again"
    assert rows[lost.number + 1].point == lost.point
    assert len(rows) == 14
    assert points_and_values(resumed) == points_and_values(whole)


def test_a_trial_may_be_interrupted_again_and_again(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for _ in range(3):
        with monkeypatch.context() as patched:
            interrupted_in(1, patched)
            with pytest.raises(KeyboardInterrupt):
                tuned(echo, tmp_path / "out", trials=1)
    rows = rows_of(tuned(echo, tmp_path / "out", trials=1))
    assert [row.state for row in rows] == ["interrupted"] * 3 + ["finished"]
    assert all(row.point == rows[0].point for row in rows)


def test_a_trial_interrupted_at_its_very_beginning_is_not_lost(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("trainers.tuning.trial.this_worker", interrupted)
        with pytest.raises(KeyboardInterrupt):
            tuned(echo, tmp_path / "out", trials=2)
    rows = rows_of(tuned(echo, tmp_path / "out", trials=2))
    assert [row.state for row in rows] == ["interrupted", "finished", "finished"]
    assert rows[0].reason == "interrupted; begun again"


def test_enough_trials_are_enough(echo: EpisodeSet, tmp_path: Path) -> None:
    tuned(echo, tmp_path / "out", trials=3)
    assert len(tuned(echo, tmp_path / "out", trials=2).trials) == 3


def running_trial(study: optuna.Study, worker: dict | None) -> optuna.Trial:
    trial = study.ask()
    trial.suggest_int("hidden", 4, 16)
    if worker:
        trial.set_user_attr("worker", worker)
    return trial


def test_the_trials_of_dead_processes_are_given_back_once(echo: EpisodeSet, tmp_path: Path) -> None:
    work = work_of(echo, tmp_path / "out")
    study = work.open()
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    mine = this_worker()
    running_trial(study, mine)
    dead = running_trial(study, {**mine, "pid": ended.pid})
    reused = running_trial(study, {**mine, "born": "00000000-1"})
    running_trial(study, {**mine, "pid": ended.pid, "host": "elsewhere"})
    running_trial(study, None)  # has not said yet who runs it
    assert give_back_of_the_dead(study) == 2
    assert give_back_of_the_dead(study) == 0
    lost = [t.number for t in study.trials if t.state == TrialState.FAIL]
    assert lost == [dead.number, reused.number]
    again = [t for t in study.trials if t.state == TrialState.WAITING]
    assert [t.user_attrs["again"] for t in again] == lost
    assert [t.system_attrs["fixed_params"] for t in again] == [dead.params, reused.params]
    second = study.ask()
    assert second.suggest_int("hidden", 4, 16) == dead.params["hidden"]
    second.set_user_attr("worker", {**mine, "pid": ended.pid})
    assert give_back_of_the_dead(study) == 1  # whatever kills its worker twice is let go
    assert sum(t.state == TrialState.WAITING for t in study.trials) == 1
    counted = [t.number for t in finished(study.trials)]
    assert counted == [second.number]


def test_of_other_machines_trials_are_given_back_only_when_it_is_asked_for(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    study = work_of(echo, tmp_path / "out").open()
    mine = this_worker()
    running_trial(study, mine)
    running_trial(study, {**mine, "host": "elsewhere"})
    running_trial(study, {**mine, "machine": "another of that name"})
    running_trial(study, None)  # has not said yet who runs it
    assert give_back_of_the_dead(study) == 0
    assert give_back_of_the_dead(study, elsewhere=True) == 2
    assert [t.number for t in study.trials if t.state == TrialState.RUNNING] == [0, 3]


def test_a_trial_that_never_said_who_runs_it_is_given_up(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = work_of(echo, tmp_path / "out").open()
    running_trial(study, None)
    assert give_back_of_the_dead(study) == 0
    monkeypatch.setattr(studies, "_UNSIGNED_S", -1.0)
    assert give_back_of_the_dead(study) == 1


def test_a_worker_that_was_taken_for_dead_goes_on_with_another_trial(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = work_of(echo, tmp_path / "out", trials=3)
    study, other = work.begin(), work.open()
    run_epoch, seen = Fit.run_epoch, []

    def slept(self: Fit) -> object:
        seen.append(1)
        if len(seen) == 2:
            other.tell(0, state=TrialState.FAIL)
            studies.give_back(other, other.trials[0])
        return run_epoch(self)

    monkeypatch.setattr(Fit, "run_epoch", slept)
    run_trials(work, study, echo)
    rows = rows_of(study)
    assert [row.state for row in rows] == ["lost", "finished", "finished", "finished"]
    assert rows[1].point == rows[0].point


def test_what_is_not_foreseen_ends_the_tune_and_is_kept_as_the_trials_reason(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(self: Fit) -> object:
        raise ValueError("no such thing")

    monkeypatch.setattr(Fit, "run_epoch", broken)
    work = work_of(echo, tmp_path / "out", trials=3)
    study = work.begin()
    with pytest.raises(ValueError, match="no such thing"):
        run_trials(work, study, echo)
    (row,) = rows_of(study)
    assert (row.state, row.reason) == ("failed", "no such thing")


def test_the_reference_stays_the_reference_when_it_is_begun_again(
    echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        interrupted_in(1, patched)
        with pytest.raises(KeyboardInterrupt):
            tuned(echo, tmp_path / "out", trials=2, asked=())
    rows = rows_of(tuned(echo, tmp_path / "out", trials=2, asked=()))
    assert [row.reference for row in rows] == [True, True, False]
    assert (rows[1].point["layers"], rows[1].point["hidden"]) == (2, 128)


# Cut, of something else, of a crash that left pages of zeros or only the second of an entry.
BROKEN = [b'{"op_code":5,"wor', b"garbage\n", b"\xff\xfe bad\n", b"\x00" * 9000,
          b"\x00" * 41 + b'"}\n', b"\n"]  # fmt: skip


def test_who_runs_a_trial_is_this_process() -> None:
    worker = this_worker()
    assert (worker["host"], worker["pid"]) == (platform.node(), os.getpid())
    assert worker["born"] == this_worker()["born"]
    assert worker["born"] != studies._born(1)


@pytest.mark.parametrize("broken", BROKEN)
def test_a_broken_last_line_of_the_journal_is_dropped_by_the_next_writer(
    echo: EpisodeSet, tmp_path: Path, broken: bytes
) -> None:
    tuned(echo, tmp_path / "out", trials=2)
    with (tmp_path / "out" / JOURNAL).open("ab") as file:
        file.write(broken)
    study = tuned(echo, tmp_path / "out", trials=4)
    assert states(study) == ["finished"] * 4
    assert len(tuned(echo, tmp_path / "out", trials=4).trials) == 4  # it is read from its beginning


def test_with_everything_fixed_one_point_is_judged(echo: EpisodeSet, tmp_path: Path) -> None:
    names = [dimension.name for dimension in plan_of(echo).dimensions]
    values = dict(zip(names, (1, 8, 0.01, 0.001, 128), strict=True))
    asked = tuple(f"{name}={value}" for name, value in values.items())
    work = work_of(echo, tmp_path / "out", trials=1, asked=asked)
    study = work.begin()
    run_trials(work, study, echo)
    found = conclude(work, study, echo)
    assert found.importances == {}
    assert found.run.config.hyper == {"hidden": 8, "layers": 1}
    assert found.run.config.settings["batch"] == 128


@pytest.mark.parametrize(
    ("error", "reason"),
    [(MemoryError(), "MemoryError"), (torch.OutOfMemoryError("2 GB asked for"), "2 GB asked for")],
)
def test_a_trial_without_enough_memory_fails_alone(
    error: Exception, reason: str, echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained, failed = Objective._trained, list[int]()

    def once_too_large(self: Objective, trial: optuna.Trial, *others: object) -> float:
        if trial.number == 1:
            failed.append(trial.number)
            raise error
        return trained(self, trial, *others)

    monkeypatch.setattr(Objective, "_trained", once_too_large)
    study = tuned(echo, tmp_path / "out", trials=3)
    states = [trial.state for trial in study.trials]
    assert failed == [1]
    assert states.count(TrialState.FAIL) == 1
    assert study.trials[1].user_attrs["reason"] == reason
    assert len(states) == 3
