"""Coloured noise: innovations against the joint density, places, and effects."""

import json
from dataclasses import asdict
from typing import ClassVar

import numpy as np
import pytest
from scipy.stats import binned_statistic, multivariate_normal

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap import workflow
from wakedeploy.gap.evidence.fits import Free
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import VERSION, Answer, Disagreements, read
from wakedeploy.gap.search.comparison import Record
from wakedeploy.gap.systems.answers.words import FURTHER_LOG, sentences
from wakedeploy.gap.systems.likelihood.response import ResponseModel, covariance, scored
from wakedeploy.gap.wording import quantity
from wakedeploy.gap.workflow import concluded, run


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


class Added(workflow.Folder):
    """Steps of a line, to which nothing is added."""

    def add(self):
        return self.name()


@pytest.fixture(scope="module")
def bent():
    """A line that has a bend, and what is told of it."""
    line = Line(bend=0.4, episodes=20)
    return line, concluded(line)


def test_a_bend_is_named_found_in_time_and_shown_on_sealed_episodes(bent):
    _, result = bent
    assert result.verdict == "named"
    size = result.parameters["bend.size"]
    assert size.low < 0.4 < size.high
    (effect,) = result.effects
    assert effect.name == "bend"
    assert effect.parameters["size"] == size
    assert effect.forecast.low > 0.0
    assert "time" in {p.coordinate for p in result.where}
    error = result.gap["height"]
    assert error.after < 0.8 * error.before
    assert result.placebo.name == "wave"
    assert result.placebo.after[0] > 1.1 * error.after


def test_what_is_shown_are_the_sealed_episodes(bent):
    line, result = bent
    sealed = [r for r in line.records if r.name in result.sealed]
    (place,) = result.shown.places
    heights = np.concatenate([r.measured[0] for r in sealed])  # the baseline says 0 everywhere
    times = np.tile(line.time_s, len(sealed))
    means, _, _ = binned_statistic(times, heights, bins=place.edges)
    assert place.before == pytest.approx(means)
    assert np.abs(place.after).max() < 0.5 * np.abs(means).max()
    trace = result.shown.trace
    (course,) = trace.channels.values()
    record = next(r for r in sealed if r.name == trace.episode)
    np.testing.assert_array_equal(course.measured, record.measured[0])
    np.testing.assert_allclose(course.before, 0.0, atol=1e-12)


def test_nothing_is_named_where_nothing_is():
    result = concluded(Line(bend=0.0))
    assert (result.verdict, result.effects) == ("none", [])


def test_an_answer_begins_with_whether_it_matters_how_sure_it_is_and_what_next(bent):
    _, result = bent
    questions = ["Does it matter?", "How sure is that?", "What next?"]
    (error,) = result.gap.values()
    first = sentences(result)
    for line, question in zip(first[1:4], questions, strict=True):
        assert line.startswith(question)
    assert all(quantity(value, "m") in first[1] for value in (error.before, error.after))
    assert "bear it out" in first[2]
    assert f"that log is called {FURTHER_LOG}." in first[3]
    doubted = sentences(result.model_copy(update={"sealed_gain_nats": -1.0}))
    assert "do not confirm it" in doubted[2]
    assert "forecasts get better by it, but the readings" in doubted[2]  # as the line above says
    gap = {name: e.model_copy(update={"after": e.before}) for name, e in result.gap.items()}
    alike = sentences(result.model_copy(update={"sealed_gain_nats": -1.0, "gap": gap}))
    assert "forecasts get better by it" not in alike[2]
    open_ended = {"verdict": "unknown", "effects": [], "rounds": []}
    assert "Chance" not in sentences(result.model_copy(update=open_ended))[2]
    outdone = {"verdict": "unknown", "effects": [], "is_outdone": True}
    assert "not on a search" in sentences(result.model_copy(update=outdone))[2]
    nothing = sentences(concluded(Line(bend=0.0)))
    assert nothing[1].startswith("Does it matter? No.")
    assert "names something; this one did not" in nothing[2]


def test_three_episodes_are_too_few():
    with pytest.raises(Exception, match="at least 4"):
        concluded(Line(bend=0.4, episodes=3))


def _left(result, kind, path):
    """What a step of the same logs would have left."""
    fields = {field: getattr(result, field) for field in kind.model_fields}
    kind(**fields | {"key": "k"}).write(path)


def test_steps_in_a_folder_tell_what_they_tell_without_one(bent, tmp_path, monkeypatch):
    line, result = bent
    _left(result, Answer, tmp_path / "name.json")
    monkeypatch.setattr(workflow, "named", None)  # what has run is not run again
    told = run(Added(line, tmp_path, "k", 0.5), "close")
    assert (told.gap, told.where) == (result.gap, result.where)
    assert told.effects == result.effects
    left = json.loads((tmp_path / "name.json").read_text())
    assert left["rules"] == asdict(RULES)  # every number that decided is there to be read
    assert read(tmp_path / "name.json", Answer, "other logs") is None


@pytest.mark.parametrize(
    ("file", "damage", "says"),
    [
        (
            "find.json",
            lambda told: told | {"version": 0},
            f"version 0; this program reads {VERSION}",
        ),
        ("find.json", lambda told: told | {"where": [{"low": "x"}]}, "where.0.channel is missing"),
        ("name.json", lambda told: told | {"base_theta": {}}, "not the parameters of its fit"),
        ("name.json", lambda told: told | {"found_theta": {}}, "not the parameters of its fit"),
        ("name.json", lambda told: told | {"verdict": "perhaps"}, "verdict = 'perhaps'"),
        ("name.json", lambda told: told | {"effects": [], "x": 1}, "x is not known"),
    ],
)
def test_a_file_that_no_step_wrote_is_refused_in_a_sentence(bent, tmp_path, file, damage, says):
    line, result = bent
    _left(result, Disagreements, tmp_path / "find.json")
    _left(result, Answer, tmp_path / "name.json")
    path = tmp_path / file
    path.write_text(json.dumps(damage(json.loads(path.read_text()))))
    with pytest.raises(UnusableInput, match="delete it to run the step anew") as error:
        Added(line, tmp_path, "k", 0.5).show()
    assert says in str(error.value)
    assert str(error.value).startswith(str(path))


def test_a_search_does_not_begin_from_a_fit_without_its_parameters(bent, tmp_path):
    line, result = bent
    path = tmp_path / "find.json"
    _left(result, Disagreements, path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"theta": {}}))
    with pytest.raises(UnusableInput, match=r"find\.json: not the parameters of its fit"):
        Added(line, tmp_path, "k", 0.5).name()
