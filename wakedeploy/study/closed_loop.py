"""Study 2: what a predictor is worth in flight, on the paper's 2D downwash simulator.

In: trained runs, seeds of flights that no training has seen. Out: how far the sufferer is from its
reference with no compensation, with the truth, and with each model; all on the same flights.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.parallel import parallel_map
from wakedeploy.domains.downwash import Predict, World, fly
from wakedeploy.study.domains import MEMORYLESS
from wakedeploy.study.uncertainty import FEWEST, FloatArray

FIRST_SEED = 900_000_000  # far from every training seed
LIMITS = ("no compensation", "oracle", "mean force")
_DRAWS = 2000
_RISK = 0.05
_QUANTILES = (_RISK, 1.0 - _RISK)
_LEAST_GAIN = 0.1  # of the error without compensation; with less, no share of the gain is reported


@dataclass(frozen=True, eq=False)
class Tracked:
    """One line: tracking errors (seeds, episodes) [m] of one way to compensate.

    `hyper` says of each seed what differs from the architecture's usual hyper-parameters.
    """

    name: str
    rms_m: FloatArray
    hyper: tuple[str, ...] = ()

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
    """What a model gains of what the oracle gains, with a 90 % interval over flights and seeds.

    Without bounds where there are too few flights.
    """

    share: float
    low: float | None
    high: float | None

    @property
    def text(self) -> str:
        """In per cent."""
        if self.low is None or self.high is None:
            return f"{100 * self.share:.0f} %"
        return f"{100 * self.share:.0f} % [{100 * self.low:.0f}, {100 * self.high:.0f}]"


@dataclass(frozen=True)
class Model:
    """What flies: an architecture's predictors, one per seed, and each one's hyper-parameters."""

    name: str
    predictors: Sequence[Any]
    hyper: Sequence[str]


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
    models: Sequence[Model],
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
    named += [(model.name, predictor) for model in models for predictor in model.predictors]
    jobs = [(episodes, seconds, expect, world, settling_s) for _, expect in named]
    flown = parallel_map(
        _flown, jobs, workers=workers, fresh=True, on_done=lambda job, tracked: on_flight()
    )
    found: dict[str, list[FloatArray]] = {}
    for (name, _), tracking_m in zip(named, flown, strict=True):
        found.setdefault(name, []).append(tracking_m)
    hyper = {model.name: tuple(model.hyper) for model in models}
    return [
        Tracked(name, np.array(errors_m), hyper.get(name, ())) for name, errors_m in found.items()
    ]


def _flown(job: tuple[int, float, Any, World | None, float | None]) -> FloatArray:
    """A predictor begins each lockstep without a past."""
    episodes, seconds, expect, world, settling_s = job
    if not isinstance(expect, str | Always):
        from trainers.inspection.lockstep import Lockstep

        expect = Lockstep(expect)
    return flights(episodes, seconds, expect, world, settling_s)


def resampled(lines: Sequence[Tracked]) -> FloatArray | None:
    """Each line's error over drawn flights and seeds (L, D) [m]; None with too few flights.

    All lines fly the same drawn flights. Seeds are drawn from each line's own, by its place: lines
    at the same place of two lists have the same seeds drawn.
    """
    count = len(lines[0].per_flight_m)
    if count < FEWEST:
        return None
    even = np.full(count, 1.0 / count)
    flights = np.random.default_rng(0).multinomial(count, even, _DRAWS)  # (D, F)
    errors_m = []
    for place, line in enumerate(lines):
        seeds = len(line.rms_m)
        rng = np.random.default_rng([1, place])
        drawn = rng.multinomial(seeds, np.full(seeds, 1.0 / seeds), _DRAWS)  # (D, S)
        errors_m.append(np.sqrt(((drawn @ line.rms_m**2) * flights).sum(-1) / (seeds * count)))
    return np.array(errors_m)


def above(line: Tracked, base: Tracked) -> tuple[float, float, float]:
    """By how much a line's error lies above another's [m], with a 90 % interval.

    The interval is without end where there are too few flights for one.
    """
    apart_m = line.mean_m - base.mean_m
    drawn = resampled([base, line])
    if drawn is None:
        return apart_m, -np.inf, np.inf
    low, high = np.quantile(drawn[1] - drawn[0], _QUANTILES)
    return apart_m, float(low), float(high)


def recovered(line: Tracked, nothing: Tracked, oracle: Tracked) -> Recovered | None:
    """How much of the oracle's gain in tracking error a model reaches.

    None where that gain is less than a tenth of the error without compensation, or not sure: a
    share of next to nothing is any number.
    """

    def gain(of: FloatArray) -> FloatArray:
        return np.asarray(of[0] - of[1] - _LEAST_GAIN * of[0])

    lines = [nothing, oracle, line]
    mean_m, drawn = np.array([compared.mean_m for compared in lines]), resampled(lines)
    if gain(mean_m) <= 0.0 or (drawn is not None and np.quantile(gain(drawn), _RISK) <= 0.0):
        return None
    share = (mean_m[0] - mean_m[2]) / (mean_m[0] - mean_m[1])
    if drawn is None:
        return Recovered(float(share), None, None)
    low, high = np.quantile((drawn[0] - drawn[2]) / (drawn[0] - drawn[1]), _QUANTILES)
    return Recovered(float(share), float(low), float(high))


@dataclass(frozen=True)
class Memory:
    """How many of the models with memory track better than the memoryless, and how many worse.

    Clearly: with an interval, over flights flown by both, that does not hold 0.
    """

    better: int
    worse: int
    of: int

    @property
    def text(self) -> str:
        """In words, with the verdict beside the paper, where every memory helps in flight."""
        if self.better == self.of:
            verdict = ", which agrees"
        elif self.worse:
            verdict = ", which does not agree"
        else:
            verdict = ": of the others these flights cannot tell"
        return (
            f"{self.better} of {self.of} models with memory track clearly better than {MEMORYLESS} "
            f"and {self.worse} clearly worse{verdict}"
        )


def memory(models: Sequence[Tracked]) -> Memory | None:
    """The models with memory against the memoryless one; None where either is missing."""
    plain = next((line for line in models if line.name == MEMORYLESS), None)
    others = [line for line in models if line is not plain]
    if plain is None or not others:
        return None
    apart = [above(line, plain) for line in others]
    better, worse = sum(high < 0.0 for *_, high in apart), sum(low > 0.0 for _, low, _ in apart)
    return Memory(better, worse, len(others))


def sentence(lines: Sequence[Tracked], chosen: str | None = None) -> str:
    """What the flights say of the model `chosen` on validation forces, and of a constant."""
    nothing, oracle, constant, *models = lines
    finding = (
        f"Without compensation the sufferer is {1e3 * nothing.mean_m:.1f} mm from its reference, "
        f"with the true force {1e3 * oracle.mean_m:.1f} mm. The training flights' mean force, a "
        f"constant, {share_text(constant, nothing, oracle)}"
    )
    named = {line.name: line for line in models}
    if chosen is None or chosen not in named:
        return f"{finding}."
    best, plain = named[chosen], named.get(MEMORYLESS)
    text = (
        f"{finding}; {chosen}, the best on validation, tracks to {1e3 * best.mean_m:.1f} mm and "
        f"{share_text(best, nothing, oracle)}."
    )
    if plain is not None and plain is not best:
        text += (
            f" The memoryless {MEMORYLESS} tracks to {1e3 * plain.mean_m:.1f} mm and "
            f"{share_text(plain, nothing, oracle)}."
        )
    against = memory(models)
    if against is not None:
        text += f" In the paper models with memory track better than without: here {against.text}."
    nearest = min(models, key=lambda line: line.mean_m)
    if nearest.mean_m < oracle.mean_m:
        share = recovered(nearest, nothing, oracle)
        clear = share is not None and share.low is not None and share.low > 1.0
        closer_um = 1e6 * (oracle.mean_m - nearest.mean_m)
        text += (
            f" {nearest.name} tracks closer than with the true force, by {closer_um:.0f} µm, "
            f"{'more' if clear else 'no more'} than flights and seeds scatter."
        )
    return text


def share_text(line: Tracked, nothing: Tracked, oracle: Tracked) -> str:
    """What a line reaches of the oracle's gain, in words."""
    share = recovered(line, nothing, oracle)
    if share is None:
        return "can be given no share of the oracle's gain, which is too small"
    return f"reaches {share.text} of the oracle's gain"
