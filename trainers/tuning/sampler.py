"""Tree-structured Parzen estimators, drawn anew for each trial from (seed, place in the order).

One generator for a whole session would make a continued study differ from an uninterrupted one,
and two workers with the same seed would draw the same points.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from optuna.distributions import BaseDistribution
from optuna.samplers import BaseSampler, TPESampler
from optuna.study import Study
from optuna.trial import FrozenTrial, TrialState

AGAIN = "again"  # user attribute of a trial that repeats another: the other's number


class SeededByTrial(BaseSampler):
    """Optuna's TPE, seeded for each trial; pruned trials over the budget count as infeasible."""

    def __init__(self, seed: int, whole: Study) -> None:
        self._seed, self._whole = seed, whole  # pruners may show a sampler a part of the study
        self._inner = TPESampler(seed=seed)

    def before_trial(self, study: Study, trial: FrozenTrial) -> None:
        """Seed by the trial's place among those that were not begun again."""
        trials = self._whole.get_trials(deepcopy=False)
        repeats = [t for t in trials if t.number <= trial.number and AGAIN in t.user_attrs]
        place = trial.number - len(repeats)
        drawn = np.random.SeedSequence((self._seed, place)).generate_state(1)
        self._inner = TPESampler(seed=int(drawn[0]))

    def infer_relative_search_space(
        self, study: Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        """The dimensions that are drawn together."""
        return self._inner.infer_relative_search_space(study, trial)

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """Those dimensions' values."""
        return self._inner.sample_relative(study, trial, search_space)

    def sample_independent(
        self,
        study: Study,
        trial: FrozenTrial,
        param_name: str,
        param_distribution: BaseDistribution,
    ) -> Any:
        """A value of a dimension that is drawn alone."""
        return self._inner.sample_independent(study, trial, param_name, param_distribution)

    def after_trial(
        self,
        study: Study,
        trial: FrozenTrial,
        state: TrialState,
        values: Sequence[float] | None,
    ) -> None:
        """Hand on what the trial came to."""
        self._inner.after_trial(study, trial, state, values)
