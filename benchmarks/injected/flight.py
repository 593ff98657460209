"""One case flown: a fault, a moment, a pilot, and a plant that may differ from its rig file."""

import functools
import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.injected.catalogue import FAULTS
from benchmarks.injected.fault import Scene
from benchmarks.injected.world import Endless, FaultyForecast, FaultyGantry, FaultyPlant, Rows
from runtime.loop.loop import Loop
from runtime.loop.pilot import LogValue
from runtime.predictor import PackagePredictor
from runtime.reference import random_plan
from runtime.simulated import PackageForecast
from wakedeploy.core.package import read_package
from wakedeploy.core.rig import Rig
from wakedeploy.rig.file import default_rig

SECONDS, REST_S = 14.0, 1.0
AFTER_S = 3.0  # the deadman is through by then, and whatever falls has fallen
SETTLE_S = 0.25
IDLE_N = 0.01
THRUST_SD, WAKE_SD, FRICTION_FACTOR = 0.03, 0.15, 2.0
LATE = "overrun"  # says that a tick was late, not that something broke


@dataclass(frozen=True)
class Moment:
    """A phase of a flight: its name, the flight's seed and length, when the fault begins [s]."""

    phase: str
    seed: int
    begins_s: float
    seconds: float = SECONDS  # of the plan, without the rest before and after


@dataclass(frozen=True)
class Case:
    """What is flown, without a package by PID alone.

    `wake_factor` is the wake's true force over that of the model.
    """

    fault: str
    moment: Moment
    package: Path | None = None
    is_mismatched: bool = False
    wake_factor: float = 1.0

    @property
    def pilot(self) -> str:
        """What flies."""
        return "PID" if self.package is None else "package"


@dataclass(frozen=True)
class Flown:
    """What became of a case. Times in s after the fault began, speeds in m/s; None: it never was.

    `lower_mps` and `upper_mps` are the hardest contacts with each stop after that.
    """

    case: Case
    ended: str
    lower_mps: float
    upper_mps: float
    is_idle: bool
    is_whole: bool
    detected_s: float | None
    failsafe_s: float | None
    degraded_s: float | None
    degraded_for_s: float
    height_m: float  # where the sufferer was when the fault began
    reach_m: float  # how far the carriage was from home at most


def fly(case: Case) -> Flown:
    """Fly a case to its end and some seconds on."""
    scene = scene_of(case)
    scene.later(0.0, functools.partial(break_it, scene, case.fault))
    return flown(scene, case)


def break_it(scene: Scene, name: str) -> None:
    """The fault begins, and ends if it is one for a time."""
    fault = FAULTS[name]
    scene.rng = np.random.default_rng([scene.seed, zlib.crc32(name.encode())])
    scene.height_m = scene.world.plant.z_m
    if math.isfinite(fault.lasts_s):
        scene.later(fault.lasts_s, scene.restore)
    fault.begin(scene)


def flown(scene: Scene, case: Case) -> Flown:
    """Fly what has been set up as this case."""
    plant, ended = scene.world.plant, _ran(scene)
    return Flown(
        case,
        ended,
        lower_mps=_hardest(plant, "lower", scene.begins_s),
        upper_mps=_hardest(plant, "upper", scene.begins_s),
        is_idle=_is_idle(plant),
        is_whole=_is_whole(scene),
        detected_s=_first(scene, _tells_of_a_fault),
        failsafe_s=_first(scene, lambda row: row["mode"] == "FAILSAFE"),
        degraded_s=_first(scene, lambda row: row["mode"] == "DEGRADED"),
        degraded_for_s=scene.loop.tally.seconds_in("DEGRADED"),
        height_m=scene.height_m,
        reach_m=plant.reach_m,
    )


def flown_rows(case: Case) -> list[tuple[float, Mapping[str, LogValue]]]:
    """The rows of a flight without a fault, each with its time [s]."""
    scene = scene_of(case)
    scene.loop.run()
    return scene.rows.rows


