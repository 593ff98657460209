"""Whether two halves of a system's logs, each by itself, give the same answer."""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.search import repeatability
from wakedeploy.gap.search.artefacts import Half, Ranked, Result, Round
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.outcome import WORSE, Named, verdict_of
from wakedeploy.gap.search.repeatability import agree, halves_of, repeated
from wakedeploy.gap.search.results import answer_of
from wakedeploy.gap.search.weighing import Weight
from wakedeploy.gap.systems.answers.folder import OwnFolder
from wakedeploy.gap.systems.answers.words import sentences
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.workflow import run

RATE = 50.0
COEFFICIENT = 4.0  # N/(m/s)
HOLDS = 40  # stretches of one force in a log
FRICTION = "viscous-friction@speed_mps"


class Slider(System):
    """A mass on a rail."""

    rate_hz = RATE
    inputs: ClassVar = [Input("force_n", "N")]
    states: ClassVar = {"speed_mps": "m/s"}
    outputs: ClassVar = [Output("speed_mps", "m/s", noise=2e-3)]
    constants: ClassVar = [Constant("mass_kg", 2.0, spread=0.02)]
    ports: ClassVar = [
        Port.force("speed_mps", inertia="mass_kg", kinds=["viscous-friction", "offset"])
    ]

    def derivative(self, state, inputs, c):
        return {"speed_mps": inputs.force_n / c.mass_kg}


def slid(friction, seed=4, holds=HOLDS):
    """A log (n,) of the mass; `friction` [N/(m/s)] is a number, or one of each hold (h,)."""
    rng = np.random.default_rng(seed)
    force = np.repeat(rng.uniform(-6.0, 6.0, holds), 16)
    coefficient = np.repeat(np.broadcast_to(friction, holds), 16)
    speed, shown = 0.0, np.empty(len(force))
    for k, push in enumerate(force):
        shown[k] = speed
        for _ in range(10):
            disturbed = push + 0.1 * rng.standard_normal()
            speed += (disturbed - coefficient[k] * speed) / 2.0 / RATE / 10
    shown += 2e-3 * rng.standard_normal(len(force))
    columns = {"force_n": force, "speed_mps": shown}
    return Recording(f"made-{seed}", np.arange(len(force)) / RATE, columns)


def searched(friction):
    """What is named in a log."""
    model = LogModel(Slider(), [slid(friction)])
    return named(model, fitted_base(model))


def test_halves_agree_about_what_acts_all_along():
    told = repeated(searched(COEFFICIENT))
    assert told.agree
    for half in told.halves:
        assert (half.leading, half.parameter) == (FRICTION, "coefficient")
        assert half.low < COEFFICIENT < half.high
        assert half.gain_nats > 3.0
    assert [half.episodes for half in told.halves] == [
        [f"made-4 {k}/16" for k in range(1, 9)],
        [f"made-4 {k}/16" for k in range(9, 17)],
    ]


