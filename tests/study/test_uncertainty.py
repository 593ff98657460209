"""Intervals: they cover, they draw what the split keeps together, and few units make them wide."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.signal import lfilter

from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.study.uncertainty import (
    blocks,
    interval,
    r2_of,
    r2_with_interval,
    rmse_interval,
    sums,
    units_of,
)


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
    low, high = rmse_interval(sums(truth, error, np.arange(400) // 20)[None])
    assert low < np.sqrt(np.mean(error**2)) < high


def test_over_seeds_the_mean_and_its_interval_are_told() -> None:
    rng = np.random.default_rng(5)
    truth, unit = rng.normal(size=400), np.arange(400) // 20
    errors = rng.normal(size=400) * np.array([[0.2], [0.6]])
    both = r2_of(np.array([sums(truth, error, unit) for error in errors]))
    one, other = (r2_with_interval(truth, error, unit) for error in errors)
    assert both.value == pytest.approx(0.5 * (one.value + other.value))
    assert other.high < both.low < both.value < both.high < one.low


@pytest.mark.whole
def test_intervals_of_correlated_errors_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(1)
    n, runs, noise_sd = 2000, 100, 0.5
    truths = correlated(rng, n, 0.9, runs)
    errors = noise_sd * correlated(rng, n, 0.9, runs)
    held = {}
    for length in (1, 100):
        block = blocks(np.zeros(n, np.int64), length)
        some = slice(runs if length > 1 else 12)  # two thousand units take their time
        told = [
            r2_with_interval(t, e, block) for t, e in zip(truths[some], errors[some], strict=True)
        ]
        held[length] = np.mean([r.low < 1.0 - noise_sd**2 < r.high for r in told])
    assert 0.78 < held[100] < 0.96  # twenty blocks are a little too sure of themselves
    assert held[1] < 0.6  # as if samples were independent


def test_few_units_have_an_interval_as_wide_as_students() -> None:
    """For a mean the jackknife is the textbook's t interval."""
    values = np.array([1.0, 2.0, 4.0, 8.0])
    found = interval(lambda times: times @ values / times.sum(1), 4)
    expected = stats.t.interval(0.9, 3, values.mean(), stats.sem(values))
    assert found == pytest.approx(expected)
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(300):  # recordings that differ in how hard they are
        hard = np.exp(rng.normal(0.0, 0.5, 5)).repeat(400)
        error = hard * rng.normal(size=2000)
        low, high = rmse_interval(sums(np.zeros(2000), error, np.arange(2000) // 400)[None])
        held += low < np.sqrt(np.exp(0.5)) < high  # E[hard²] is exp(2·0.25)
    assert 0.78 < held / 300 < 0.97


def test_two_units_tell_no_interval() -> None:
    rng = np.random.default_rng(2)
    told = r2_with_interval(rng.normal(size=70), rng.normal(size=70), np.arange(70) // 35)
    assert told.low is None
    assert told.high is None


def grouped(episodes: int, groups: dict[str, str]) -> EpisodeSet:
    rng = np.random.default_rng(0)
    made = tuple(
        Episode(f"e{i}", rng.normal(size=(n, 1)).astype(np.float32), np.zeros((n, 1), np.float32))
        for i, n in enumerate([60, 30, 60, 60, 8][:episodes])
    )
    provenance = {"groups": groups} if groups else {}
    return EpisodeSet("toy", 20.0, (Channel("a", "N"),), (Channel("b", "N"),), 0.5, (1.0,),
                      {e.name: "test" for e in made}, made, provenance)  # fmt: skip


def test_what_the_split_keeps_together_is_one_unit() -> None:
    episode = np.repeat([0, 60, 90, 150], [50, 20, 50, 50])  # the fifth is shorter than its warm-up
    alone = units_of(grouped(5, {}), episode)
    assert [len(set(alone[episode == at])) for at in (0, 60, 90, 150)] == [1, 1, 1, 1]
    assert len(set(alone)) == 4
    flights = {"e0": "one", "e1": "two", "e2": "one", "e3": "two", "e4": "three"}
    told = units_of(grouped(5, flights), episode)
    assert len(set(told)) == 2
    assert set(told[episode == 0]) == set(told[episode == 90])
    assert set(told[episode == 60]) == set(told[episode == 150]) != set(told[episode == 0])
    # A lead that leaves the second episode nothing to be scored on.
    late = units_of(grouped(5, flights), np.repeat([0, 60, 120], 29), lead_s=1.05)
    assert late.tolist() == [0] * 58 + [1] * 29
    with pytest.raises(ValueError, match="3 episodes, where 4"):
        units_of(grouped(5, flights), np.repeat([0, 60, 120], 29))


def test_one_unit_falls_into_blocks_of_time() -> None:
    for data in (grouped(1, {}), grouped(2, {"e0": "same", "e1": "same"})):
        lengths = [50, 20][: len(data.episodes)]
        told = units_of(data, np.repeat(np.arange(len(lengths)), lengths))
        assert len(set(told)) == sum(-(-n // 40) for n in lengths)  # 4 windows of 0.5 s at 20 Hz


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