def scene_of(case: Case) -> Scene:
    """The flight of a case, ready to begin; nothing breaks in it yet."""
    seed = case.moment.seed
    rig = default_rig().changed(disturbance={"rest_s": REST_S}, **FAULTS[case.fault].rig)
    rng = np.random.default_rng([seed, zlib.crc32(case.pilot.encode())])
    truth = mismatched(rig, rng) if case.is_mismatched else rig
    world = FaultyGantry(truth, seed=seed, wake_factor=case.wake_factor)
    rows = Rows(world)
    forecast = None
    if case.package is not None:
        forecast = FaultyForecast(PackageForecast(_predictor(case.package)), world)
        forecast.reset()
    plan = random_plan(rig, case.moment.seconds, seed)
    loop = Loop(
        rig, world, world.ranges, plan, worker=forecast, recorder=rows, clock=world, is_timed=False
    )
    scene = Scene(world, loop, forecast, rows, rig, rng, seed, case.moment.begins_s)
    world.on_step = scene.let_happen
    return scene


@functools.lru_cache(maxsize=4)
def _predictor(package: Path) -> PackagePredictor:
    return PackagePredictor(read_package(package))


def mismatched(rig: Rig, rng: np.random.Generator) -> Rig:
    """A plant that differs from its rig file as far as calibration leaves it; the mass is exact."""
    thrust, wake = 1.0 + np.clip(rng.standard_normal(2), -2.0, 2.0) * (THRUST_SD, WAKE_SD)
    friction = float(FRICTION_FACTOR ** rng.uniform(-1.0, 1.0))
    thrust_n = [float(thrust) * force_n for force_n in rig.thrust.sufferer.thrust_n]
    return rig.changed(
        thrust={"sufferer": {"thrust_n": thrust_n}},
        wake={"strength": float(wake) * rig.wake.strength},
        rail={name: friction * value for name, value in rig.rail.model_dump().items()},
    )


def _ran(scene: Scene) -> str:
    """Run the loop, whatever it does; how it ended."""
    loop, world = scene.loop, scene.world
    try:
        loop.run()
        ended = loop.tally.ended
    except Endless:
        return "never ended"
    except Exception as error:
        ended = f"raised {type(error).__name__}"
    scene.patches.close()
    _settle(world)
    return ended


def _settle(world: FaultyGantry) -> None:
    """Let what flies on without the loop come to rest."""
    end_s = world.monotonic() + AFTER_S
    while world.monotonic() < end_s and not (_is_idle(world.plant) and world.plant.z_m <= 0.0):
        world.stand_still(SETTLE_S)


def _is_idle(plant: FaultyPlant) -> bool:
    return max(plant.source_thrust_n, plant.sufferer_thrust_n) < IDLE_N


def _hardest(plant: FaultyPlant, stop: str, since_s: float) -> float:
    met = [
        contact.speed_mps
        for contact in plant.contacts
        if contact.stop == stop and contact.t_s > since_s
    ]
    return max(met, default=0.0)


def _tells_of_a_fault(row: Mapping[str, LogValue]) -> bool:
    named = {name for name in str(row["faults"]).split("+") if name} - {LATE}
    return bool(named) or row["mode"] in ("DEGRADED", "FAILSAFE")


def _first(scene: Scene, is_it: Callable[[Mapping[str, LogValue]], bool]) -> float | None:
    """When a row first says so, after the fault began [s]."""
    begins_s = scene.begins_s
    return next(
        (t_s - begins_s for t_s, row in scene.rows.rows if t_s >= begins_s and is_it(row)), None
    )


def _is_whole(scene: Scene) -> bool:
    """Whether every tick that the loop counted left a row, in order."""
    ticks = [int(row["tick"] or 0) for _, row in scene.rows.rows]
    return len(ticks) == scene.loop.tally.ticks and ticks == sorted(set(ticks))
