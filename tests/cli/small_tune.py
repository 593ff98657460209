"""A set on which a tune takes seconds, and the command."""

from pathlib import Path

import numpy as np
from click.testing import CliRunner, Result

from wakedeploy.cli import main
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet

LIMIT_S = 120
FAST = ("--dimension", "hidden=4:9", "--dimension", "chunk_steps=32:64")
FAST += ("--seed", "0")  # with which `train` begins


def small_set(steps: int = 317) -> EpisodeSet:
    splits = ["train"] * 4 + ["validation", "test"]
    draw = np.random.default_rng(0)
    episodes = []
    for index in range(len(splits)):
        u = np.convolve(draw.normal(size=steps + 3), np.ones(4) / 2, "valid")[:, None]
        force = 0.01 * np.roll(u, 5, axis=0)
        episodes.append(Episode(f"e{index}", u.astype(np.float32), force.astype(np.float32)))
    return EpisodeSet(
        domain="echo",
        rate_hz=20.0,
        observation=(Channel("u", "N"),),
        force=(Channel("f_n", "N"),),
        window_s=0.5,
        loss_weights=(1.0,),
        split={e.name: s for e, s in zip(episodes, splits, strict=True)},
        episodes=tuple(episodes),
    )


def wakedeploy(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def tune(data: Path, out: Path, *others: object) -> Result:
    return wakedeploy("tune", "--arch", "gru", "--data", data, "--out", out, *others)


def one_line(result: Result) -> str:
    return " ".join(result.output.split())
