"""Processes that keep a study's trials running, until as many are finished as were asked for.

A worker shares nothing with the others but the study. One that is killed loses its trial, whose
point another one takes up; a new worker takes its place.
"""

import contextlib
import functools
import multiprocessing
import multiprocessing.connection
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

import optuna
import torch

from trainers.preset import read_preset
from trainers.training.device import require_cuda
from trainers.tuning.plan import Plan
from trainers.tuning.report import are_trials
from trainers.tuning.space import Point
from trainers.tuning.starts import reference_point, usual_starts
from trainers.tuning.storage import JOURNAL, Place
from trainers.tuning.study import (
    REFERENCE,
    all_trials,
    default_name,
    finished,
    give_back_of_the_dead,
    is_new,
    open_study,
    running,
    taken_from_us,
    waiting,
)
from trainers.tuning.trial import FAILURES, Objective, StepCost
from wakedeploy.core.episodes import EpisodeSet, read_episode_set
from wakedeploy.core.errors import CheckFailed, UnusableInput, WakedeployError, is_full
from wakedeploy.core.interruption import interruptible
from wakedeploy.core.processes import deaf_to_ctrl_c, end_with_parent

OnTrials = Callable[[optuna.Study], None]

BEST = "best.toml"  # what the study found, in the folder of each of its machines
TRIALS = "trials.csv"  # written just before
_LOOK_S = 0.5  # between two looks at workers and study
_LEAVE_S = 120.0  # an interrupted worker's time to record its trial, on a busy machine


@dataclass(frozen=True)
class Work:
    """What every worker gets; `trials` is how many are to be finished in all.

    With `give_up_elsewhere` what other machines are at when we begin counts as lost.
    """

    plan: Plan
    data: Path
    out: Path
    address: str | None
    study_name: str | None
    trials: int
    pruner: str
    step_cost: StepCost | None = None
    device: str = "cpu"
    give_up_elsewhere: bool = False

    @property
    def place(self) -> Place:
        """Where the study is kept."""
        return Place(self.out, self.address)

    @property
    def name(self) -> str:
        """What the study is called."""
        return self.study_name or default_name(self.plan)

    def turn(self) -> contextlib.AbstractContextManager[Callable[[], None]]:
        """One process at a time in here, on all machines of the study; as `Place.turn`."""
        return self.place.turn(self.name)

    def open(self) -> optuna.Study:
        """The study; UnusableInput as `open_study`."""
        with self.turn():
            return open_study(self.place, self.plan, self.study_name, self.pruner)

    def begin(self, starts: Sequence[Point] = ()) -> optuna.Study:
        """The same for the first process: the study begins at the paper's shape and at `starts`.

        Raises UnusableInput where CUDA is asked for in vain, with nothing made, and for more starts
        than trials are left.
        """
        if self.device == "cuda":
            require_cuda()
        _check_folder(self)
        study = self.open()
        with self.turn(), self.place.reachable():
            begun = bool(all_trials(study))
            if not begun and (self.out / BEST).exists():
                raise UnusableInput(
                    f"{self.out / BEST} belongs to a study whose trials are no longer in"
                    f" {self.place.name}; choose another --out."
                )
            paper = None if begun else reference_point(self.plan)
            new = [point for point in starts if is_new(study, point) and point != paper]
            queued = len(new) + waiting(study) + (paper is not None)
            free = _remaining(study, self.trials) - queued
            if new and free < 0:
                raise UnusableInput(
                    f"--start: there is no trial left for {-free} of {queued} points to begin at;"
                    f" ask for --trials {self.trials - free} or more."
                )
            if paper is not None:
                study.enqueue_trial(paper, user_attrs={REFERENCE: True})
            usual = [] if begun else usual_starts(self.plan)[:free]
            for point in [*new, *usual]:
                if is_new(study, point):
                    study.enqueue_trial(point)
        return study


def _check_folder(work: Work) -> None:
    """Refuse a folder that holds what another study found, or things of another kind."""
    path = work.out / BEST
    if not path.exists():
        _check_no_strangers(work)
        return
    there = read_preset(path).study
    settings = {
        "name": work.name,
        "data_sha256": work.plan.data_sha256,
        "kept_in": work.place.portable_name,
    }
    for what, value in settings.items():
        if there.get(what) != value:
            raise UnusableInput(
                f"{path} is of another study ({what} = {there.get(what)}, not {value}); choose"
                " another --out."
            )


def _check_no_strangers(work: Work) -> None:
    """Without a preset a study's journal may lie here, or trials of which none came to its end."""
    if not work.out.is_dir():
        return
    shown = sorted(path for path in work.out.iterdir() if not path.name.startswith("."))
    if JOURNAL in [path.name for path in shown] and not work.place.is_journal:
        raise UnusableInput(
            f"{work.out} holds a study of its own, {JOURNAL}; choose another --out, or leave out"
            " --storage to go on with it."
        )
    # A journal is there from a study's first moment on.
    ours = [path for path in shown if path.name == JOURNAL and work.place.is_journal]
    if not work.place.is_journal and [path.name for path in shown] == [TRIALS]:
        ours = [path for path in shown if are_trials(path)]
    if shown and not ours:
        raise UnusableInput(
            f"{work.out} holds {shown[0].name} and no study; choose another --out, or an empty one."
        )


