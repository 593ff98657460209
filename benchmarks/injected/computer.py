"""The computer: it stands still, is late, raises, or sets its wall clock."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any
from unittest import mock

from benchmarks.injected.fault import Fault, Scene
from runtime.io.range_source import TIMING_BUDGET_US, RangeReading
from runtime.loop.controller import Controller
from runtime.loop.estimator import Estimator

GROUP = "computer"
STALLS_MS = (45, 71, 95, 110, 120, 135, 150, 250, 500, 1000, 2000)
AT_WAKE_UP_MS = (120, 500, 2000)
PURE_STAGES: dict[str, Any] = {"estimate": Estimator, "control": Controller}
PROCESS_MS = (110, 250, 500, 1000)
STAGES = ("read", "estimate", "predict", "control", "write", "record")
WALL_JUMPS = {"+1 s": 1.0, "-1 s": -1.0, "+1 h": 3600.0, "-1 h": -3600.0}


class Injected(RuntimeError):
    """What a fault raises inside a tick."""


def stall(scene: Scene, *, stage: str, seconds: float) -> None:
    """The computer stands still once, before a stage."""

    def stand() -> None:
        del scene.world.before[stage]
        scene.world.stand_still(seconds)

    scene.world.before[stage] = stand


def process_stops(scene: Scene, *, seconds: float) -> None:
    """Every thread stands still: nothing is read, and what was waiting looks as if it were new."""
    world = scene.world
    waiting: list[RangeReading] = []
    waiting_until_s = 0.0

    def wait(reading: RangeReading, t_s: float) -> list[tuple[float, RangeReading]]:
        if waiting:  # the sensor holds one measurement until it is read
            return []
        stamp_us = int(1e6 * waiting_until_s) - TIMING_BUDGET_US // 2
        waiting.append(replace(reading, sensor_time_us=stamp_us))
        return [(waiting_until_s - t_s, waiting[0])]

    def stand() -> None:
        world.restore()
        nonlocal waiting_until_s
        waiting_until_s = world.monotonic() + seconds
        world.sense = wait
        world.board.to_host = lambda data: [(waiting_until_s - world.plant.t_s, data)]
        world.stand_still(seconds)
        world.restore()

    world.before["read"] = stand


def stalls(scene: Scene, *, seconds: float, every_s: float) -> None:
    """The computer stands still again and again."""
    next_s = [scene.world.monotonic()]

    def stand() -> None:
        if scene.world.monotonic() >= next_s[0]:
            scene.world.stand_still(seconds)
            next_s[0] = scene.world.monotonic() + every_s

    scene.world.before["write"] = stand


def slow_ticks(scene: Scene, *, seconds: float) -> None:
    """Every tick computes for longer before it writes."""
    scene.world.before["write"] = partial(scene.world.stand_still, seconds)


def late_wake_ups(scene: Scene, *, seconds: float) -> None:
    """Every sleep ends late."""
    scene.world.wakes_late_s = seconds


def raises(scene: Scene, *, stage: str, is_once: bool) -> None:
    """A stage raises instead of doing its work."""
    if stage in PURE_STAGES:
        owner = PURE_STAGES[stage]
        failing = _failing(owner.step, is_once)
        scene.patches.enter_context(mock.patch.object(owner, "step", failing))
        return

    def fail() -> None:
        if is_once:
            del scene.world.before[stage]
        raise Injected(stage)

    scene.world.before[stage] = fail


def _failing(step: Callable[..., object], is_once: bool) -> Callable[..., object]:
    called: list[int] = []

    def fail(*given: object, **named: object) -> object:
        if called and is_once:
            return step(*given, **named)
        called.append(1)
        raise Injected("step")

    return fail


def wall_clock(scene: Scene, *, seconds: float) -> None:
    """The wall clock jumps, as NTP sets it."""
    for name, factor in (("time", 1.0), ("time_ns", 1_000_000_000)):
        real = getattr(time, name)
        moved = partial(lambda real, by: real() + by, real, type(real())(factor * seconds))
        scene.patches.enter_context(mock.patch.object(time, name, moved))


def _raising(stage: str) -> list[Fault]:
    return [
        Fault(
            f"exception in {stage}{', for ever' if not is_once else ', once'}",
            f"The stage '{stage}' of the tick raises {'once' if is_once else 'at every tick'}.",
            GROUP,
            partial(raises, stage=stage, is_once=is_once),
            needs_predictor=stage == "predict",
        )
        for is_once in (True, False)
    ]


FAULTS = (
    *(
        Fault(
            f"stall {ms} ms",
            f"The computer stands still for {ms} ms between measurement and command.",
            GROUP,
            partial(stall, stage="write", seconds=1e-3 * ms),
        )
        for ms in STALLS_MS
    ),
    *(
        Fault(
            f"wakes up {ms} ms late",
            f"A tick begins {ms} ms late, once.",
            GROUP,
            partial(stall, stage="read", seconds=1e-3 * ms),
        )
        for ms in AT_WAKE_UP_MS
    ),
    *(
        Fault(
            f"process stops {ms} ms",
            f"Every thread stands still for {ms} ms; then old samples and answers look new.",
            GROUP,
            partial(process_stops, seconds=1e-3 * ms),
        )
        for ms in PROCESS_MS
    ),
    *(
        Fault(
            f"stalls {ms} ms every {every_s:g} s",
            f"The computer stands still for {ms} ms every {every_s:g} s.",
            GROUP,
            partial(stalls, seconds=1e-3 * ms, every_s=every_s),
        )
        for ms, every_s in ((71, 0.3), (110, 0.5), (120, 0.2), (250, 1.0))
    ),
    *(
        Fault(
            f"every tick {ms} ms late",
            f"Every tick begins {ms} ms late.",
            GROUP,
            partial(late_wake_ups, seconds=1e-3 * ms),
        )
        for ms in (10, 20)
    ),
    *(
        Fault(
            f"every command {ms} ms late",
            f"Every tick computes for {ms} ms between measurement and command.",
            GROUP,
            partial(slow_ticks, seconds=1e-3 * ms),
        )
        for ms in (10, 20, 40)
    ),
    *(fault for stage in STAGES for fault in _raising(stage)),
    *(
        Fault(
            f"wall clock {name}",
            f"The computer's wall clock jumps by {name}.",
            GROUP,
            partial(wall_clock, seconds=seconds),
        )
        for name, seconds in WALL_JUMPS.items()
    ),
)
