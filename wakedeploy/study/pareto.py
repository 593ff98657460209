"""What accuracy costs: each architecture's error against its parameters and its step's time.

In: episode sets and the runs of study 1. Out: for each domain and architecture the test error over
the seeds, trainable weights, and the paced p99 of the exported step; who is on the front of each.
Beside them the errors of what learns nothing, which has neither weights nor a step.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.study.domains import Line, by_predictor
from wakedeploy.study.runs import obtained_run

Cost = Callable[["Point"], tuple[float, float]]  # at least and at most
OnTick = Callable[[int, int], None]
CHEAPER = 10.0  # the sentence says what a step this many times cheaper costs
ROUNDS = 4  # each model is flown so often, in turns with the others
_PREDICT = "t_predict_s"  # the stage of the loop in which the package is stepped


@dataclass(frozen=True)
class Point:
    """One architecture on one domain.

    `errors` are RMSE over standard deviation on test episodes, one per seed. `steps_p99_ms` are the
    99th percentiles of what the loop spends on predicting, paced at 32 Hz, one per round of flying;
    the weights of all seeds cost the same. `frozen` weights are drawn once and not trained. `hyper`
    says of each seed what differs from the usual hyper-parameters. `flash_bytes`, `ram_bytes` and
    `instructions` are what a step takes as C on a microcontroller (`export.c.cost`); 0 if unknown.
    """

    domain: str
    arch: str
    errors: tuple[float, ...]
    trainable: int
    frozen: int
    steps_p99_ms: tuple[float, ...]
    hyper: tuple[str, ...] = ()
    flash_bytes: int = 0
    ram_bytes: int = 0
    instructions: int = 0

    @property
    def error(self) -> float:
        """The mean over the seeds."""
        return float(np.mean(self.errors))

    @property
    def spread(self) -> float | None:
        """The standard deviation over the seeds; None for one seed."""
        return float(np.std(self.errors, ddof=1)) if len(self.errors) > 1 else None

    @property
    def step_p99_ms(self) -> float:
        """The 99th percentile of the quietest round: other programs only make a step slower."""
        return min(self.steps_p99_ms)

    def as_json(self) -> dict[str, Any]:
        """The point with every number."""
        numbers = {"error": self.error, "spread": self.spread, "step_p99_ms": self.step_p99_ms}
        return asdict(self) | numbers


def by_parameters(point: Point) -> tuple[float, float]:
    """The cost in trainable weights, which is known."""
    return float(point.trainable), float(point.trainable)


def by_step(point: Point) -> tuple[float, float]:
    """The cost in milliseconds a step, p99: of the quietest round and of the loudest."""
    return point.step_p99_ms, max(point.steps_p99_ms)


def by_flash(point: Point) -> tuple[float, float]:
    """The cost in kilobytes of flash for the weights of its C, which is counted."""
    return 1e-3 * point.flash_bytes, 1e-3 * point.flash_bytes


def by_ram(point: Point) -> tuple[float, float]:
    """The cost in kilobytes of RAM for the state and a step of its C, which is counted."""
    return 1e-3 * point.ram_bytes, 1e-3 * point.ram_bytes


def by_instructions(point: Point) -> tuple[float, float]:
    """The cost in thousands of instructions of a step of its C, which is estimated."""
    return 1e-3 * point.instructions, 1e-3 * point.instructions


def front(points: Sequence[Point], cost: Cost) -> list[Point]:
    """The points that no other beats, the cheapest first.

    One beats another that errs more, unless it surely costs more, and one that errs as much if it
    surely costs less: costs that overlap are no different.
    """
    kept = [p for p in points if not any(_beats(other, p, cost) for other in points)]
    return sorted(kept, key=lambda p: (cost(p), p.error))


def _beats(point: Point, other: Point, cost: Cost) -> bool:
    (least, most), (other_least, other_most) = cost(point), cost(other)
    if point.error == other.error:
        return most < other_least
    return point.error < other.error and least <= other_most


def unlearned(lines: Sequence[Line]) -> dict[str, float]:
    """Error of what learns nothing: predicting zero, and the observer that a set may carry."""
    return {line.predictor: line.error for line in lines if line.seed is None}


def measure(
    data: EpisodeSet,
    lines: Sequence[Line],
    runs: Path,
    *,
    ticks: int,
    on_tick: OnTick = lambda done, total: None,
) -> list[Point]:
    """The points of one domain, each architecture flown `ticks` ticks as `bench latency` flies.

    `lines` are study 1's, those with the whole past. Raises CheckFailed where this machine is too
    busy to pace the loop.
    """
    from runtime.bench import bench_latency

    learned = by_predictor([line for line in lines if line.seed is not None])
    trained = {arch: obtained_run(data, _first(of_arch), runs) for arch, of_arch in learned.items()}
    with tempfile.TemporaryDirectory() as folder:
        paths = [_packaged(run, Path(folder) / f"{arch}.onnx") for arch, run in trained.items()]
        chips = {arch: _on_a_chip(path) for arch, path in zip(trained, paths, strict=True)}
        total = len(paths) * ticks
        rounds = []
        for done in range(ROUNDS):
            flown = partial(_ticked, on_tick, total * done // ROUNDS, total)
            rounds.append(bench_latency(paths, ticks=ticks // ROUNDS, progress=flown))
    return [
        Point(
            domain=data.domain,
            arch=arch,
            errors=tuple(line.error for line in of_arch),
            trainable=trained[arch].metrics.trainable,
            frozen=trained[arch].metrics.frozen,
            steps_p99_ms=tuple(row.stages_ms[_PREDICT]["p99"] for row in rows),
            hyper=tuple(line.hyper_text for line in of_arch),
            **chips[arch],
        )
        for (arch, of_arch), *rows in zip(learned.items(), *rounds, strict=True)
    ]


def _ticked(on_tick: OnTick, before: int, total: int, here: int, _: int) -> None:
    on_tick(before + here, total)


def _first(lines: Sequence[Line]) -> Any:
    """What was wanted for the first seed's line."""
    return next(line.wanted for line in lines if line.wanted is not None)


