"""The error of a predictor in each episode, so that one sees which recordings it predicts badly."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

Error = Annotated[float, Field(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True)
class EpisodeScore:
    """The error in one episode, over its samples after the warm-up, by force channel.

    `rmse` is in the channel's unit. `relative` is rmse by that of predicting zero in the same
    samples: below 1 the predictor is better than nothing. It is None where the force is 0
    throughout.
    """

    episode: str
    samples: int
    rmse: dict[str, Error]
    relative: dict[str, Error | None]


def worst_first(episodes: Iterable[EpisodeScore]) -> list[EpisodeScore]:
    """Sorted by rmse; several channels count as shares of what each errs by over all episodes."""
    scored = list(episodes)
    samples = sum(each.samples for each in scored)
    pooled = {
        name: math.sqrt(sum(e.samples * e.rmse[name] ** 2 for e in scored) / samples)
        for name in (scored[0].rmse if scored else ())
    }

    def badness(each: EpisodeScore) -> float:
        return sum(each.rmse[name] / pooled[name] for name in pooled if pooled[name] > 0.0)

    return sorted(scored, key=badness, reverse=True)
