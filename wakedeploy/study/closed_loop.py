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
from wakedeploy.episodes import EpisodeSet
from wakedeploy.study.domains import MEMORYLESS
from wakedeploy.study.side_by_side import side_by_side
from wakedeploy.study.uncertainty import FloatArray

FIRST_SEED = 900_000_000  # far from every training seed
LIMITS = ("no compensation", "oracle", "mean force")
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
    episodes: int,
    seconds: float,
    expect: Predict | str,
    world: World | None = None,
    settling_s: float | None = None,
) -> FloatArray:
    """Tracking errors (episodes,) [m] of the study's flights, in one lockstep."""
    seeds = [FIRST_SEED + i for i in range(episodes)]
    flown = fly(seeds, world=world, seconds=seconds, expect=expect, settling_s=settling_s)
    return flown.tracking_m


@dataclass(frozen=True)
class Always:
    """Expects the same force [N] at every step."""

    force_n: tuple[float, ...]

    def __call__(self, observation: FloatArray) -> FloatArray:
        """(E, d) -> (E, o)."""
        return np.tile(self.force_n, (len(observation), 1))


def mean_force(data: EpisodeSet) -> Always:
    """The mean force of the training episodes: what needs neither a model nor an observation."""
    learned = np.concatenate([e.force for e in data.part("train")]).astype(float)
    return Always(tuple(float(v) for v in learned.mean(axis=0)))


def track(
    models: Sequence[tuple[str, Sequence[Any]]],
    episodes: int,
    seconds: float,
    *,
    constant: Always,
    world: World | None = None,
    settling_s: float | None = None,
    workers: int | None = None,
    on_flight: Callable[[], None] = lambda: None,
) -> list[Tracked]:
    """Fly the `LIMITS` (nothing, the truth, a constant force), then each model's predictors.

    All fly the same flights, each in its own lockstep, on `workers` processes (None: all cores).
    """
    named: list[tuple[str, Any]] = list(zip(LIMITS, ("nothing", "truth", constant), strict=True))
    named += [(name, predictor) for name, predictors in models for predictor in predictors]
    jobs = [(episodes, seconds, expect, world, settling_s) for _, expect in named]
    flown = side_by_side(_flown, jobs, workers=workers, on_done=on_flight)
    found: dict[str, list[FloatArray]] = {}
    for (name, _), tracking_m in zip(named, flown, strict=True):
        found.setdefault(name, []).append(tracking_m)
    return [Tracked(name, np.array(own)) for name, own in found.items()]


def _flown(job: tuple[int, float, Any, World | None, float | None]) -> FloatArray:
    """A predictor begins each lockstep without a past."""
    episodes, seconds, expect, world, settling_s = job
    if not isinstance(expect, str | Always):
        from trainers.lockstep import Lockstep

        expect = Lockstep(expect)
    return flights(episodes, seconds, expect, world, settling_s)


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


def sentence(lines: Sequence[Tracked], chosen: str | None = None) -> str:
    """What the flights say of the model `chosen` on validation forces, and of a constant."""
    nothing, oracle, constant, *models = lines
    told = (
        f"Without compensation the sufferer is {1e3 * nothing.mean_m:.1f} mm from its reference, "
        f"with the true force {1e3 * oracle.mean_m:.1f} mm. The training flights' mean force, a "
        f"constant, already reaches {_share(constant, nothing, oracle)} of that gain"
    )
    named = {line.name: line for line in models}
    if chosen is None or chosen not in named:
        return f"{told}."
    best, plain = named[chosen], named.get(MEMORYLESS)
    text = (
        f"{told}; {chosen}, the best on validation, tracks to {1e3 * best.mean_m:.1f} mm, which is "
        f"{_share(best, nothing, oracle)}."
    )
    if plain is not None and plain is not best:
        beaten = sum(line.mean_m < plain.mean_m for line in models)
        text += (
            f" The memoryless {MEMORYLESS} tracks to {1e3 * plain.mean_m:.1f} mm, "
            f"{_share(plain, nothing, oracle)}; {beaten} of {len(models) - 1} models with memory "
            "do better."
        )
    if min(line.mean_m for line in models) < oracle.mean_m:
        text += " Who passes the oracle tracks better by chance or by its errors, not by knowing."
    return text


def _share(line: Tracked, nothing: Tracked, oracle: Tracked) -> str:
    share = recovered(line, nothing, oracle)
    return f"{100 * share.share:.0f} % [{100 * share.low:.0f}, {100 * share.high:.0f}]"