def run_trials(
    work: Work,
    study: optuna.Study,
    data: EpisodeSet,
    workers: int = 1,
    on_trials: OnTrials = lambda study: None,
) -> None:
    """Run trials until all are finished, or run elsewhere. KeyboardInterrupt stops it cleanly.

    Raises CheckFailed when workers die faster than they work, and what a worker raises.
    """
    with work.place.reachable(), interruptible():
        give_back_of_the_dead(study, elsewhere=work.give_up_elsewhere)
        on_trials(study)
        remaining = _remaining(study, work.trials)
        if min(workers, remaining) <= 1:
            _run_here(work, study, data, on_trials)
        else:
            _Crew(work, study, on_trials).run(min(workers, remaining))


def _remaining(study: optuna.Study, wanted: int) -> int:
    trials = all_trials(study)
    return wanted - len(finished(trials)) - len(running(trials))


def _run_here(
    work: Work, study: optuna.Study, data: EpisodeSet, on_trials: OnTrials = lambda study: None
) -> None:
    """One trial after the other in this process."""
    torch.set_num_threads(1)
    objective = Objective(work.plan, data, work.step_cost, work.device)
    while True:
        with work.turn() as leave:  # so that no two count the same trial as theirs
            if _remaining(study, work.trials) <= 0:
                return
            begun = functools.partial(objective, on_begun=leave)
            try:
                study.optimize(begun, n_trials=1, catch=FAILURES)
            except (optuna.exceptions.UpdateFinishedTrialError, ValueError):
                if not taken_from_us(study):
                    raise
            except AssertionError as error:
                raise _full_disk(error) or error from None
        on_trials(study)


def _full_disk(error: AssertionError) -> BaseException | None:
    """What is behind Optuna's surprise that it could not write down how a trial ended."""
    cause = error.__context__
    return cause if cause is not None and is_full(cause) else None


@dataclass
class _Crew:
    """The parent of several workers."""

    work: Work
    study: optuna.Study
    on_trials: OnTrials
    members: dict[SpawnProcess, Connection] = field(default_factory=dict)
    idle_deaths: int = 0

    def run(self, size: int) -> None:
        """Until no trial is left to begin and every worker has ended."""
        try:
            for _ in range(size):
                self._hire()
            while self.members:
                multiprocessing.connection.wait([m.sentinel for m in self.members], _LOOK_S)
                for member in [m for m in self.members if not m.is_alive()]:
                    self._dismiss(member)
                self.on_trials(self.study)
        finally:
            self._end_all()

    def _hire(self) -> None:
        context = multiprocessing.get_context("spawn")  # torch does not survive a fork
        reading, writing = context.Pipe(duplex=False)
        member = context.Process(target=_member, args=(self.work, writing))
        with deaf_to_ctrl_c():  # the parent stops its workers in order
            member.start()
            writing.close()
            self.members[member] = reading

    def _dismiss(self, member: SpawnProcess) -> None:
        """A worker that ended: with its work, with an error, or killed."""
        reading = self.members.pop(member)
        error = _worker_error(reading)
        if error is not None:
            raise error
        if member.exitcode == 0:
            return
        lost = give_back_of_the_dead(self.study)
        self.idle_deaths = 0 if lost else self.idle_deaths + 1
        if self.idle_deaths > len(self.members) + 2:  # something kills them before they work
            raise CheckFailed(
                f"Workers end before they begin a trial (exit status {member.exitcode}); is there"
                " enough memory for --workers?"
            )
        if _remaining(self.study, self.work.trials) > 0:
            self._hire()

    def _end_all(self) -> None:
        """Let every worker record its trial; a second Ctrl-C does not wait for that."""
        try:
            for member in self.members:
                member.terminate()
            for member in self.members:
                member.join(_LEAVE_S)
        finally:
            for member in self.members:
                member.kill()
                member.join()
            self.members.clear()


def _worker_error(reading: Connection) -> Exception | None:
    """What a worker said before it ended, if it was not killed."""
    try:
        error: Exception | None = reading.recv() if reading.poll() else None
    except (EOFError, OSError):
        return None
    finally:
        reading.close()
    return error


def _member(work: Work, writing: Any) -> None:
    """A worker process: trials until none is left; what it fails with goes to the parent."""
    end_with_parent()
    try:
        with work.place.reachable(), interruptible():
            _run_here(work, work.open(), read_episode_set(work.data))
    except KeyboardInterrupt:
        os._exit(130)
    except (WakedeployError, OSError) as error:
        writing.send(error)
    except Exception as error:
        writing.send(CheckFailed(f"a worker failed: {type(error).__name__}: {error}"))
