"""How much flights vary, against draws whose variation is known."""

import numpy as np
import pytest

from wakedeploy.gap.systems.gantry.reference.spread import farthest, variation


def test_the_interval_holds_the_true_variation_as_often_as_it_says() -> None:
    rng = np.random.default_rng(1)
    held, estimates = 0, []
    for _ in range(200):
        errors = rng.uniform(0.3, 1.0, 7)
        told = variation(2.0 * rng.standard_normal(7) + errors * rng.standard_normal(7), errors)
        held += told.low <= 2.0 <= told.high
        estimates.append(told.sd**2)
    assert held / 200 == pytest.approx(0.9, abs=0.06)
    assert np.mean(estimates) ** 0.5 == pytest.approx(2.0, rel=0.1)


def test_flights_that_differ_by_their_errors_alone_seldom_vary() -> None:
    rng = np.random.default_rng(2)
    errors = np.full(7, 0.5)
    sure = [variation(errors * rng.standard_normal(7), errors).is_sure for _ in range(300)]
    assert np.mean(sure) == pytest.approx(0.05, abs=0.03)


def test_two_flights_tell_no_variation() -> None:
    with pytest.raises(ValueError, match="2 flights"):
        variation(np.zeros(2), np.ones(2))


def test_among_flights_that_are_alike_one_is_seldom_called_odd() -> None:
    rng = np.random.default_rng(3)
    errors = np.full(7, 0.2)
    found = [
        farthest(rng.standard_normal(7) + errors * rng.standard_normal(7), errors, 7).p_value
        for _ in range(300)
    ]
    assert np.mean(np.array(found) < 0.05) < 0.08


def test_the_odd_one_is_found_with_its_distance() -> None:
    values = np.array([0.1, -0.2, 0.0, 5.0, 0.15, -0.1, 0.05])
    odd = farthest(values, np.full(7, 0.1), 21)
    assert (odd.flight, odd.p_value < 1e-3) == (3, True)
    assert odd.away == pytest.approx(5.0, abs=0.1)
