"""What a predictor has to beat, beside the same computed by numpy."""

import dataclasses

import numpy as np
import pytest

from trainers.training.baselines import baselines
from trainers.training.ridge import STRENGTHS
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet, window_shape
from wakedeploy.core.errors import UnusableInput

LEAD = 2  # samples


def rows(
    data: EpisodeSet, split: str, ages: list[int], lead: int = LEAD
) -> tuple[np.ndarray, np.ndarray]:
    """What is seen at every scored sample, `ages` samples ago, with a 1; and the force later."""
    seen, force = [], []
    for episode in data.part(split):
        for at in range(data.warm_up_steps, len(episode) - lead):
            seen.append([*np.concatenate([episode.observation[at - age] for age in ages]), 1.0])
            force.append(episode.force[at + lead])
    return np.array(seen, float), np.array(force, float)


def least_squares(data: EpisodeSet, ages: list[int], lead: int = LEAD) -> float:
    """The error on test of what fits training best."""
    weights = np.linalg.lstsq(*rows(data, "train", ages, lead), rcond=None)[0]
    return _error(*rows(data, "test", ages, lead), weights)


def ridge_regression(data: EpisodeSet, ages: list[int]) -> float:
    """The error on test of what fits training, under the penalty that does best on validation.

    The penalty is written as further rows of least squares, in units of each column's spread; it
    is a share of the mean variance of a column, and the intercept has none.
    """
    seen, force = rows(data, "train", ages)
    spread = np.array([*np.tile(_spread(data), len(ages)), 1.0])
    penalty = np.eye(len(spread)) * np.append(np.ones(len(spread) - 1), 0.0)
    variance = np.var(seen[:, :-1] / spread[:-1], axis=0).mean()
    tried = []
    for strength in STRENGTHS:
        extra = np.sqrt(strength * variance * len(seen)) * penalty
        both = np.vstack([seen / spread, extra])
        goal = np.vstack([force, np.zeros((len(extra), force.shape[1]))])
        weights = np.linalg.lstsq(both, goal, rcond=None)[0] / spread[:, None]
        tried.append((_error(*rows(data, "validation", ages), weights), weights))
    weights = min(tried, key=lambda each: each[0])[1]
    return _error(*rows(data, "test", ages), weights)


def _spread(data: EpisodeSet) -> np.ndarray:
    return np.concatenate([e.observation for e in data.part("train")]).astype(float).std(0)


def _error(seen: np.ndarray, force: np.ndarray, weights: np.ndarray) -> float:
    return float(np.sqrt(np.mean((seen @ weights - force) ** 2)))


def test_each_baseline_is_what_its_name_says(echo: EpisodeSet) -> None:
    found = {name: s.rmse["f_n"] for name, s in baselines(echo, "test", LEAD / 20.0).items()}
    force = rows(echo, "test", [0])[1]
    mean = rows(echo, "train", [0])[1].mean()
    k, stride = window_shape(echo.window_s, echo.rate_hz)
    assert found == pytest.approx(
        {
            "zero": np.sqrt(np.mean(force**2)),
            "training mean": np.sqrt(np.mean((force - mean) ** 2)),
            "linear, one tick": ridge_regression(echo, [0]),
            "linear, window": ridge_regression(echo, [age * stride for age in range(k)]),
        },
        rel=1e-4,
    )
    assert found["linear, window"] < 0.9 * found["linear, one tick"]  # the force is an echo


def test_without_validation_it_is_least_squares(echo: EpisodeSet) -> None:
    split = {name: "train" if of == "validation" else of for name, of in echo.split.items()}
    unheld = dataclasses.replace(echo, split=split)
    found = baselines(unheld, "test", LEAD / 20.0)["linear, one tick"].rmse["f_n"]
    assert found == pytest.approx(least_squares(unheld, [0]), rel=1e-4)


def test_of_channels_that_tell_nearly_the_same_the_window_is_still_a_bar() -> None:
    """By plain least squares such weights are huge, and any network beats what they forecast."""
    rng = np.random.default_rng(4)

    def episode(name: str, samples: int) -> Episode:
        u = np.convolve(rng.standard_normal(samples + 40), np.ones(41) / 41, "valid")
        seen = np.column_stack([u, u + 1e-5 * rng.standard_normal(samples)])
        force = u[:, None] + 0.01 * rng.standard_normal((samples, 1))
        return Episode(name, seen.astype(np.float32), force.astype(np.float32))

    data = EpisodeSet(
        domain="alike",
        rate_hz=20.0,
        observation=(Channel("u", "m"), Channel("again", "m")),
        force=(Channel("f_n", "N"),),
        window_s=1.5,
        loss_weights=(1.0,),
        split={"a": "train", "b": "validation", "c": "test"},
        episodes=(episode("a", 120), episode("b", 120), episode("c", 600)),
        provenance={},
    )
    found = baselines(data, "test", 0.0)["linear, window"]
    k, stride = window_shape(data.window_s, data.rate_hz)
    plain = least_squares(data, [age * stride for age in range(k)], lead=0)
    assert found.rmse["f_n"] < 0.02
    assert plain > 1.2 * found.rmse["f_n"]


def test_a_channel_that_never_changes_disturbs_no_fit(echo: EpisodeSet) -> None:
    def with_constant(episode: Episode) -> Episode:
        added = np.full((len(episode), 1), 9.81, np.float32)
        return Episode(episode.name, np.hstack([episode.observation, added]), episode.force)

    more = dataclasses.replace(
        echo,
        observation=(*echo.observation, Channel("g", "m/s²")),
        episodes=tuple(map(with_constant, echo.episodes)),
    )
    alone, beside = (baselines(data, "test", 0.0) for data in (echo, more))
    for name, score in alone.items():
        assert beside[name].rmse["f_n"] == pytest.approx(score.rmse["f_n"], rel=1e-5)


def test_without_training_episodes_only_what_learns_nothing_is_scored(echo: EpisodeSet) -> None:
    unseen = dataclasses.replace(echo, split={e.name: "test" for e in echo.episodes})
    assert list(baselines(unseen, "all", 0.0, fitted=False)) == ["zero"]
    with pytest.raises(UnusableInput, match="'train' split"):
        baselines(unseen, "all", 0.0)
