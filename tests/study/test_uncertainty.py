"""The interval of R²: it covers, it needs blocks, and blocks never cross episodes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from wakedeploy.study.uncertainty import blocks, r2_with_interval


def correlated(rng: np.random.Generator, n: int, keep: float, rows: int) -> np.ndarray:
    """AR(1) series of unit variance, (rows, n)."""
    kicks = rng.standard_normal((rows, n)) * np.sqrt(1.0 - keep**2)
    kicks[:, 0] /= np.sqrt(1.0 - keep**2)
    return lfilter([1.0], [1.0, -keep], kicks, axis=1)


def test_r2_is_one_minus_unexplained_variance() -> None:
    rng = np.random.default_rng(0)
    truth, error = rng.normal(3.0, 2.0, 400), rng.normal(0.0, 0.7, 400)
    told = r2_with_interval(truth, error, np.arange(400) // 20)
    assert told.value == pytest.approx(1.0 - np.mean(error**2) / truth.var())
    assert told.low < told.value < told.high


def test_intervals_of_correlated_errors_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(1)
    n, runs, noise_sd = 2000, 200, 0.5
    truths = correlated(rng, n, 0.9, runs)
    errors = noise_sd * correlated(rng, n, 0.9, runs)
    held = {}
    for length in (1, 100):
        block = blocks(np.zeros(n, np.int64), length)
        told = [r2_with_interval(t, e, block) for t, e in zip(truths, errors, strict=True)]
        held[length] = np.mean([r.low < 1.0 - noise_sd**2 < r.high for r in told])
    assert 0.78 < held[100] < 0.96  # twenty blocks are a little too sure of themselves
    assert held[1] < 0.6  # as if samples were independent


def test_few_blocks_tell_no_interval() -> None:
    rng = np.random.default_rng(2)
    told = r2_with_interval(rng.normal(size=70), rng.normal(size=70), np.arange(70) // 10)
    assert told.low is None
    assert told.high is None


@given(lengths=st.lists(st.integers(1, 60), min_size=1, max_size=12), samples=st.integers(1, 30))
def test_blocks_are_whole_stretches_within_episodes(lengths: list[int], samples: int) -> None:
    episode = np.repeat(np.arange(len(lengths)) * 7, lengths)
    block = blocks(episode, samples)
    assert len(np.unique(block)) == sum(-(-length // samples) for length in lengths)
    for number in np.unique(block):
        at = np.flatnonzero(block == number)
        assert np.array_equal(at, np.arange(at[0], at[-1] + 1))
        assert len(at) <= samples
        assert len(set(episode[at])) == 1
