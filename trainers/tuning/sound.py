"""Whether the trials of a study are such as workers leave: a journal may come from anyone.

In: a trial as Optuna read it, and what the study searches. Out: what is wrong with it, if anything.
"""

import math
from collections.abc import Collection
from typing import Any

import optuna
from optuna.trial import FrozenTrial, TrialState
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from wakedeploy.core.errors import one_line
from wakedeploy.core.validation import first_problem

Number = float | int


class _Record(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False)


class _Worker(_Record):
    host: str
    machine: str
    pid: int = Field(ge=0, lt=2**31)
    born: str | None


class _Told(_Record):
    """What a trial says of itself, by the names that `trainers.tuning.study` gives it."""

    reason: str = ""
    parameters: int | None = Field(default=None, ge=0, lt=2**53)
    epochs: int = Field(default=0, ge=0, lt=2**53)
    device: str = ""
    pruner: str = ""
    point: dict[str, Number] = {}
    again: int | None = None
    worker: _Worker | None = None


class _Queued(_Record):
    fixed_params: dict[str, Number] = {}


def problem_of(trial: FrozenTrial, searched: Collection[str], objectives: int) -> str | None:
    """What no worker has written about a trial, in a clause; None where there is nothing.

    `searched` are the names of the study's dimensions.
    """
    try:
        _Told.model_validate(trial.user_attrs)
        _Queued.model_validate(trial.system_attrs)
        _require_possible(trial, objectives)
        named = trial.params.keys() | fixed_params(trial) | trial.user_attrs.get("point", {}).keys()
        unknown = named - set(searched)
        if unknown:
            raise ValueError(f"it searches {min(unknown)}, which the study does not")
    except ValidationError as error:
        return f"has a trial {trial.number} with {first_problem(error)}"
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        return f"has a trial {trial.number} that cannot be: {one_line(error)}"
    return None


def fixed_params(trial: FrozenTrial) -> dict[str, Any]:
    """The parameters that a queue gives a trial."""
    fixed: dict[str, Any] = trial.system_attrs.get("fixed_params", {})
    return fixed


def _require_possible(trial: FrozenTrial, objectives: int) -> None:
    """ValueError, TypeError and the like for values and parameters that do not fit together."""
    values = trial.values if trial.state == TrialState.COMPLETE else None
    if values is not None and len(values) != objectives:
        raise ValueError(f"{len(values)} values where there are {objectives} objectives")
    for value in (*(values or ()), *trial.params.values(), *trial.intermediate_values.values()):
        if not math.isfinite(value):
            raise ValueError(f"{value} is no number")
    if trial.state.is_finished() and None in (trial.datetime_start, trial.datetime_complete):
        raise ValueError("it has ended and does not say when")
    optuna.trial.create_trial(
        state=trial.state,
        values=values,
        params=trial.params,
        distributions=trial.distributions,
        intermediate_values=trial.intermediate_values,
    )
