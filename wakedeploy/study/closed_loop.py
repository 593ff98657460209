"""Study 2: what a predictor is worth in flight, on the paper's 2D downwash simulator.

In: trained runs, seeds of flights that no training has seen. Out: how far the sufferer is from its
reference with no compensation, with the truth, and with each model; all on the same flights.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from wakedeploy.domains.downwash import Predict, World, fly
from wakedeploy.study.side_by_side import side_by_side
from wakedeploy.study.uncertainty import FloatArray

FIRST_SEED = 900_000_000  # far from every training seed
_DRAWS = 2000


@dataclass(frozen=True, eq=False)
class Tracked:
    """One line: tracking errors (seeds, episodes) [m] of one way to compensate."""

    name: str
    rms_m: FloatArray

    @property
    def mean_m(self) -> float:
        """Root mean square over all flights."""
        return float(np.sqrt(np.mean(self.rms_m**2)))

    @property
    def per_flight_m(self) -> FloatArray:
        """Over the seeds, (episodes,)."""
        return np.asarray(np.sqrt(np.mean(self.rms_m**2, axis=0)))


@dataclass(frozen=True)
class Recovered:
    """What a model gains of what the oracle gains, with a 90 % interval over the flights."""

    share: float
    low: float
    high: float


def flights(
    episodes: int, seconds: float, expect: Predict | str, world: World | None = None
) -> FloatArray:
    """Tracking errors (episodes,) [m] of the study's flights, in one lockstep."""
    seeds = [FIRST_SEED + i for i in range(episodes)]
    return fly(seeds, world=world, seconds=seconds, expect=expect).tracking_m


def track(
    models: Sequence[tuple[str, Sequence[Any]]],
    episodes: int,
    seconds: float,
    *,
    world: World | None = None,
    workers: int | None = None,
    on_flight: Callable[[], None] = lambda: None,
) -> list[Tracked]:
    """Fly nothing, the truth, and each model's predictors (one per training seed).

    All fly the same flights, each in its own lockstep, on `workers` processes (None: all cores).
    """
    named: list[tuple[str, Any]] = [("no compensation", "nothing"), ("oracle", "truth")]
    named += [(name, predictor) for name, predictors in models for predictor in predictors]
    jobs = [(episodes, seconds, expect, world) for _, expect in named]
    flown = side_by_side(_flown, jobs, workers=workers, on_done=on_flight)
    found: dict[str, list[FloatArray]] = {}
    for (name, _), tracking_m in zip(named, flown, strict=True):
        found.setdefault(name, []).append(tracking_m)
    return [Tracked(name, np.array(own)) for name, own in found.items()]


def _flown(job: tuple[int, float, Any, World | None]) -> FloatArray:
    """A predictor begins each lockstep without a past."""
    episodes, seconds, expect, world = job
    if not isinstance(expect, str):
        from trainers.lockstep import Lockstep

        expect = Lockstep(expect)
    return flights(episodes, seconds, expect, world)


def recovered(line: Tracked, nothing: Tracked, oracle: Tracked) -> Recovered:
    """How much of the oracle's gain in tracking error a model reaches, flights drawn in pairs."""

    def share(chosen: npt.NDArray[np.int64]) -> FloatArray:
        rms = [
            np.sqrt(np.mean(one.per_flight_m[chosen] ** 2, axis=-1))
            for one in (nothing, line, oracle)
        ]
        return np.asarray((rms[0] - rms[1]) / (rms[0] - rms[2]))

    count = len(nothing.per_flight_m)
    drawn = np.random.default_rng(0).integers(0, count, (_DRAWS, count))
    low, high = np.quantile(share(drawn), [0.05, 0.95])
    return Recovered(float(share(np.arange(count, dtype=np.int64))), float(low), float(high))


def sentence(lines: Sequence[Tracked]) -> str:
    """What the flights say, in one sentence."""
    nothing, oracle, *models = lines
    told = (
        f"Without compensation the sufferer is {1e3 * nothing.mean_m:.1f} mm from its reference, "
        f"with the true force {1e3 * oracle.mean_m:.1f} mm"
    )
    if not models:
        return f"{told}."
    best = min(models, key=lambda line: line.mean_m)
    share = recovered(best, nothing, oracle)
    return (
        f"{told}; {best.name} is the best model with {1e3 * best.mean_m:.1f} mm, which is "
        f"{100 * share.share:.0f} % of the oracle's gain "
        f"[{100 * share.low:.0f}, {100 * share.high:.0f}]."
    )
