"""Study of the fish's flag: true against predicted displacement, without memory and with the best.

In: the fish recordings and what is trained on them. Out: both models' predictions of the test
block. Which memory is the best is decided on the validation block.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wakedeploy.episodes import EpisodeSet
from wakedeploy.study.domains import MEMORYLESS, Line, planned, predicted
from wakedeploy.study.runs import Wanted, obtained
from wakedeploy.study.uncertainty import R2, FloatArray


@dataclass(frozen=True, eq=False)
class Shown:
    """One model's test block: truth and prediction (n,) [m], and R² with its interval."""

    arch: str
    true_m: FloatArray
    predicted_m: FloatArray
    r2: R2


def validation_r2(
    data: EpisodeSet,
    architectures: Sequence[str],
    seeds: int,
    runs: Path,
    epochs: int | None = None,
) -> dict[str, float]:
    """Each architecture's mean R² over the seeds on the validation block."""
    from trainers.score import score

    tip = data.force[0].name
    values: dict[str, list[float]] = {}
    for wanted in planned(data, architectures, seeds, epochs):
        r2 = score(obtained(data, wanted, runs), data, "validation", 0.0).r2[tip]
        values.setdefault(wanted.arch, []).append(float("-inf") if r2 is None else r2)
    return {arch: float(np.mean(own)) for arch, own in values.items()}


def best_memory(held_out: Mapping[str, float]) -> str:
    """The architecture with memory that has the highest validation score."""
    return max((arch for arch in held_out if arch != MEMORYLESS), key=lambda arch: held_out[arch])


def shown(
    data: EpisodeSet,
    lines: Sequence[Line],
    held_out: Mapping[str, float],
    runs: Path,
    epochs: int | None = None,
) -> tuple[Shown, Shown]:
    """The memoryless model's and the best memory's first seeds on the test block.

    `lines` are those of `compare` on this set; R² and its interval are taken from there.
    """
    plain, best = (
        _on_test(data, lines, Wanted(arch, 0, epochs), runs)
        for arch in (MEMORYLESS, best_memory(held_out))
    )
    return plain, best


def _on_test(data: EpisodeSet, lines: Sequence[Line], wanted: Wanted, runs: Path) -> Shown:
    truth, told, _ = predicted(obtained(data, wanted, runs), data)
    own = next(x for x in lines if (x.predictor, x.seed) == (wanted.arch, wanted.seed))
    r2 = R2(*(own.channels[0][name] for name in ("r2", "r2_low", "r2_high")))
    return Shown(wanted.arch, truth[:, 0], told[:, 0], r2)
