"""Flights of the virtual gantry, answered and judged: what matters, what does not, and halves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recorded import RIG, flown, with_effects

from wakedeploy.gap.systems.gantry import find_name_add_show
from wakedeploy.gap.systems.gantry.artefacts import Name
from wakedeploy.gap.systems.gantry.find_name_add_show import Case, _judged, find, name, write_answer
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.explainable_error import explainable
from wakedeploy.gap.systems.gantry.search.naming import fitted_base, name_effects, with_terms
from wakedeploy.gap.systems.gantry.search.outcome import Thresholds
from wakedeploy.gap.systems.gantry.search.repeatability import FEWEST, repeated

LIMITS = Thresholds(6.0, 8.0, 8.0, 36.0, 0.02, 0.02, 0.003)
TRIED = ("crosswind-offset", "added-mass", "range-drift")
SHIFTED = with_effects(crosswind_offset={"offset_m": (0.06, "m")})


@pytest.fixture(scope="module")
def shifted():
    """The search's answer about a shifted wake, and a sealed flight."""
    flights = [flown(seed, SHIFTED) for seed in (51, 52, 53)]
    answer = name_effects(RIG, GantryModel(RIG, flights), LIMITS, candidates=TRIED)
    return answer, flights, flown(54, SHIFTED)


@pytest.mark.slow
def test_an_effect_that_matters_is_told_to_and_is_added(shifted, tmp_path) -> None:
    answer, flights, sealed = shifted
    case = Case(RIG, tuple(flights), (sealed,), LIMITS)
    told = _judged(case, tmp_path, answer, write_answer(answer, tmp_path, 0.0), lambda *_: None)
    assert told.verdict == "named"
    (effect,) = told.effects
    assert effect.name == "crosswind-offset"
    worth = effect.worth
    assert worth.matters
    assert worth.removed["0.25 s ahead"].share > 0.05
    assert worth.force_n > 0.02
    assert 0.0 < worth.tracking_m.low <= worth.tracking_m.value
    assert told.to_add == told.effects
    assert told.repeated is None  # four flights have no halves of three


@pytest.mark.slow
def test_effects_come_back_where_the_expression_in_their_place_is_not_borne_out(
    shifted, tmp_path, monkeypatch
) -> None:
    effects, flights, sealed = shifted
    case = Case(RIG, tuple(flights), (sealed,), LIMITS)
    expressed = replace(effects, verdict="unknown", instead=effects)

    def of_little_use(case, out, answer, named, progress):
        if answer is expressed:
            return named.model_copy(update={"verdict": "none"})
        return _judged(case, out, answer, named, progress)

    monkeypatch.setattr(find_name_add_show, "name_effects", lambda *_, **__: expressed)
    monkeypatch.setattr(find_name_add_show, "_judged", of_little_use)
    find(case, tmp_path)
    told = name(case, tmp_path)
    assert [e.name for e in told.effects] == ["crosswind-offset"]
    assert Name.model_validate_json((tmp_path / "name.json").read_text()) == told


@pytest.mark.parametrize(
    ("verdict", "of_effects", "told", "kept"),
    [
        ("unknown", "class", "formula unknown", "formula"),  # borne out: nothing else is asked
        ("none", "class", "effects class", "effects"),
        ("none", "none", "formula none", "formula"),
    ],
)
def test_effects_are_judged_where_what_took_their_place_is_not_borne_out(
    tmp_path, monkeypatch, verdict, of_effects, told, kept
) -> None:
    """The order of the steps alone; the one above has real flights."""
    effects = SimpleNamespace(text="effects", verdict=of_effects, instead=None)
    formula = SimpleNamespace(text="formula", verdict=verdict, instead=effects)
    fits, written = [], []
    fakes = {
        "required": lambda *_: SimpleNamespace(find=None),
        "name_effects": lambda *_, **__: formula,
        "write_answer": lambda answer, *_: answer,
        "_judged": lambda case, out, answer, named, progress: written.append(answer) or answer,
        "write": lambda out, named: written.append(named) or named,
    }
    for part, fake in fakes.items():
        monkeypatch.setattr(find_name_add_show, part, fake)
    monkeypatch.setattr(
        find_name_add_show.Found,
        "of",
        lambda answer: SimpleNamespace(write=lambda out: fits.append(answer)),
    )
    case = SimpleNamespace(
        rig=SimpleNamespace(sha256=""), recordings=[], base=(None, None), flights=range(9),
        thresholds=LIMITS, share=0.0,
    )  # fmt: skip
    answer = name(case, tmp_path)
    assert f"{answer.text} {answer.verdict}" == told
    assert written[-1].text == kept  # what name.json ends as
    assert [f.text for f in fits] == (["formula"] if told == "formula none" else [])


@pytest.mark.slow
def test_halves_of_the_flights_agree_on_a_strong_effect(shifted) -> None:
    answer, flights, sealed = shifted
    others = [sealed, *(flown(seed, SHIFTED) for seed in (55, 56))]
    assert len(flights) + len(others) == FEWEST
    assert repeated(answer, others[1:]) is None
    again = repeated(answer, others)
    assert again is not None
    assert again.agree
    assert all(half.low < 0.06 < half.high for half in again.halves)
    assert set(again.halves[0].flights).isdisjoint(again.halves[1].flights)


@pytest.mark.whole
def test_of_flights_that_lack_nothing_hardly_anything_could_be_explained() -> None:
    model, base = fitted_base(with_terms(GantryModel(RIG, [flown(51), flown(52)])))
    worth = explainable(model, base, None)
    assert worth.share < 0.05
    assert np.isfinite([worth.low, worth.high]).all()
    assert not worth.clearly
