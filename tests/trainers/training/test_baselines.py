"""What a predictor has to beat, beside the same computed by numpy."""

import dataclasses

import numpy as np
import pytest

from trainers.training.baselines import baselines
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet, window_shape
from wakedeploy.core.errors import UnusableInput

LEAD = 2  # samples


def rows(data: EpisodeSet, split: str, ages: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """What is seen at every scored sample, `ages` samples ago, with a 1; and the force later."""
    seen, force = [], []
    for episode in data.part(split):
        for at in range(data.warm_up_steps, len(episode) - LEAD):
            seen.append([*np.concatenate([episode.observation[at - age] for age in ages]), 1.0])
            force.append(episode.force[at + LEAD])
    return np.array(seen, float), np.array(force, float)


def least_squares(data: EpisodeSet, ages: list[int]) -> float:
    """The error on test of what fits training best."""
    weights = np.linalg.lstsq(*rows(data, "train", ages), rcond=None)[0]
    seen, force = rows(data, "test", ages)
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
            "linear, one tick": least_squares(echo, [0]),
            "linear, window": least_squares(echo, [age * stride for age in range(k)]),
        },
        rel=1e-4,
    )
    assert found["linear, window"] < 0.9 * found["linear, one tick"]  # the force is an echo


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
