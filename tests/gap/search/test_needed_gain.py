"""What an effect has to gain: more than chance, or a little in block after block."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear_model import Linear

from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search import needed_gain, withdrawal
from wakedeploy.gap.search.artefacts import Round
from wakedeploy.gap.search.needed_gain import Chance, is_shared, needed_nats
from wakedeploy.gap.search.outcome import Named
from wakedeploy.gap.search.withdrawal import still_needed

QUIET = 4.0  # nats that chance brings without the loud moments
CHANCE = Chance(26.0, QUIET)


def _effect(*gains: float, prior_gain: float = 0.0) -> Candidate:
    return Candidate("drag@speed_mps", SimpleNamespace(), np.array(gains), prior_gain)


def test_what_gains_in_block_after_block_needs_no_more_than_chance_brings_without_loud_moments():
    steady = _effect(1.1, 2.1, 1.6, 1.3, 1.4, 0.4, 2.4, 0.2, 1.8)
    assert needed_nats(steady, CHANCE, 24) == QUIET
    assert is_shared(steady, QUIET)
    assert not is_shared(steady, CHANCE.nats)


@pytest.mark.parametrize(
    "gains",
    [
        (3.0, 2.9, 66.9, 1.9, 2.6, -4.8, 1.7, 3.3, 3.1, 3.3, 3.0, 3.2),  # one moment, and its noise
        (1.1, -2.1, 1.6, -1.3, 1.4, 0.4, -0.4, 0.2, 1.8),
        (1.5, 1.4, 1.6),  # so few blocks agree by chance
        (0.41, 0.39, 0.4, 0.42, 0.4, 0.38, 0.4, 0.41, 0.4),  # as much as quiet noise brings
        (0.0,) * 9,  # moves no output
        (-1.0,) * 9,
    ],
)
def test_anything_else_has_to_gain_more_than_chance(gains):
    assert needed_nats(_effect(*gains), CHANCE, 24) == CHANCE.nats


def test_what_priors_say_of_parameters_is_not_steady():
    bent = _effect(*np.full(9, 0.01) + 0.001 * np.arange(9), prior_gain=5.0)
    assert bent.gain_nats > QUIET
    assert needed_nats(bent, CHANCE, 24) == CHANCE.nats


def test_the_more_effects_are_tried_the_steadier_one_has_to_be():
    effect = _effect(1.0, 2.0, 0.1, 1.5, -0.2, 1.2, 2.2, 0.8)
    assert needed_nats(effect, CHANCE, 1) == QUIET
    assert needed_nats(effect, CHANCE, 500) == CHANCE.nats


def test_one_effect_that_is_asked_whether_it_is_needed_may_gain_less_steadily():
    """It is not the best of all: one in twenty that are superfluous may seem needed."""
    effect = _effect(5.4, 2.6, -0.6, 2.5, -0.6, 3.2, 0.2, 1.4, -1.3, 3.3, -0.5, 2.2)  # p = 0.015
    assert needed_nats(effect, CHANCE, 33) == CHANCE.nats
    assert needed_nats(effect, CHANCE, alarms=RULES.false_alarms) == QUIET
    lucky = _effect(9.0, 2.6, -0.6, 2.5, -2.6, 3.2, -3.2, 1.4, -1.3, 3.3, -2.5, 2.2)
    assert needed_nats(lucky, CHANCE, alarms=RULES.false_alarms) == CHANCE.nats


@pytest.mark.whole
def test_gains_of_noise_are_seldom_steady():
    """Of searches over forty effects without any truth, about one in a hundred has a steady one."""
    rng = np.random.default_rng(3)
    alarms = sum(
        any(
            needed_nats(_effect(*rng.standard_t(4, 12)), CHANCE, 40) < CHANCE.nats
            for _ in range(40)
        )
        for _ in range(250)
    )
    assert alarms <= 8


@pytest.mark.parametrize(
    ("quiet_nats", "fewest", "left", "kept"),
    [
        (0.5, 5, 0.9, ("a", "c")),
        (1000.0, 5, 0.9, ("c",)),
        (1000.0, 5, 0.3, ("c",)),
        (0.5, 99, 0.9, ("c",)),
        (0.5, 99, 0.3, ("a", "c")),
    ],
)
def test_what_is_steady_stays_beside_what_was_found_after_it(
    monkeypatch, quiet_nats, fewest, left, kept
):
    """Loud moments would ask a thousand nats of it; without them chance brings little.

    So does what most of the forecasts' error is without.
    """
    monkeypatch.setattr(needed_gain, "RULES", replace(RULES, fewest_blocks=fewest))
    monkeypatch.setattr(withdrawal, "removes_most", lambda model, before, after: left < 0.5)
    model = Linear({"gain": 0.4, "a": 0.5, "c": 0.6})
    episodes = range(model.episodes)
    found = fit(model, ("a", "c"), episodes)
    searched = Round(given=[], threshold_nats=1000.0, steady_nats=quiet_nats, ranking=[])
    outcome = Named(model, fit(model, (), episodes), found, [searched])
    assert still_needed(model, outcome).found.hypothesis == kept
