"""Predictions are held against the force that was found when they came due."""

import itertools
import math

import numpy as np
import pytest

from runtime.loop.doubt import FLOOR_SHARE, FORCE_FLOOR_N, Doubter

LEAD_S, DT_S, WEIGHT_N = 0.09, 1.0 / 32.0, 5.0


def gust_n(t_s):
    """A wake's force [N] that comes and goes."""
    return -1.0 + 1.0 * math.cos(2.0 * math.pi * 0.5 * t_s)


def doubts(predicted, force=gust_n, weight_n=WEIGHT_N, seconds=6.0):
    """Whether each tick doubts; `predicted` makes a prediction [N] of the true force."""
    doubter, found = Doubter(LEAD_S, weight_n), []
    for tick in range(round(seconds / DT_S)):
        t_s = tick * DT_S
        doubter.predicted(t_s, predicted(force(t_s + LEAD_S)))
        found.append(doubter.step(t_s, force(t_s)))
    return found


RNG = np.random.default_rng(0)
TURNS = itertools.cycle((1.0, -1.0))
WRONG = {
    "of wrong sign": lambda force_n: -force_n,
    "five times too large": lambda force_n: 5.0 * force_n,
    "2 N": lambda force_n: 2.0,
    "-20 N": lambda force_n: -20.0,
    "5 N and -5 N by turns": lambda force_n: 5.0 * next(TURNS),
    "noise": lambda force_n: 2.0 * float(RNG.standard_normal()),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_prediction_is_doubted_and_stays_so(wrong):
    found = doubts(WRONG[wrong])
    first_s = found.index(True) * DT_S
    assert first_s < 1.5
    assert all(found[round(2.0 / DT_S) :])


def test_a_prediction_that_is_right_or_nearly_so_is_believed():
    assert not any(doubts(lambda force_n: force_n))
    assert not any(doubts(lambda force_n: 0.7 * force_n))
    assert not any(doubts(lambda force_n: 0.0, force=lambda t_s: 0.0))


def test_an_error_below_the_floor_is_none():
    """A force for a sufferer of the rig's size, and for a small one a share of its weight."""
    calm = {"force": lambda t_s: 0.0}
    assert not any(doubts(lambda force_n: 0.9 * FORCE_FLOOR_N, **calm))
    assert any(doubts(lambda force_n: 1.1 * FORCE_FLOOR_N, **calm))
    small = {"weight_n": 1.0, **calm}
    assert not any(doubts(lambda force_n: 0.9 * FLOOR_SHARE, **small))
    assert any(doubts(lambda force_n: 1.1 * FLOOR_SHARE, **small))


def test_a_model_that_is_right_again_is_believed_again():
    sign = iter([-1.0] * 96 + [1.0] * 96)
    found = doubts(lambda force_n: next(sign) * force_n)
    assert found[95]
    assert not found[-1]


def test_what_is_no_number_changes_no_doubt():
    doubter = Doubter(LEAD_S, WEIGHT_N)
    for tick in range(64):
        doubter.predicted(tick * DT_S, math.nan)
        assert not doubter.step(tick * DT_S, 1.0)
        assert doubter.doubt.whole_n2 == 0.0
