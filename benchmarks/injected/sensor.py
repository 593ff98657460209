"""The range sensor: wrong, silent, frozen, noisy, late, or looking at something else."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from benchmarks.injected.fault import Fault, Scene
from runtime.io.range_source import NOTHING_IN_RANGE_MM, STATUS_NO_TARGET, RangeReading

GROUP = "range sensor"
HAND_M, FAR_M = 0.1, 1.2
VALUES_MM = {
    "nan": math.nan,
    "inf": math.inf,
    "8190 mm": float(NOTHING_IN_RANGE_MM),
    "1e300": 1e303,
    "negative": -100.0,
    "zero": 0.0,
}

Change = Callable[[RangeReading], RangeReading]


def changes(scene: Scene, *, change: Change) -> None:
    """Each sample is another one."""
    scene.world.sense = lambda reading, t_s: [(0.0, change(reading))]


def says(scene: Scene, *, range_mm: float, status: int = 0) -> None:
    """Each sample says the same, under new time stamps."""
    changes(scene, change=lambda reading: replace(reading, range_mm=range_mm, status=status))


def bad_status(scene: Scene) -> None:
    """No target is seen, as the driver reports it."""
    nothing_mm = float(NOTHING_IN_RANGE_MM)
    says(scene, range_mm=nothing_mm, status=STATUS_NO_TARGET)


def silent(scene: Scene) -> None:
    """No new sample comes."""
    scene.world.sense = lambda reading, t_s: []


def frozen(scene: Scene) -> None:
    """The last range, under new time stamps."""
    says(scene, range_mm=scene.world.sample.range_mm)


def source_fails(scene: Scene) -> None:
    """Whoever reads the sensor has given up."""
    silent(scene)
    scene.world.ranges.failure = "the range sensor stopped answering"


def moved(reading: RangeReading, by_m: float) -> RangeReading:
    """The sample with another range."""
    return replace(reading, range_mm=max(0.0, reading.range_mm + 1e3 * by_m))


def jumps(scene: Scene, *, by_m: float) -> None:
    """Each range is off by the same."""
    changes(scene, change=lambda reading: moved(reading, by_m))


def noisy(scene: Scene, *, sd_m: float) -> None:
    """Each range has more noise."""
    changes(scene, change=lambda reading: moved(reading, sd_m * float(scene.rng.standard_normal())))


def strays(scene: Scene, *, share: float) -> None:
    """So many ranges have nothing to do with the sufferer."""

    def change(reading: RangeReading) -> RangeReading:
        is_stray, range_mm = scene.rng.random() < share, 1e3 * scene.rng.uniform(0.0, FAR_M)
        return replace(reading, range_mm=range_mm) if is_stray else reading

    changes(scene, change=change)


def late(scene: Scene, *, seconds: float, lies: bool) -> None:
    """Each sample comes later; its time stamp says so, or lies."""
    stamp_us = int(1e6 * seconds) if lies else 0
    scene.world.sense = lambda reading, t_s: [
        (seconds, replace(reading, sensor_time_us=reading.sensor_time_us + stamp_us))
    ]


def drifts(scene: Scene, *, metres_per_s: float) -> None:
    """The error grows."""
    scene.world.sense = lambda reading, t_s: [
        (0.0, moved(reading, metres_per_s * (t_s - scene.begins_s)))
    ]


def scaled(scene: Scene, *, factor: float) -> None:
    """Each range is too long or too short by a factor."""
    changes(scene, change=lambda reading: replace(reading, range_mm=factor * reading.range_mm))


def hand(scene: Scene, *, at_m: float) -> None:
    """Something is in the beam."""
    noise_mm = 1e3 * scene.rig.range_sensor.noise_m
    changes(
        scene,
        change=lambda reading: replace(
            reading, range_mm=round(1e3 * at_m + noise_mm * float(scene.rng.standard_normal()))
        ),
    )


def stamps_jump(scene: Scene, *, seconds: float) -> None:
    """Each time stamp is off by the same."""
    by_us = int(1e6 * seconds)
    changes(
        scene,
        change=lambda reading: replace(
            reading, sensor_time_us=max(0, reading.sensor_time_us + by_us)
        ),
    )


def _fault(name: str, sentence: str, begin: Callable[[Scene], None]) -> Fault:
    return Fault(f"range {name}", sentence, GROUP, begin)


def _also_for(fault: Fault, *seconds: float) -> tuple[Fault, ...]:
    return (fault, *(fault.for_a_time(one_s) for one_s in seconds))


FAULTS = (
    *(
        _fault(name, f"Each range is {name}, of good status.", partial(says, range_mm=range_mm))
        for name, range_mm in VALUES_MM.items()
    ),
    *_also_for(_fault("unseen", "Nothing is in range: 8190 mm, of bad status.", bad_status),
               0.1, 0.2, 0.3),
    *_also_for(_fault("silent", "No new sample comes.", silent), 0.1, 0.24, 0.3),
    _fault("source fails", "The sensor's driver gives up.", source_fails),
    *_also_for(_fault("frozen", "The range stays what it was, under new time stamps.", frozen),
               0.3, 0.5, 1.0),
    *(
        _fault(f"{by_m:+g} m", f"The range jumps by {by_m:+g} m.", partial(jumps, by_m=by_m))
        for by_m in (0.1, -0.1, 0.3, -0.3)
    ),
    *(
        _fault(f"noise {cm} cm", f"The range has noise of {cm} cm more.",
               partial(noisy, sd_m=0.01 * cm))
        for cm in (2, 5, 10)
    ),
    *(
        _fault(f"strays {percent} %", f"{percent} % of the ranges are anywhere within 1.2 m.",
               partial(strays, share=0.01 * percent))
        for percent in (20, 70)
    ),
    *(
        _fault(f"{ms} ms late", f"Each sample comes {ms} ms late, with its true time stamp.",
               partial(late, seconds=1e-3 * ms, lies=False))
        for ms in (100, 200)
    ),
    *(
        _fault(f"{ms} ms old", f"Each sample is {ms} ms old under a new time stamp.",
               partial(late, seconds=1e-3 * ms, lies=True))
        for ms in (100, 200)
    ),
    *(
        _fault(f"drifts {rate:+g} m/s", f"The range drifts away by {rate:+g} m/s.",
               partial(drifts, metres_per_s=rate))
        for rate in (0.05, -0.05, 0.2, -0.2)
    ),
    *(
        _fault(f"x {factor:g}", f"Each range is {factor:g} times the height.",
               partial(scaled, factor=factor))
        for factor in (1.1, 0.8)
    ),
    _fault("of a hand", f"A hand is in the beam, {HAND_M:g} m above the sensor.",
           partial(hand, at_m=HAND_M)).for_a_time(0.5),
    *(
        _fault(f"stamps {seconds:+g} s", f"The sensor's time stamps jump by {seconds:+g} s.",
               partial(stamps_jump, seconds=seconds))
        for seconds in (1.0, -1.0)
    ),
)  # fmt: skip
