"""The training benchmark's books: equal models, equal targets, operations counted rightly."""

import dataclasses
import json
import math

import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from benchmarks.multiply_adds import MultiplyAdds
from benchmarks.training import (
    DESCENDING,
    SHARES,
    PlainLoop,
    at_once,
    counted_fit,
    flops_per_target,
    measured,
    newest_force,
    table,
)
from trainers.training.trainer import configure, settings_for, tapes
from wakedeploy.core.episodes import EpisodeSet


def config_of(data: EpisodeSet, arch: str, epochs: int = 2):
    settings = dataclasses.replace(settings_for(arch), epochs=epochs, lanes=4, chunk_steps=32)
    return configure(data, arch, seed=0, lead_s=0.0, settings=settings)


def plain_of(data: EpisodeSet, arch: str) -> PlainLoop:
    config = config_of(data, arch)
    return PlainLoop(config, *tapes(data, 0.0), total=1000)


@pytest.mark.whole
def test_both_start_from_the_same_weights_and_see_as_many_targets(echo: EpisodeSet) -> None:
    result = measured(echo, ["agile-mlp", "history-mlp", "gru"], 2, 1)
    for row in result["rows"]:
        for book in ("targets", "initial_sha256"):
            assert row[book]["ours"] == row[book]["plain"], (row["arch"], book)
        assert all(math.isfinite(e) for own in row["errors"].values() for e in own)
        assert set(row["shares"]) == set(SHARES)
        assert sum(row["shares"].values()) == pytest.approx(1.0)
        assert row["ratio"]["low"] <= row["ratio"]["median"] <= row["ratio"]["high"]
    scored = int(tapes(echo, 0.0)[0].scored.sum())
    windows, gru = result["rows"][1:]
    assert windows["targets"]["ours"] == [2 * scored]
    assert windows["updates"]["ours"] == windows["updates"]["plain"]
    assert 0 < gru["targets"]["ours"][0] <= 2 * scored
    assert json.loads(json.dumps(result)) == result
    assert table(result["rows"]).count("\n") == 1 + 3


@pytest.mark.whole
def test_two_trainings_at_once_are_counted_together(echo: EpisodeSet) -> None:
    told = at_once(config_of(echo, "gru"), echo, 2)
    assert told["cores"] == 2
    assert told["per_s"] > 0.0
    flops = flops_per_target(config_of(echo, "gru"), echo)["ours"]
    assert told["share_of_cores"] == pytest.approx(
        1e-9 * flops * told["per_s"] / told["core_gflops"]
    )


@pytest.mark.parametrize("arch", ["agile-mlp", "history-mlp", "cross-attention", "gru", "mamba"])
def test_the_plain_loop_sees_what_ours_sees(echo: EpisodeSet, arch: str) -> None:
    """A prediction from a stored window is one of the rollout that begins where the window does."""
    plain = plain_of(echo, arch)
    predictor = plain.predictor.eval()
    learned, _ = tapes(echo, 0.0)
    windows, wanted = plain.learned.tensors
    at = torch.nonzero(learned.scored).squeeze(1)
    assert len(windows) == len(at)
    with torch.no_grad():
        told = predictor.denormalise(newest_force(predictor.core, windows[30:31]))[0]
        begin = int(at[30]) - (echo.warm_up_steps if predictor.memory.kind == "state" else 20)
        seen = learned.observation[begin : int(at[30]) + 1]
        torch.testing.assert_close(told, predictor.rollout(seen[None])[0, -1], atol=1e-6, rtol=1e-5)
    torch.testing.assert_close(predictor.denormalise(wanted[30]), learned.force[at[30]])


def test_the_plain_loop_stops_after_the_targets_that_it_is_given(echo: EpisodeSet) -> None:
    plain = plain_of(echo, "history-mlp")
    plain.play(300)
    plain.play(7)
    assert plain.loss.targets == 307
    assert plain.progress == 0.307
    plain.validate()
    assert plain.loss.targets == 307  # validation is not learned from


@pytest.mark.parametrize("arch", [arch for arch in DESCENDING if arch != "mamba"])
def test_multiply_adds_are_those_that_torch_counts(echo: EpisodeSet, arch: str) -> None:
    """torch counts matrix products and convolutions; what we add by hand is small beside them."""
    plain = plain_of(echo, arch)
    with FlopCounterMode(display=False) as torchs, MultiplyAdds(plain.predictor.core) as ours:
        plain.play(64)
    assert 2 * ours.count == pytest.approx(torchs.get_total_flops(), rel=0.15)


def test_mambas_multiply_adds_are_those_of_its_equations(echo: EpisodeSet) -> None:
    """torch counts the gradient of a convolution by channels as if it mixed them; so by hand."""
    plain = plain_of(echo, "mamba")
    with MultiplyAdds(plain.predictor.core) as ours:
        plain.play(64)
    d, m, e, n, r, o = 2, 32, 64, 8, 2, 1
    steps = 64 * (echo.warm_up_steps + 1)
    weights = m * 2 * e + e * (r + 2 * n) + r * e + e * m + m * o
    convolved = 4 * e  # once for every step, the first ones with zeros for their past
    scanned = 3 * e * n
    assert ours.count == steps * (3 * (weights + convolved + scanned) + 2 * d * m)


def test_counting_changes_nothing_that_is_learned(echo: EpisodeSet) -> None:
    config = config_of(echo, "gru")
    fit = counted_fit(config, echo)
    fit.run_epoch()
    with MultiplyAdds(fit.predictor.core):
        fit.run_epoch()
    other = counted_fit(config, echo)
    other.run_epoch()
    other.run_epoch()
    assert fit.standing == other.standing
