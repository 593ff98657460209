"""A class that logs leave open: what to record, said alike by all, and a member that is added."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from wakedeploy.cli import main
from wakedeploy.gap.search.artefacts import Answer
from wakedeploy.gap.systems.answers import folder
from wakedeploy.gap.systems.planning.known import stated_answer, stated_sizes
from wakedeploy.gap.systems.planning.planned import Planned

SLIDER = """
from wakedeploy import Constant, Input, Output, Port, System


class Slider(System):
    rate_hz = 50.0
    inputs = [Input("force_n", "N", low=-5.0, high=5.0)]
    states = {"position_m": "m", "speed_mps": "m/s"}
    outputs = [Output("position_m", "m", noise=1e-3)]
    constants = [Constant("mass_kg", 2.0, spread=0.1)]
    ports = [Port.input("force_n", kinds=["dead-time", "lag"])]

    def export(self, answer, out):
        return [f"Exported {effect.name}." for effect in answer.effects]

    def derivative(self, state, inputs, c):
        force = inputs.force_n - 30.0 * state.position_m - 3.0 * state.speed_mps
        return {"position_m": state.speed_mps, "speed_mps": force / c.mass_kg}
"""
DELAY_S = 0.04
LAG, DEAD_TIME = "lag@force_n", "dead-time@force_n"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A slider that is late, and a log of one slow wave, which a lag would explain as well."""
    path = tmp_path_factory.mktemp("open")
    (path / "slider.py").write_text(SLIDER)
    random = np.random.default_rng(0)
    finer, rows, place_m, speed = 20, [], 0.0, 0.0
    step_s = 1.0 / 50.0 / finer
    for k in range(1200 * finer):
        time_s = k * step_s
        if k % finer == 0:
            shown = place_m + 1e-3 * random.standard_normal()
            rows.append((time_s, 4.0 * math.sin(2.5 * time_s), shown))
        force = 4.0 * math.sin(2.5 * max(time_s - DELAY_S, 0.0))
        speed += step_s * (force - 30.0 * place_m - 3.0 * speed) / 2.0
        place_m += step_s * speed
    header = "time_s,force_n,position_m"
    np.savetxt(path / "log.csv", rows, "%.9g", ",", header=header, comments="")
    return path


@pytest.fixture(scope="module")
def told(place: Path) -> Callable[..., Result]:
    def run(step: str, *more: str) -> Result:
        words = ["--system", str(place / "slider.py"), "--measured", str(place / "log.csv")]
        return CliRunner().invoke(main, ["gap", step, *words, "--out", str(place / "gap"), *more])

    return run


@pytest.fixture(scope="module")
def closed(told: Callable[..., Result]) -> Result:
    return told("close")


def _planned(place: Path) -> Planned:
    return Planned.model_validate(json.loads((place / "gap" / "plan.json").read_text()))


@pytest.mark.slow
def test_close_says_what_plan_says(
    place: Path, told: Callable[..., Result], closed: Result
) -> None:
    assert closed.exit_code == 0, closed.output
    assert "The logs cannot say which." in closed.stdout
    planned = _planned(place)
    assert {LAG, DEAD_TIME} <= set(planned.rivals)
    assert planned.splits
    assert f"What next? {planned.sentence} Then ask again" in closed.stdout
    again = told("plan", "--write-input", str(place / "next.csv"))
    assert again.exit_code == 0, again.output
    assert planned.sentence in again.stdout
    rows = np.loadtxt(place / "next.csv", delimiter=",", skiprows=1)
    assert np.abs(rows[:, 1]).max() <= 5.0


@pytest.mark.slow
def test_sizes_are_those_with_which_the_class_was_left_open(place: Path, closed: Result) -> None:
    """Beside the member that was taken nothing is left for another, whose size is 0 there."""
    from wakedeploy.gap.systems.files import read_plain, read_system
    from wakedeploy.gap.systems.likelihood.logs import LogModel

    system = read_system(place / "slider.py")
    model = LogModel(system, [read_plain(place / "log.csv", system)])
    answer = stated_answer(place / "gap")
    assert isinstance(answer, Answer)
    sizes = stated_sizes(place / "gap", answer, model, (LAG, DEAD_TIME))
    for (size,) in sizes.values():
        assert 0.3 * DELAY_S < size < 1.5 * DELAY_S


@pytest.mark.slow
def test_a_member_is_added_in_the_place_of_its_class(
    place: Path, told: Callable[..., Result], closed: Result
) -> None:
    assert closed.exit_code == 0
    for name in (LAG, DEAD_TIME):
        added = told("add", "--effect", name)
        assert added.exit_code == 0, added.output
        assert f"Added as you asked: {name}" in added.stdout
        assert f"Exported {name}." in added.stdout
        text = (place / "gap" / "correction.toml").read_text()
        assert text.count("[[effect]]") == 1
        assert f'name = "{name}"' in text
    wrong = told("add", "--effect", "command-latency")
    assert wrong.exit_code == 2
    assert f"no effect 'command-latency'; there are: {DEAD_TIME}, {LAG}" in wrong.stderr


