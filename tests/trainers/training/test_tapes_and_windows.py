"""Targets ahead, windows by index, lanes that carry state: each against the obvious way."""

import dataclasses

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from trainers.build import build
from trainers.memory import Memory
from trainers.model import Predictor
from trainers.training.predict import Seen, predict
from trainers.training.tape import lanes, lay_tape, shuffled
from trainers.training.targets import shift_ahead
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import UnusableInput


@given(lead_s=st.floats(0, 2), rate_hz=st.sampled_from([10.0, 32.0, 30.0, 100.0]))
def test_the_shifted_target_is_numpys_interpolation(lead_s: float, rate_hz: float) -> None:
    force = np.random.default_rng(0).normal(size=(90, 2)).astype(np.float32)
    shifted = shift_ahead(force, lead_s, rate_hz)
    times = np.arange(len(shifted)) + lead_s * rate_hz
    for channel in range(2):
        expected = np.interp(times, np.arange(90), force[:, channel])
        np.testing.assert_allclose(shifted[:, channel], expected, atol=1e-4)
    assert len(shifted) == max(0, 90 - np.ceil(lead_s * rate_hz - 1e-6))


def test_a_lead_on_the_grid_is_a_plain_shift() -> None:
    force = np.arange(20, dtype=np.float32)[:, None]
    assert np.array_equal(shift_ahead(force, 0.3, 10.0), force[3:])
    assert shift_ahead(force, 0.0, 10.0) is not None
    assert shift_ahead(force, 0.09, 32.0)[0, 0] == pytest.approx(2.88)


@pytest.mark.parametrize("lead_s", [-0.1, float("nan"), float("inf")])
def test_an_impossible_lead_is_refused(lead_s: float) -> None:
    with pytest.raises(UnusableInput, match="0 or more"):
        shift_ahead(np.zeros((5, 1), np.float32), lead_s, 10.0)


def test_a_set_too_short_for_its_lead_is_refused(echo: EpisodeSet) -> None:
    with pytest.raises(UnusableInput, match="no episode longer than its warm-up"):
        lay_tape(echo, "test", 60.0, echo.warm_up_steps)


def test_what_to_shorten_is_what_is_too_long(echo: EpisodeSet) -> None:
    long = dataclasses.replace(echo, window_s=100.0)
    with pytest.raises(UnusableInput, match="choose a shorter window_s") as told:
        lay_tape(long, "test", 0.0, long.warm_up_steps)
    assert "lead" not in str(told.value)
    with pytest.raises(UnusableInput, match="choose a shorter history_s"):
        lay_tape(echo, "test", 0.0, 10_000)
    with pytest.raises(UnusableInput, match="choose a smaller lead"):
        lay_tape(echo, "test", 60.0, echo.warm_up_steps)


@given(
    k=st.integers(1, 9),
    stride=st.integers(1, 5),
    lengths=st.lists(st.integers(1, 30), min_size=1, max_size=4),
)
def test_windows_of_a_tape_are_those_a_runner_would_keep(
    k: int, stride: int, lengths: list[int]
) -> None:
    newest, first, expected = [], [], []
    start = 0
    for length in lengths:
        ring = [start] * ((k - 1) * stride + 1)  # a cold start repeats the oldest sample
        for sample in range(start, start + length):
            ring = [*ring[1:], sample]
            newest.append(sample)
            first.append(start)
            expected.append(ring[::stride])
        start += length
    observation = torch.arange(2.0 * len(newest)).view(-1, 2)  # (N, d)
    order = torch.randperm(len(newest), generator=torch.Generator().manual_seed(0))
    seen = Seen(observation, torch.tensor(first), Memory("window", k, stride))
    assert torch.equal(seen.at(order), observation[torch.tensor(expected)[order]])
    alone = Seen(observation, torch.tensor(first), Memory("none"))
    assert torch.equal(alone.at(order), observation[order])


@pytest.mark.parametrize("arch", ["agile-mlp", "cross-attention", "gru", "tcn"])
def test_a_tape_is_predicted_as_its_episodes_are_one_by_one(arch: str, echo: EpisodeSet) -> None:
    made = Predictor(arch, build(arch, inputs=2, outputs=1, window_s=0.5, rate_hz=20.0), 2, 1)
    made.eval()
    tape = lay_tape(echo, "train", 0.12, echo.warm_up_steps)
    together = predict(made, tape)
    for start, length in zip(tape.starts, tape.lengths, strict=True):
        part = slice(start, start + length)
        with torch.no_grad():
            alone = made.rollout(tape.observation[part][None])[0]
        torch.testing.assert_close(together[part], alone, rtol=1e-4, atol=1e-5)


@pytest.mark.whole
@settings(max_examples=30, deadline=None)
@given(count=st.integers(1, 9), steps=st.integers(1, 80), seed=st.integers(0, 99))
def test_lanes_play_episodes_in_order_and_score_each_sample_once(
    echo: EpisodeSet, count: int, steps: int, seed: int
) -> None:
    warm_up = 10
    tape = lay_tape(echo, "train", 0.0, warm_up)
    generator = torch.Generator().manual_seed(seed)
    chunks = list(lanes(tape, count=count, steps=steps, warm_up=warm_up, generator=generator))
    seen = torch.zeros(len(tape.first), dtype=torch.long)
    for lane in range(len(chunks[0].fresh)):
        since = None
        for number, chunk in enumerate(chunks):
            index, scored = chunk.index[lane], chunk.scored[lane]
            if chunk.fresh[lane]:
                since = int(index[0])
            elif scored.any():  # the state came from the sample just before, of the same episode
                assert index[0] == chunks[number - 1].index[lane, -1] + 1
            assert (index[scored] >= since + warm_up).all()
            assert (tape.first[index[scored]] == tape.first[since]).all()
            seen[index[scored]] += 1
    assert chunks[0].fresh.all()
    assert seen.max() <= 1
    assert seen.sum() > 0  # however many lanes were asked for, something is learned
    if steps >= warm_up:
        assert seen.sum() > len(seen) - (count + len(tape.lengths)) * (warm_up + steps) - 1


def test_every_scored_sample_is_drawn_once(echo: EpisodeSet) -> None:
    tape = lay_tape(echo, "train", 0.0, 10)
    drawn = shuffled(tape, torch.Generator().manual_seed(0))
    assert torch.equal(drawn.sort().values, torch.nonzero(tape.scored).squeeze(1))
    assert not torch.equal(drawn, drawn.sort().values)
