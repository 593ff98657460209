"""What an effect has to gain: more than chance, or a little in block after block."""

from types import SimpleNamespace

import numpy as np
import pytest

from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.evident import is_shared, needed_nats

CHANCE = 26.0  # of a log with loud moments


def _effect(*gains: float) -> Candidate:
    return Candidate("drag@speed_mps", SimpleNamespace(), np.array(gains))


def test_what_gains_in_block_after_block_needs_no_more_than_the_least():
    steady = _effect(1.1, 2.1, 1.6, 1.3, 1.4, 0.4, 2.4, 0.2, 1.8)
    assert needed_nats(steady, CHANCE, 24) == RULES.least_nats
    assert is_shared(steady, RULES.least_nats)
    assert not is_shared(steady, CHANCE)


@pytest.mark.parametrize(
    "gains",
    [
        (3.0, 2.9, 66.9, 1.9, 2.6, -4.8, 1.7, 3.3, 3.1, 3.3, 3.0, 3.2),  # one moment, and its noise
        (1.1, -2.1, 1.6, -1.3, 1.4, 0.4, -0.4, 0.2, 1.8),
        (1.5, 1.4, 1.6),  # so few blocks agree by chance
        (0.0,) * 9,  # moves no output
        (-1.0,) * 9,
    ],
)
def test_anything_else_has_to_gain_more_than_chance(gains):
    assert needed_nats(_effect(*gains), CHANCE, 24) == CHANCE


def test_the_more_effects_are_tried_the_steadier_one_has_to_be():
    effect = _effect(1.0, 2.0, 0.1, 1.5, -0.2, 1.2, 2.2, 0.8)
    assert needed_nats(effect, CHANCE, 1) == RULES.least_nats
    assert needed_nats(effect, CHANCE, 500) == CHANCE


def test_a_threshold_below_the_least_stays():
    steady = _effect(*np.full(9, 1.0) + 0.1 * np.arange(9))
    assert needed_nats(steady, 2.0, 5) == 2.0


def test_gains_of_noise_are_seldom_steady():
    """Of searches over forty effects without any truth, about one in a hundred has a steady one."""
    rng = np.random.default_rng(3)
    alarms = sum(
        any(needed_nats(_effect(*rng.standard_t(4, 12)), CHANCE, 40) < CHANCE for _ in range(40))
        for _ in range(250)
    )
    assert alarms <= 8
