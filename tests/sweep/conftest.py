"""A small set that trains in a tenth of a second, and a way to sweep from the command line."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from wakedeploy.cli import main
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.files import read_json_lines

SPLIT = ("train", "train", "train", "validation", "test")


def small_set(seed: int = 0, steps: int = 80) -> EpisodeSet:
    """A force that follows an input of 0.2 s before, in five episodes at 20 Hz."""
    draw = np.random.default_rng(seed)
    episodes = []
    for i in range(len(SPLIT)):
        u = draw.normal(size=steps + 4).astype(np.float32)
        episodes.append(Episode(f"e{i}", u[4:, None].copy(), u[:-4, None].copy()))
    return EpisodeSet(
        domain="toy",
        rate_hz=20.0,
        observation=(Channel("u", "N"),),
        force=(Channel("f_n", "N"),),
        window_s=0.5,
        loss_weights=(1.0,),
        split={e.name: s for e, s in zip(episodes, SPLIT, strict=True)},
        episodes=tuple(episodes),
    )


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """The folder of a small set."""
    small_set().write(tmp_path / "small")
    return tmp_path / "small"


@pytest.fixture
def make_small() -> Callable[..., EpisodeSet]:
    return small_set


@pytest.fixture
def unvalidated() -> EpisodeSet:
    """A small set whose validation episode is one more of training."""
    whole = small_set()
    split = {name: "train" if s == "validation" else s for name, s in whole.split.items()}
    return dataclasses.replace(whole, split=split)


@pytest.fixture
def wakedeploy() -> Callable[..., Result]:
    """Run a command; what it printed, folded to single spaces, is in `output`."""

    def run(*arguments: object) -> Result:
        return CliRunner().invoke(main, [str(argument) for argument in arguments])

    return run


@pytest.fixture
def lines() -> Callable[[Path], list[dict]]:
    """The whole lines of a sweep's results."""
    return lambda out: read_json_lines(out / "results.jsonl")
