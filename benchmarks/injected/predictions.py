"""The predictor: what it says is no number, far off, the wrong way round, stuck, or late."""

import itertools
import math
from collections.abc import Callable
from functools import partial

from benchmarks.injected.fault import Fault, Scene
from runtime.loop.prediction_worker import Result

GROUP = "predictions"
CONSTANTS_N = (1e30, -1e30, 1e300, 20.0, -20.0, 5.0, -5.0, 2.0, -2.0, 1.0, -1.0, 0.0)
NO_NUMBERS = {"nan": math.nan, "+inf": math.inf, "-inf": -math.inf}
NOISE_N, DRIFT_NPS = 2.0, 0.5


def becomes(scene: Scene, *, of: Callable[[float], float]) -> None:
    """Each force becomes another."""
    scene.predictor.alter = lambda result: Result(of(result.force_n), result.ready)


def _always(force_n: float) -> Callable[[float], float]:
    return lambda _: force_n


def _times(factor: float) -> Callable[[float], float]:
    return lambda force_n: factor * force_n


def alternates(scene: Scene, *, force_n: float) -> None:
    """Up and down by turns."""
    forces_n = itertools.cycle((force_n, -force_n))
    scene.predictor.alter = lambda result: Result(next(forces_n), result.ready)


def noise(scene: Scene, *, force_n: float) -> None:
    """Nothing but noise."""
    scene.predictor.alter = lambda result: Result(
        force_n * float(scene.rng.standard_normal()), result.ready
    )


def freezes(scene: Scene) -> None:
    """The last force, again and again."""
    last_n = scene.predictor.last_n
    scene.predictor.alter = lambda result: Result(last_n, result.ready)


def drifts(scene: Scene, *, newtons_per_s: float) -> None:
    """An error that grows."""
    scene.predictor.alter = lambda result: Result(
        result.force_n + newtons_per_s * (scene.world.monotonic() - scene.begins_s), result.ready
    )


def late(scene: Scene, *, late_ones: int, of: int) -> None:
    """`late_ones` of every `of` predictions come too late."""
    turns = itertools.cycle([True] * late_ones + [False] * (of - late_ones))
    scene.predictor.alter = lambda result: None if next(turns) else result


def fails(scene: Scene) -> None:
    """The model raises; the worker reports this as NaN, and its memory stays as it was."""
    scene.predictor.alter = lambda result: Result(math.nan, result.ready)


def _fault(name: str, sentence: str, begin: Callable[[Scene], None]) -> Fault:
    return Fault(f"prediction {name}", sentence, GROUP, begin, needs_predictor=True)


_FOR_EVER = (
    *(
        _fault(name, f"The predicted force is {name}.", partial(becomes, of=_always(value)))
        for name, value in NO_NUMBERS.items()
    ),
    *(
        _fault(
            f"{value:+g} N" if value else "0 N",
            f"The predicted force is {value:+g} N at every tick.",
            partial(becomes, of=_always(value)),
        )
        for value in CONSTANTS_N
    ),
    _fault(
        "of wrong sign",
        "The predicted force has the wrong sign.",
        partial(becomes, of=_times(-1.0)),
    ),
    *(
        _fault(
            f"x {factor}",
            f"The predicted force is {factor} times too large.",
            partial(becomes, of=_times(factor)),
        )
        for factor in (2, 5)
    ),
    _fault("alternates", "The predicted force is +5 N and -5 N by turns.",
           partial(alternates, force_n=5.0)),
    _fault("is noise", f"The predicted force is noise of {NOISE_N:g} N standard deviation.",
           partial(noise, force_n=NOISE_N)),
    _fault("frozen", "The predicted force stays what it was.", freezes),
    _fault("late", "No prediction comes in time.", partial(late, late_ones=1, of=1)),
    _fault("late 1 of 2", "Every second prediction comes too late.",
           partial(late, late_ones=1, of=2)),
    _fault("late 3 of 4", "Three of four predictions come too late.",
           partial(late, late_ones=3, of=4)),
    _fault("raises", "The model raises at every step.", fails),
    _fault("drifts", f"The predicted force drifts away by {DRIFT_NPS:g} N/s.",
           partial(drifts, newtons_per_s=DRIFT_NPS)),
)  # fmt: skip
FAULTS = (*_FOR_EVER, *(fault.for_a_time(1.0) for fault in _FOR_EVER))
