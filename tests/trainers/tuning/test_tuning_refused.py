"""Studies that are of something else, and sets too small: one sentence, nothing overwritten."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import optuna
import pytest
from small_study import plan_of, tuned, work_of

from trainers.tuning import study as studies
from trainers.tuning.storage import JOURNAL
from trainers.tuning.workers import run_trials
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import UnusableInput


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"arch": "gru"}, "arch = agile-mlp, not gru"),
        ({"lead_s": 0.1}, "lead_s = 0.0, not 0.1"),
        ({"budget": 5_000}, "budget = 100000, not 5000"),
        ({"objective": ("rmse", "latency")}, "objective = rmse, not rmse,latency"),
        ({"epochs": 4}, "epochs = 3, not 4"),
        ({"seed": 1}, "seed = 0, not 1"),
        (
            {"asked": ("hidden=4:9", "layers=1:2", "batch=128:512")},
            "dimensions = hidden=4:16, not hidden=4:9;",
        ),
        ({"study_name": "mine"}, "the study echo-agile-mlp is named so, not mine"),
    ],
)
def test_a_study_of_another_plan_is_refused_and_left_alone(
    changes: dict, says: str, echo: EpisodeSet, tmp_path: Path
) -> None:
    tuned(echo, tmp_path / "out", trials=1)
    before = {p: p.read_bytes() for p in (tmp_path / "out").rglob("*") if p.is_file()}
    with pytest.raises(UnusableInput, match=says) as told:
        tuned(echo, tmp_path / "out", **changes)
    assert "\n" not in str(told.value)
    assert "choose another --out" in str(told.value)
    assert {p: p.read_bytes() for p in (tmp_path / "out").rglob("*") if p.is_file()} == before


def test_a_study_of_another_set_is_refused(
    echo: EpisodeSet, make_echo: Callable[..., EpisodeSet], tmp_path: Path
) -> None:
    tuned(echo, tmp_path / "out", trials=1)
    other = make_echo(steps=200)
    with pytest.raises(UnusableInput, match=rf"another data set \(sha256 {echo.sha256[:12]}"):
        tuned(other, tmp_path / "out")


@pytest.mark.parametrize(
    "theirs",
    [
        "a shopping list\nwith two lines\n",
        "of one line\n",
        "without an end",
        "{of\n",
        "{of",
        '{"a": 1}',
        "[1]\n",
    ],
)
def test_a_foreign_journal_is_refused(echo: EpisodeSet, tmp_path: Path, theirs: str) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / JOURNAL).write_text(theirs)
    with pytest.raises(UnusableInput, match=r"study\.journal cannot be read as a study"):
        tuned(echo, tmp_path / "out")
    assert (tmp_path / "out" / JOURNAL).read_text() == theirs


def test_a_study_that_was_made_and_not_yet_marked_goes_on(echo: EpisodeSet, tmp_path: Path) -> None:
    """Its maker was killed between the two."""
    work = work_of(echo, tmp_path / "out")
    optuna.create_study(storage=work.place.open(studies.give_back), study_name="echo-agile-mlp")
    work.begin()
    assert work.open().user_attrs[studies._IDENTITY] == work.plan.identity


def test_a_study_that_tune_did_not_make_is_refused(echo: EpisodeSet, tmp_path: Path) -> None:
    work = work_of(echo, tmp_path / "out")
    storage = work.place.open(studies.give_back)
    foreign = optuna.create_study(storage=storage, study_name="echo-agile-mlp")
    foreign.add_trial(optuna.trial.create_trial(value=1.0))
    with pytest.raises(UnusableInput, match="was not made by `wakedeploy tune`"):
        work.begin()


def shortened(data: EpisodeSet, split: str, samples: int) -> EpisodeSet:
    cut = [
        dataclasses.replace(e, observation=e.observation[:samples], force=e.force[:samples])
        if data.split[e.name] == split
        else e
        for e in data.episodes
    ]
    return dataclasses.replace(data, episodes=tuple(cut))


def test_a_set_too_small_to_judge_by_is_refused_before_anything_is_made(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    with pytest.raises(UnusableInput, match=r"validation split of this echo set has 20 samples"):
        plan_of(shortened(echo, "validation", 30))
    with pytest.raises(UnusableInput, match="'validation' split of this echo set has no episode"):
        plan_of(shortened(echo, "validation", 5))
    with pytest.raises(UnusableInput, match="'test' split of this echo set has no episode"):
        plan_of(shortened(echo, "test", 5))
    still = [
        dataclasses.replace(e, force=np.ones_like(e.force))
        if echo.split[e.name] == "validation"
        else e
        for e in echo.episodes
    ]
    with pytest.raises(UnusableInput, match="force never changes in the validation split"):
        plan_of(dataclasses.replace(echo, episodes=tuple(still)))


def test_data_that_change_meanwhile_are_noticed(
    echo: EpisodeSet, make_echo: Callable[..., EpisodeSet], tmp_path: Path
) -> None:
    work = work_of(echo, tmp_path / "out")
    with pytest.raises(UnusableInput, match="changed while it was tuned on"):
        run_trials(work, work.begin(), make_echo(steps=200))
