"""The real recordings: memoryless near 0.55, a GRU at 0.95 or more (the paper: 0.57 and 0.96)."""

from pathlib import Path

import needs
import pytest

from trainers.training.trainer import configure, train
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.domains.fish import import_set


@pytest.fixture(scope="module")
def fish() -> EpisodeSet:
    return import_set(needs.recordings_of("fish"))


def r2(fish: EpisodeSet, arch: str, root: Path) -> float | None:
    run = train(configure(fish, arch, seed=0, lead_s=0.0), fish, root)
    return run.metrics.test.r2["flag_tip_m"]


@pytest.mark.whole
def test_without_memory_half_of_the_variance_stays_unexplained(
    fish: EpisodeSet, tmp_path: Path
) -> None:
    assert r2(fish, "agile-mlp", tmp_path) == pytest.approx(0.56, abs=0.04)


@pytest.mark.whole
def test_a_window_explains_most_of_it(fish: EpisodeSet, tmp_path: Path) -> None:
    assert r2(fish, "history-mlp", tmp_path) > 0.93


@pytest.mark.slow
def test_a_gru_explains_nearly_all(fish: EpisodeSet, tmp_path: Path) -> None:
    assert r2(fish, "gru", tmp_path) >= 0.95
