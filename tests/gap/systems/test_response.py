"""Coloured noise: innovations against the joint density, places, and effects."""

from typing import ClassVar

import numpy as np
import pytest
from scipy.stats import binned_statistic, multivariate_normal

from wakedeploy.gap.evidence.inference import Free
from wakedeploy.gap.search.comparison import Record
from wakedeploy.gap.search.rounds import concluded
from wakedeploy.gap.systems.response import ResponseModel, covariance, scored


class Line(ResponseModel):
    """A line over time; the effect is a parabola."""

    name = "line"
    channels = (("height", "m"),)
    noise_start = ((0.2, 0.3, 0.1),)
    effects: ClassVar = {
        "bend": (Free("bend.size", "m", 0.0, 1.0, -9.0, 9.0, 1e-3, (0.1,)),),
        "wave": (Free("wave.size", "m", 0.0, 1.0, -9.0, 9.0, 1e-3, (0.1,)),),
    }

    def __init__(self, bend: float, episodes: int = 8) -> None:
        self.time_s = np.arange(60) / 20.0
        rng = np.random.default_rng(3)
        factor = np.linalg.cholesky(covariance(tuple(np.log((0.2, 0.3, 0.1))), self.time_s))
        self.records = [
            Record(f"{e}", self.time_s, (bend * (self.time_s - 1.5) ** 2 + factor @ noise)[None])
            for e, noise in enumerate(rng.standard_normal((episodes, 60)))
        ]

    def response(self, values, episode):
        bend = values.get("bend.size", 0.0) * (self.time_s - 1.5) ** 2
        return (bend + values.get("wave.size", 0.0) * np.sin(9.0 * self.time_s))[None]


def test_innovations_are_the_joint_density_taken_apart():
    time_s = np.sort(np.random.default_rng(0).uniform(0, 3, 40))
    noise = tuple(np.log((0.5, 0.4, 0.1)))
    factor = np.linalg.cholesky(covariance(noise, time_s))
    residual = factor @ np.random.default_rng(1).standard_normal(40)
    _, innovation, variance, _ = scored(residual, factor)
    one_by_one = -0.5 * (innovation**2 / variance + np.log(2 * np.pi * variance)).sum()
    together = multivariate_normal(np.zeros(40), covariance(noise, time_s)).logpdf(residual)
    assert one_by_one == pytest.approx(together, rel=1e-9)


def test_the_noise_is_that_of_the_ornstein_uhlenbeck_process():
    matrix = covariance(tuple(np.log((0.5, 0.4, 0.1))), np.array([0.0, 0.4]))
    assert matrix[0, 1] == pytest.approx(0.25 / np.e)
    assert matrix[0, 0] == pytest.approx(0.25 + 0.01)


def test_an_outlier_hardly_counts():
    _, _, _, weight = scored(np.array([0.1, 9.0, -0.1]), np.eye(3))
    assert weight[1] < 1e-3 < 0.97 < weight[0]


@pytest.fixture(scope="module")
def bent():
    """A line that has a bend, and what is told of it."""
    line = Line(bend=0.4, episodes=20)
    return line, concluded(line)


def test_a_bend_is_named_found_in_time_and_shown_on_sealed_episodes(bent):
    _, document = bent
    assert document["verdict"] == "named"
    entry = document["parameters"]["bend.size"]
    assert entry["low"] < 0.4 < entry["high"]
    (effect,) = document["effects"]
    assert effect["name"] == "bend"
    assert effect["parameters"]["size"] == entry
    assert effect["forecast"]["low"] > 0.0
    assert "time" in {p["coordinate"] for p in document["where"]}
    gap = document["gap"]["height"]
    assert gap["after"] < 0.8 * gap["before"]
    assert document["placebo"]["name"] == "wave"
    assert document["placebo"]["after"][0] > 1.1 * gap["after"]


def test_what_is_shown_are_the_sealed_episodes(bent):
    line, document = bent
    sealed = [r for r in line.records if r.name in document["sealed"]]
    (place,) = document["shown"]["places"]
    heights = np.concatenate([r.measured[0] for r in sealed])  # the baseline says 0 everywhere
    times = np.tile(line.time_s, len(sealed))
    means, _, _ = binned_statistic(times, heights, bins=place["edges"])
    assert place["before"] == pytest.approx(means)
    assert np.abs(place["after"]).max() < 0.5 * np.abs(means).max()
    trace = document["shown"]["trace"]
    (channel,) = trace["channels"].values()
    record = next(r for r in sealed if r.name == trace["episode"])
    np.testing.assert_array_equal(channel["measured"], record.measured[0])
    np.testing.assert_allclose(channel["before"], 0.0, atol=1e-12)


def test_nothing_is_named_where_nothing_is():
    document = concluded(Line(bend=0.0))
    assert (document["verdict"], document["effects"]) == ("none", [])


def test_three_episodes_are_too_few():
    with pytest.raises(Exception, match="at least 4"):
        concluded(Line(bend=0.4, episodes=3))
