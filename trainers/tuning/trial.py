"""One trial: a point of the space built, held against the budget, trained and judged.

The error is the root of the validation loss, so 1 is what predicting the mean would cost. A trial
never looks at the test split.
"""

import math
from collections.abc import Callable

import numpy as np
import optuna
import torch
from numpy.typing import NDArray

from trainers.build import unfilled
from trainers.model import Predictor, SolvedModel
from trainers.training.device import choose_device
from trainers.training.fit import FitSettings
from trainers.training.ridge import solve_readout
from trainers.training.runs import RunConfig, new_predictor
from trainers.training.trainer import new_fit, tapes
from trainers.tuning.plan import Plan
from trainers.tuning.space import Point, in_effect, suggest
from trainers.tuning.study import (
    BUDGET,
    DEVICE,
    EPOCHS,
    INTERRUPTED,
    PARAMETERS,
    POINT,
    PRUNER,
    REASON,
    SHAPE,
    WORKER,
    alike,
    begin_again,
    pruner_of,
    this_worker,
)
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import CheckFailed, UnusableInput, one_line

# What a step of the exported predictor costs, in the study's unit, over observations (T, d).
StepCost = Callable[[Predictor, RunConfig, NDArray[np.float32]], float]
# What a single trial may fail with; the study goes on.
FAILURES = (
    CheckFailed,
    torch.linalg.LinAlgError,  # type: ignore[attr-defined]
    torch.OutOfMemoryError,  # another point may fit
    MemoryError,
)
_TIMED_SAMPLES = 512


class Objective:
    """What Optuna minimises: a trial's validation error and, if asked for, what its step costs.

    Trials train on `device`, which is "auto", "cpu" or "cuda" as in `trainers.training.trainer`.
    Raises TrialPruned and what FAILURES names, each with its reason in the trial's attributes.
    """

    def __init__(
        self,
        plan: Plan,
        data: EpisodeSet,
        step_cost: StepCost | None = None,
        device: str = "cpu",
    ) -> None:
        if plan.data_sha256 != data.sha256:
            raise UnusableInput("The data set was changed while it was tuned on; tune anew.")
        self.plan, self.data, self.step_cost = plan, data, step_cost
        self.device = device
        self.learned, self.held_out = tapes(data, plan.lead_s)

    def __call__(
        self, trial: optuna.Trial, on_begun: Callable[[], None] = lambda: None
    ) -> float | tuple[float, float]:
        """The trial's error, or its error and what its step costs; `on_begun` is called first."""
        try:
            # Within, since an interruption that strikes here is one as well.
            on_begun()
            trial.set_user_attr(WORKER, this_worker())
            trial.set_user_attr(PRUNER, pruner_of(trial.study))
            return self._judged(trial)
        except KeyboardInterrupt:
            trial.set_user_attr(REASON, INTERRUPTED)
            begin_again(trial.study, trial.number)
            raise
        except optuna.TrialPruned:
            raise
        except Exception as error:
            trial.set_user_attr(REASON, one_line(error) or type(error).__name__)
            raise

    def _judged(self, trial: optuna.Trial) -> float | tuple[float, float]:
        config = self._configured(trial, self._drawn(trial))
        if (known := alike(trial.study, trial)) is not None:
            trial.set_user_attr(REASON, f"is trial {known.number} once more, and not trained again")
            return known.values[0] if self.plan.cost is None else (known.values[0], known.values[1])
        predictor = self._built(trial, config)
        error = self._trained(trial, config, predictor)
        if self.plan.cost is None:
            return error
        assert self.step_cost is not None
        observations = self.held_out.observation[:_TIMED_SAMPLES].numpy()
        return error, self.step_cost(predictor.to("cpu").eval(), config, observations)

    def _drawn(self, trial: optuna.Trial) -> Point:
        """The trial's point, with the values in effect; kept for who reads of it."""
        drawn = suggest(trial, self.plan.dimensions)
        point = in_effect(self.plan.arch, drawn, self.plan.rate_hz)
        searched = {n: v for n, v in point.items() if n in trial.params or v != drawn[n]}
        trial.set_user_attr(POINT, searched)
        return point

    def _configured(self, trial: optuna.Trial, point: Point) -> RunConfig:
        """Held against the budget before any memory is taken or epoch trained."""
        try:
            config = self.plan.configured(self.data, point)
            count = unfilled(
                config.arch,
                inputs=len(config.observation),
                outputs=len(config.force),
                window_s=config.window_s,
                rate_hz=config.rate_hz,
                hyper=config.hyper,
            ).trainable
        except UnusableInput as error:
            raise _pruned(trial, str(error), SHAPE, excess=1.0) from error
        trial.set_user_attr(PARAMETERS, count)
        if count >= self.plan.budget:
            why = f"{count:,} trainable weights, budget fewer than {self.plan.budget:,}"
            raise _pruned(trial, why, BUDGET, excess=1 + math.log(count / self.plan.budget))
        return config

    def _built(self, trial: optuna.Trial, config: RunConfig) -> Predictor:
        try:
            return new_predictor(config)
        except UnusableInput as error:  # a reservoir that came out without a loop
            raise _pruned(trial, str(error), SHAPE, excess=1.0) from error

    def _trained(self, trial: optuna.Trial, config: RunConfig, predictor: Predictor) -> float:
        settings = FitSettings(**config.settings)  # type: ignore[arg-type]
        device = choose_device(self.device, predictor, settings)
        trial.set_user_attr(DEVICE, device)
        if isinstance(predictor.core, SolvedModel):
            learned, held_out = (tape.to(device) for tape in (self.learned, self.held_out))
            loss, _ = solve_readout(predictor.to(device), learned, held_out, config.loss_weights)
            return _error(loss, "its only pass")
        fit = new_fit(config, predictor, self.learned, self.held_out, device)
        while not fit.finished:
            standing = fit.run_epoch()
            error = _error(standing.history[-1], f"epoch {standing.epoch}")
            if self.plan.cost is not None:  # Optuna knows no pruning between several objectives
                continue
            trial.report(error, standing.epoch)
            if trial.should_prune():
                trial.set_user_attr(REASON, f"behind the others after epoch {standing.epoch}")
                raise optuna.TrialPruned
        trial.set_user_attr(EPOCHS, fit.standing.epoch)
        return math.sqrt(fit.standing.best)


def _error(loss: float, when: str) -> float:
    if not math.isfinite(loss):
        raise CheckFailed(f"training diverged in {when}")
    return math.sqrt(max(loss, 0.0))


def _pruned(trial: optuna.Trial, why: str, limit: str, excess: float) -> optuna.TrialPruned:
    """A trial that is not trained; `excess` tells the sampler how far beyond the limit it lies."""
    trial.set_user_attr(REASON, why)
    trial.set_constraint(limit, excess)
    return optuna.TrialPruned(why)