@pytest.mark.slow
def test_where_no_input_splits_the_class_close_promises_none(
    place: Path, told: Callable[..., Result], closed: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert closed.exit_code == 0
    kept = _planned(place)
    none = kept.model_copy(update={"input": "", "tried": 0})
    none.write(place / "gap" / "plan.json")
    again = told("close")
    assert "What next? Record none: every input that was tried takes the outputs" in again.stdout
    assert f"puts `{LAG}` in its place" in again.stdout or DEAD_TIME in again.stdout
    assert "--effect" in again.stdout.splitlines()[-1]
    assert "gap plan" not in again.stdout
    monkeypatch.setattr(folder, "commanded", lambda model: ())
    (place / "gap" / "plan.json").unlink()
    again = told("close")
    assert "No input can be commanded, so that none can be planned." in again.stdout


def test_a_system_that_runs_away_is_not_to_be_given_larger_inputs() -> None:
    told = Planned(domain="slider", rivals=["a", "b"], tried=0).sentence
    assert told.startswith("Record none: every input that was tried takes the outputs far beyond")
    assert "narrow the limits" in told
    assert "under its controller" in told


def test_members_that_nothing_tells_apart_are_said_to_be_alike() -> None:
    twins = Planned(domain="slider", rivals=["a", "b"], tried=6, alike=(("a", "b"),))
    assert "No input that was tried tells apart `a` and `b`." in twins.sentence
    assert twins.sentence.startswith("Record none of these: they tell nothing of it.")
    third = twins.model_copy(
        update={"rivals": ["a", "b", "c"], "input": "waves", "moved": ("u",), "nats": 2.0,
                "logs": 3, "seconds": 30.0}
    )  # fmt: skip
    assert third.sentence.startswith("Record waves on u for 30 s.")
    assert "takes 3 such logs. No input that was tried tells apart `a` and `b`." in third.sentence
    both = third.model_copy(update={"alike": (("a", "b"), ("a", "c"))})
    assert "tried tells apart `a` and `b`, nor `a` and `c`." in both.sentence


@pytest.mark.parametrize(
    ("nats", "logged_nats", "said"),
    [
        (3.66, 0.631, "That tells 5.8 times as much as the present logs do in that time."),
        (8270.0, 0.02, "That tells over 100 times as much as the present logs do in that time."),
        (
            40.0,
            44.0,
            "That tells 0.91 times as much as the present logs do in that time: another log like "
            "those tells more.",
        ),
        (2.0, 0.0, "The present logs tell nothing of it."),
    ],
)
def test_what_an_input_tells_is_said_by_what_the_present_logs_tell(
    nats: float, logged_nats: float, said: str
) -> None:
    """Nobody knows what 0.115 nats are."""
    plan = Planned(
        domain="rover", rivals=["a", "b"], tried=6, input="waves", moved=("u",), seconds=20.0,
        nats=nats, logged_nats=logged_nats, logs=2,
    )  # fmt: skip
    assert plan.sentence == (
        f"Record waves on u for 20 s. {said} To decide it with margin takes 2 such logs."
    )
    none = plan.model_copy(update={"input": "", "nats": 0.1, "logged_nats": 0.2})
    assert none.sentence.startswith(
        "Record none of these: the best tells 0.50 times as much as the present logs do in that "
        "time. If those do not decide it"
    )
    assert "nats" not in plan.sentence + none.sentence


def test_an_effect_that_is_misspelt_is_told_before_any_fit(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fitted(*_: object) -> None:
        raise AssertionError("fitted before the name was looked at")

    monkeypatch.setattr("wakedeploy.gap.search.judging.fitted_base", fitted)
    words = ["--system", str(place / "slider.py"), "--measured", str(place / "log.csv")]
    told = CliRunner().invoke(main, ["gap", "plan", *words, "--class", "lug@force_n"])
    assert "no effect 'lug@force_n'" in told.stderr


def test_a_rig_takes_no_effect_of_a_system(tmp_path: Path) -> None:
    (tmp_path / "flight.mcap").write_bytes(b"")
    words = ["--rig", str(tmp_path / "rig.toml"), "--measured", str(tmp_path / "flight.mcap")]
    told = CliRunner().invoke(
        main, ["gap", "add", *words, "--out", str(tmp_path / "gap"), "--effect", LAG]
    )
    assert told.exit_code == 2
    assert "command-latency" in told.stderr
