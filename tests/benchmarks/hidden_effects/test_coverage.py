"""Coverage: what is hidden is spread over plants, strengths and signs, and is found again."""

import numpy as np
import pytest

from benchmarks.hidden_effects.coverage import COMMON, HARD, STRENGTHS_NATS, cases, fitted

EFFECTS = (*COMMON, *HARD)


def test_every_effect_is_hidden_as_often_in_both_plants_and_at_many_strengths() -> None:
    made = cases(EFFECTS, 20)
    assert len({case.name for case in made}) == len({case.seed for case in made}) == 260
    for effect in EFFECTS:
        of_effect = [case for case in made if case.truth_names == (effect,)]
        assert [case.plant for case in of_effect].count("second") == 10
        strengths = [case.nats for case in of_effect]
        assert min(strengths) >= STRENGTHS_NATS[0]
        assert max(strengths) <= STRENGTHS_NATS[1]
        assert np.ptp(strengths) > 60


def test_an_effect_that_goes_both_ways_is_hidden_both_ways() -> None:
    offsets = [case.effects["crosswind-offset"]["offset_m"] for case in cases(EFFECTS[8:9], 20)]
    assert min(offsets) < 0 < max(offsets)


@pytest.mark.slow
def test_a_lag_is_fitted_without_a_word_of_the_truth() -> None:
    line = fitted(cases(("spool-lag-sufferer",), 1)[0])
    assert line["gain_nats"] > 20
    for parameter in line["parameters"].values():
        width = parameter["high"] - parameter["low"]
        assert abs(parameter["value"] - parameter["truth"]) < 2 * width