def test_halves_do_not_agree_about_what_acts_in_one_of_them():
    outcome = made(np.repeat([0.0, COEFFICIENT], HOLDS // 2), FRICTION)
    told = repeated(outcome)
    assert not told.agree
    smooth, rubbing = told.halves
    assert (smooth.leading, rubbing.leading) == (FRICTION, FRICTION)
    assert smooth.low < 0.0 < smooth.high < 1.0 < rubbing.low < COEFFICIENT < rubbing.high
    (line,) = [s for s in sentences(answer_of(outcome, again=told)) if "The two halves" in s]
    assert line.strip().startswith("The two halves of the logs do not agree: viscous-friction@")
    assert line.endswith("More logs would tell.")


def test_where_nothing_was_named_there_is_nothing_to_repeat():
    outcome = searched(0.0)
    assert verdict_of(outcome) == "none"
    assert repeated(outcome) is None


def test_halves_of_too_few_blocks_are_not_asked():
    """Five make a search, and one of their halves has two."""
    model = LogModel(Slider(), [slid(COEFFICIENT, holds=13)])
    assert model.episodes == 5
    base = fitted_base(model)
    found = fit(model, (FRICTION,), base.episodes)
    assert repeated(Named(model, base, found, [])) is None


def test_many_logs_are_halved_one_by_one_and_few_in_time():
    many = LogModel(Slider(), [slid(0.0, seed, holds=8) for seed in range(7)])
    assert {many.log_of(e) for e in halves_of(many)[0]} == {0, 2, 4, 6}
    assert {many.log_of(e) for e in halves_of(many)[1]} == {1, 3, 5}
    few = LogModel(Slider(), [slid(0.0, seed, holds=20) for seed in range(2)])
    first, other = ([few.blocks[e] for e in half] for half in halves_of(few))
    assert len(first) + len(other) == few.episodes
    for log in (0, 1):
        assert max(b.stop for b in first if b.log == log) <= min(
            b.start for b in other if b.log == log
        )


@pytest.mark.slow
def test_the_folder_keeps_what_halves_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """It is told in the detail and on the page, read again, and asked once."""
    model = LogModel(Slider(), [slid(COEFFICIENT)])
    first = run(OwnFolder(model, tmp_path), "close")
    assert isinstance(first, Result)
    assert first.repeated.agree
    said = sentences(first)
    assert any(s.endswith("Each half of the logs by itself says the same.") for s in said)
    (line,) = [s for s in said if "Both halves of the logs say so by themselves:" in s]
    assert f"{FRICTION} (coefficient from " in line
    asked: list[object] = []
    monkeypatch.setattr(repeatability, "halves_of", asked.append)
    again = run(OwnFolder(model, tmp_path), "close")
    assert again.repeated == first.repeated
    assert not asked


def half(**changed):
    told = {"leading": "drag", "gain_nats": 9.0, "near": ["drag"], "parameter": "coefficient",
            "low": 1.0, "high": 2.0, "unit": "N", "episodes": []}  # fmt: skip
    return Half(**told | changed)


@pytest.mark.parametrize(
    ("other", "agreed"),
    [
        (half(low=1.9, high=3.0), True),
        (half(low=2.1, high=3.0), False),
        (half(gain_nats=-1.0), False),
        (half(leading="spring"), False),
        (
            half(leading="lag", low=7.0, high=8.0),
            True,
        ),  # another member, of which sizes say nothing
    ],
)
def test_halves_agree_where_names_gains_and_sizes_do(other, agreed):
    assert agree(half(), other, {"drag", "lag"}) is agreed


def made(friction, *found, refused=()):
    """An answer that names effects of a log, some turned down although they gain most."""
    model = LogModel(Slider(), [slid(friction)])
    base = fitted_base(model)
    ranking = [
        Ranked(name=name, gain_nats=90.0, needed_nats=3.0, interval=(80.0, 100.0), parameters={},
               judged=WORSE if name in refused else "")
        for name in model.effects
    ]  # fmt: skip
    first = Round(given=[], threshold_nats=3.0, steady_nats=3.0, ranking=ranking, chosen=found[0])
    weights = dict.fromkeys(found, Weight(0.5, 0.4, 0.6))
    return Named(model, base, fit(model, found, base.episodes), [first], weights=weights)


def test_each_half_says_what_it_leads_with_where_that_was_not_found():
    told = repeated(made(COEFFICIENT, "offset@speed_mps"))
    assert not told.agree
    assert [each.leading for each in told.halves] == [FRICTION, FRICTION]


def test_what_the_search_turned_down_is_no_rival():
    told = repeated(made(COEFFICIENT, "offset@speed_mps", refused=(FRICTION,)))
    assert {each.leading for each in told.halves} == {"offset@speed_mps"}


def test_a_member_of_the_class_says_the_same():
    outcome = replace(made(COEFFICIENT, "offset@speed_mps"), rivals=("offset@speed_mps", FRICTION))
    assert repeated(outcome).agree


def test_what_else_was_named_stands_beside_the_first_effect():
    """The friction explains most; it is no rival of the offset that was named with it."""
    told = repeated(made(COEFFICIENT, "offset@speed_mps", FRICTION))
    assert {each.leading for each in told.halves} == {"offset@speed_mps"}
