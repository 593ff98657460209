"""Lanes of a filter's step: each as if it were alone, whatever its neighbours do."""

import numpy as np
import pytest

from wakedeploy.physics.kalman import stepped

DT_S = 0.01


def _stepped(slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One state x' = slope x from 1 with variance 1, undisturbed, in a lane for each slope."""
    lanes = len(slopes)
    x, p = np.ones((1, lanes)), np.ones((1, 1, lanes))
    aside = np.full((1, lanes), 1e-4)
    rates = np.stack([slopes, slopes * (1.0 + 1e-4)])[None]
    nothing = np.zeros((0, lanes))
    none = np.zeros(0, dtype=np.int64)
    stepped(x, p, rates, aside, none, nothing, nothing, nothing, DT_S, False,
            none, nothing, nothing, nothing[None, :0])  # fmt: skip
    return x[0], p[0, 0]


@pytest.mark.parametrize("lanes", [1, 7, 8, 19, 96, 97, 200])
def test_every_lane_is_the_exponential_of_its_own_slope(lanes: int) -> None:
    slopes = np.linspace(-400.0, 30.0, lanes)
    x, p = _stepped(slopes)
    assert x == pytest.approx(np.exp(slopes * DT_S), rel=1e-6)
    assert p == pytest.approx(np.exp(2.0 * slopes * DT_S), rel=1e-6)


@pytest.mark.parametrize("lanes", [8, 100])
@pytest.mark.parametrize("lost", [-1e7, -1e9, -1e13, -1e17, 1e22, np.inf, np.nan])
def test_a_stiff_lane_and_one_that_has_left_its_model_take_no_other_along(
    lost: float, lanes: int
) -> None:
    """What is stiff halves the step of its neighbours, too, which costs them some digits."""
    slopes = np.full(lanes, -30.0)
    slopes[3] = lost
    with np.errstate(all="ignore"):
        x, p = _stepped(slopes)
    others = np.arange(lanes) != 3
    assert x[others] == pytest.approx(np.exp(-0.3), rel=1e-8)
    assert p[others] == pytest.approx(np.exp(-0.6), rel=1e-6)