def _packaged(run: Any, path: Path) -> Path:
    from export.step_time import unproved_package
    from wakedeploy.core.package import write_package

    write_package(unproved_package(run.predictor, run.config), path)
    return path


def _on_a_chip(path: Path) -> dict[str, int]:
    """What a package takes as C."""
    from export.c.cost import c_cost
    from wakedeploy.core.package import read_package

    return asdict(c_cost(read_package(path)))


def sentence(domain: str, points: Sequence[Point]) -> str:
    """Who is on each front, and what a tenfold cheaper step costs in error."""
    steps, weights = front(points, by_step), front(points, by_parameters)
    text = (
        f"On {domain}, none beats {_named(steps)} in both error and step time, and none "
        f"{_named(weights)} in both error and parameters."
    )
    return f"{text} {_cheaper(points)}"


def _named(points: Sequence[Point]) -> str:
    names = [point.arch for point in points]
    return names[0] if len(names) < 2 else f"{', '.join(names[:-1])} and {names[-1]}"


def _cheaper(points: Sequence[Point]) -> str:
    """The most accurate against the best of those whose step costs a tenth of its own."""
    best = front(points, by_step)[-1]
    stated = f"{best.arch} errs least, by {best.error:.3g} standard deviations at"
    stated += f" {best.step_p99_ms:.3g} ms a step"
    cheap = [p for p in points if CHEAPER * by_step(p)[1] <= best.step_p99_ms]
    if cheap:
        other = min(cheap, key=lambda p: (p.error, p.step_p99_ms))
        return (
            f"{stated}; a step at least {CHEAPER:.0f} times cheaper costs a factor of "
            f"{other.error / best.error:.2g} in error ({other.arch}, {other.error:.3g} at "
            f"{other.step_p99_ms:.3g} ms)."
        )
    surely = [p for p in points if by_step(p)[1] < by_step(best)[0]]
    if not surely:
        return f"{stated}, and no step is surely cheaper."
    cheapest = min(surely, key=by_step)
    return (
        f"{stated}; no step is {CHEAPER:.0f} times cheaper: {cheapest.arch}'s, the cheapest that "
        f"surely is, takes {cheapest.step_p99_ms:.3g} ms, "
        f"{best.step_p99_ms / cheapest.step_p99_ms:.2g} times less, for an error of "
        f"{cheapest.error:.3g}."
    )
