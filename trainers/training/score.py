"""Errors of a predictor on a split: RMSE in SI and R², pooled per channel over the split."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from trainers.model import Predictor
from trainers.training.episode_scores import EpisodeScore
from trainers.training.predict import predict
from trainers.training.tape import Tape, lay_tape
from trainers.training.targets import shift_ahead
from wakedeploy.core.episodes import OBSERVER, EpisodeSet

LABEL_SD = "force_sd_n"  # extra array of sets whose labels are estimates: their standard deviation


@dataclass(frozen=True)
class Score:
    """Errors per force channel over the samples after warm-up.

    R² is None where the force never changes. `ceiling` is the R² that label noise leaves to a
    perfect predictor, 1 − mean(sd²) / var(force); None where the labels state no noise.
    `episodes` has the errors in each episode.
    """

    rmse: dict[str, float]
    r2: dict[str, float | None]
    ceiling: dict[str, float] | None
    samples: int
    episodes: tuple[EpisodeScore, ...]


def score(
    predictor: Predictor, data: EpisodeSet, split: str, lead_s: float, warm_up: int | None = None
) -> Score:
    """Run every episode of the split from a cold start and compare after the warm-up.

    Raises UnusableInput when the split has no episode long enough.
    """
    steps = data.warm_up_steps if warm_up is None else warm_up
    tape = lay_tape(data, split, lead_s, steps)
    return compared(predict(predictor, tape), tape, data, split, lead_s, steps)


def unlearned_forces(
    tape: Tape, data: EpisodeSet, split: str, lead_s: float, warm_up: int
) -> dict[str, Tensor]:
    """Forces (N, o) that need no learning, for every sample of a tape laid with the same arguments.

    By name: a force of zero, and what a set's observer said at that sample, where it has one.
    """
    forecasts = {"zero": torch.zeros_like(tape.force)}
    episodes = data.part(split)
    if all(OBSERVER in e.extras for e in episodes):
        counts = [len(shift_ahead(e.force, lead_s, data.rate_hz)) for e in episodes]
        both = zip(episodes, counts, strict=True)
        seen = [e.extras[OBSERVER][:count] for e, count in both if count > warm_up]
        forecasts["no-learning observer"] = torch.tensor(np.concatenate(seen)).reshape(
            tape.force.shape
        )
    return forecasts


def compared(
    forces: Tensor, tape: Tape, data: EpisodeSet, split: str, lead_s: float, warm_up: int
) -> Score:
    """Forces (N, o) of every sample of the tape against its own, after the warm-up."""
    truth = tape.force[tape.scored].double()  # (M, o)
    error = forces[tape.scored].double() - truth  # (M, o)
    rmse, spread = _rms(error), truth.std(0, unbiased=False)
    names = [channel.name for channel in data.force]
    return Score(
        rmse=dict(zip(names, rmse.tolist(), strict=True)),
        r2=dict(zip(names, _r2(rmse, spread), strict=True)),
        ceiling=_ceiling(data, split, lead_s, warm_up, spread),
        samples=len(truth),
        episodes=_by_episode(error, truth, tape, names),
    )


def _by_episode(
    error: Tensor, truth: Tensor, tape: Tape, channels: list[str]
) -> tuple[EpisodeScore, ...]:
    """The scored samples (M, o) of a tape, episode by episode."""
    counts = [int(part.sum()) for part in torch.split(tape.scored, list(tape.lengths))]
    parts = zip(tape.names, torch.split(error, counts), torch.split(truth, counts), strict=True)
    return tuple(
        _in_episode(name, _rms(off).tolist(), _rms(force).tolist(), len(off), channels)
        for name, off, force in parts
    )


def _in_episode(
    name: str, rmse: list[float], of_zero: list[float], samples: int, channels: list[str]
) -> EpisodeScore:
    relative = [off / zero if zero > 0 else None for off, zero in zip(rmse, of_zero, strict=True)]
    return EpisodeScore(
        episode=name,
        samples=samples,
        rmse=dict(zip(channels, rmse, strict=True)),
        relative=dict(zip(channels, relative, strict=True)),
    )


def _rms(values: Tensor) -> Tensor:
    return values.square().mean(0).sqrt()


def _r2(rmse: Tensor, spread: Tensor) -> list[float | None]:
    return [
        1 - (e / s) ** 2 if s > 0 else None
        for e, s in zip(rmse.tolist(), spread.tolist(), strict=True)
    ]


def _ceiling(
    data: EpisodeSet, split: str, lead_s: float, warm_up: int, spread: Tensor
) -> dict[str, float] | None:
    episodes = data.part(split)
    if not all(LABEL_SD in e.extras for e in episodes):
        return None
    shifted = [
        shift_ahead(np.square(e.extras[LABEL_SD]), lead_s, data.rate_hz)[warm_up:] for e in episodes
    ]
    variance = np.concatenate([v.reshape(len(v), len(data.force)) for v in shifted]).mean(0)
    return {
        channel.name: 1 - float(v) / s**2
        for channel, v, s in zip(data.force, variance, spread.tolist(), strict=True)
        if s > 0
    }
