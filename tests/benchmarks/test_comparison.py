"""Ways to mend a model, on a system whose missing force is known."""

import numpy as np
import pytest

pysindy = pytest.importorskip("pysindy", reason="the extra dev brings it")

from benchmarks.real_systems.comparison import _network, _sindy, _within  # noqa: E402


def missing(points: np.ndarray) -> np.ndarray:
    return (-2.0 * points[:, 0] ** 3 + 0.5 * points[:, 1])[:, None]


@pytest.mark.parametrize("learn", [_sindy, _network])
def test_a_missing_cubic_spring_is_learnt_from_noisy_corrections(learn) -> None:
    random = np.random.default_rng(0)
    points = random.uniform(-1.0, 1.0, (3000, 2))
    rates = missing(points) + 0.1 * random.standard_normal((3000, 1))
    learnt = _within(learn(points, rates), rates)
    fresh = random.uniform(-1.0, 1.0, (500, 2))
    assert np.sqrt(np.mean((learnt(fresh) - missing(fresh)) ** 2)) < 0.12
    assert np.abs(learnt(100.0 * fresh)).max() <= np.abs(rates).max()
