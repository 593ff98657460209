"""A small domain whose force is a delayed, nonlinear echo of one input: memory must pay."""

from collections.abc import Callable, Iterator

import drawing
import numpy as np
import pytest

from wakedeploy.core.episodes import Channel, Episode, EpisodeSet

RATE_HZ = 20.0
DELAY_STEPS = 6


def echo_episode(name: str, seed: int, steps: int) -> Episode:
    """Force(t) = 2·u(t − 0.3 s) + u(t − 0.3 s)², u band-limited noise; a second input is noise."""
    draw = np.random.default_rng(seed)
    white = draw.normal(size=steps + DELAY_STEPS + 4)
    u = np.convolve(white, np.full(5, 5**-0.5), "valid")
    delayed, present = u[:steps], u[DELAY_STEPS : DELAY_STEPS + steps]
    observation = np.stack([present, draw.normal(size=steps)], 1)
    force = 0.01 * (2 * delayed + delayed**2)[:, None]
    return Episode(name, observation.astype(np.float32), force.astype(np.float32))


def echo_set(steps: int = 300, episodes: int = 6) -> EpisodeSet:
    splits = ["test", "validation"] + ["train"] * (episodes - 2)
    parts = tuple(echo_episode(f"e{i}", i, steps + 7 * i) for i in range(episodes))
    return EpisodeSet(
        domain="echo",
        rate_hz=RATE_HZ,
        observation=(Channel("u", "N"), Channel("idle", "1")),
        force=(Channel("f_n", "N"),),
        window_s=0.5,
        loss_weights=(1.0,),
        split={e.name: s for e, s in zip(parts, splits, strict=True)},
        episodes=parts,
    )


@pytest.fixture(autouse=True, scope="module")
def pictures_are_drawn_once() -> Iterator[None]:
    with drawing.each_drawn_once():
        yield


@pytest.fixture(scope="session")
def echo() -> EpisodeSet:
    return echo_set()


@pytest.fixture(scope="session")
def make_echo() -> Callable[..., EpisodeSet]:
    return echo_set
