"""The first screen: a person who knows no nats reads what it costs, how sure it is, what to do."""

import re

import pytest
from fabricated_artefacts import summary

from wakedeploy.gap.report.first_screen import first_screen
from wakedeploy.gap.report.summary import account

WORTH = {
    "matters": True,
    "confirmed": True,
    "force_n": 0.037,
    "tracking_m": {"value": 0.0014, "low": 0.0011, "high": 0.0017},
    "removed": {
        "0.25 s ahead": {"share": 0.12, "low": 0.08, "high": 0.16},
        "1 s ahead": {"share": 0.34, "low": 0.2, "high": 0.5},
    },
}
NAMED = {
    "verdict": "named",
    "flights": 7,
    "effects": [{"name": "crosswind-offset", "confidence": 0.97, "worth": WORTH}],
}
GAP = {
    "height 0.25 s ahead": {"before": 0.0052, "after": 0.0052, "noise_floor": 0.005, "unit": "m"}
}


def asked(result) -> dict[str, str]:
    return dict(first_screen(summary(result)))


def test_what_matters_is_told_in_newtons_millimetres_and_per_cent() -> None:
    told = asked(NAMED)
    assert told["Does it matter?"] == (
        "Yes: it makes 37 mN, 1.4 mm of height and 34 % of the squared forecast error 1 s ahead."
    )
    assert told["How sure is that?"].startswith("97 % sure. Flights that took no part")
    assert told["What next?"] == "Simulate and train with the corrected rig file."


def test_what_is_too_small_leaves_the_rig_file_as_it_is() -> None:
    small = {**NAMED["effects"][0], "worth": WORTH | {"matters": False, "force_n": 0.004}}
    told = asked(NAMED | {"effects": [small]})
    assert told["Does it matter?"].startswith("No: it makes 4 mN")
    assert told["What next?"].startswith("Nothing")


def test_where_nothing_is_missing_the_error_stands_beside_the_noise() -> None:
    told = asked({"verdict": "none", "flights": 7, "gap": GAP})
    assert "5.2 mm" in told["Does it matter?"]
    assert "noise alone gives 5.0 mm" in told["Does it matter?"]
    assert told["What next?"].startswith("Nothing")


def test_a_rig_file_that_the_flights_contradict_is_no_rig_file_to_use_as_it_is() -> None:
    """Nothing is missing once thrust is a tenth less: then the file is off, or the mass."""
    bent = {"name": "thrust.sufferer.scale", "fitted": 0.91, "stated": 1.0, "spread": 0.03,
            "away_sd": 3.0}  # fmt: skip
    result = {"verdict": "none", "flights": 7, "gap": GAP, "calibration": [bent]}
    told = asked(result)
    assert told["Does it matter?"].startswith("No effect does. But the rig file forecasts")
    assert "only with `thrust.sufferer.scale` as fitted to these flights" in told["Does it matter?"]
    assert told["What next?"].startswith("Calibrate `thrust.sufferer.scale` again")
    assert "Weigh the vehicle" in told["What next?"]
    assert (
        "But its calibration is off: thrust.sufferer.scale is 1 and should be 0.91."
        in account(summary(result)).splitlines()[0]
    )


def test_halves_that_disagree_ask_for_more_flights() -> None:
    assert "fly more" in asked(NAMED | {"repeated": {"agree": False}})["How sure is that?"]
    assert "says the same" in asked(NAMED | {"repeated": {"agree": True}})["How sure is that?"]


def test_each_verdict_says_what_an_effect_does_before_its_name() -> None:
    small = {**NAMED["effects"][0], "worth": WORTH | {"matters": False}}
    pair = {"verdict": "class", "class": ["wake-width", "wake-decay"]}
    near = {"verdict": "unknown", "closest": "range-drift"}
    for result in (NAMED, NAMED | {"effects": [small]}, pair, near):
        headline = account(summary(result)).splitlines()[0]
        phrases = re.findall(r"([\w '-]+) \(`[\w-]+`", headline)
        assert phrases
        assert all(len(phrase.split()) > 5 for phrase in phrases)


def test_of_two_effects_each_answer_has_its_name() -> None:
    other = NAMED["effects"][0] | {"name": "range-drift"}
    told = asked(NAMED | {"effects": [*NAMED["effects"], other]})
    assert "`range-drift` makes 37 mN" in told["Does it matter?"]
    assert "97 % sure of `range-drift`" in told["How sure is that?"]


def test_of_too_few_flights_nothing_is_asked() -> None:
    assert first_screen(summary(NAMED | {"flights": 2})) == []
    assert first_screen(summary({})) == []


@pytest.mark.parametrize(
    "result",
    [
        NAMED,
        {"verdict": "class", "class": ["wake-width", "wake-decay"], "worth": WORTH, "flights": 7},
        {
            "verdict": "unknown",
            "flights": 7,
            "explainable": {"share": 0.2, "low": 0.1, "high": 0.3},
        },
        {"verdict": "none", "flights": 7, "gap": GAP, "withdrawn": [{"name": "range-drift"}]},
    ],
)
def test_no_verdict_needs_statistics_to_be_read(result) -> None:
    screen = account(summary(result)).partition("\n\n")[0]
    assert len(screen.splitlines()) >= 3
    assert not re.search(r"nats|likelihood|sd|posterior|q <|whit", screen)
