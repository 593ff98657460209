"""Study of the fish's flag: true against predicted displacement, without memory and with the best.

In: the fish recordings and what is trained on them. Out: both models' predictions of the test
block. Which memory is the best is decided on the validation block.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.study.domains import MEMORYLESS, Line, held_out, predicted
from wakedeploy.study.runs import obtained
from wakedeploy.study.uncertainty import R2, FloatArray


@dataclass(frozen=True, eq=False)
class Shown:
    """One model's test block: truth and prediction (n,) [m], and R² with its interval.

    `seed` and `hyper` say which run it is.
    """

    arch: str
    true_m: FloatArray
    predicted_m: FloatArray
    r2: R2
    seed: int = 0
    hyper: str = ""


def best_memory(lines: Sequence[Line]) -> str:
    """The architecture with memory that has the least loss on the validation block."""
    losses = held_out(lines)
    return min((arch for arch in losses if arch != MEMORYLESS), key=lambda arch: losses[arch])


def shown(data: EpisodeSet, lines: Sequence[Line], runs: Path) -> tuple[Shown, Shown]:
    """The memoryless model's and the best memory's first seeds on the test block.

    `lines` are those of `compare` on this set; R² and its interval are taken from there.
    """
    plain, best = (_on_test(data, lines, arch, runs) for arch in (MEMORYLESS, best_memory(lines)))
    return plain, best


def _on_test(data: EpisodeSet, lines: Sequence[Line], arch: str, runs: Path) -> Shown:
    first = next(line for line in lines if (line.predictor, line.seed) == (arch, 0))
    if first.wanted is None:
        raise ValueError(f"{arch} was not trained")
    truth, predicted_m, _ = predicted(obtained(data, first.wanted, runs), data)
    r2 = R2(*(first.channels[0][name] for name in ("r2", "r2_low", "r2_high")))
    return Shown(arch, truth[:, 0], predicted_m[:, 0], r2, first.wanted.seed, first.hyper_text)
