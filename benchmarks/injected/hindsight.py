"""What the best command could have made of a push: flown again by one who knows all of it.

The motors obey one who knows the truth, from the moment on at which the range sensor can show the
push at all: once it has moved the sufferer by three standard deviations of a reading. The source
idles, and the sufferer's motor gives what it takes to sink softly, or all that it has. What still
meets a stop hard then, no controller with this sensor and these motors could have saved.
"""

import math
from functools import partial

from benchmarks.injected.fault import Scene
from wakedeploy.physics.rail import GRAVITY_MPS2

SEEN_SD = 3.0
SINK_MPS, WITHIN_S = -0.4, 0.1  # the speed that is aimed at, and how soon


def seen_s(scene: Scene, force_n: float) -> float:
    """How long after a push of so much began its answer can reach the motors [s]."""
    rig = scene.rig
    moved_m = SEEN_SD * rig.range_sensor.noise_m
    shown_s = math.sqrt(2.0 * moved_m * rig.sufferer.mass_kg / abs(force_n))
    return shown_s + rig.latency.round_trip_s


def knows(scene: Scene, force_n: float) -> None:
    """From when a push can be seen, the motors obey one who knows it."""
    scene.later(seen_s(scene, force_n), partial(_takes_over, scene))


def _takes_over(scene: Scene) -> None:
    idle_us = scene.rig.limits.pulse_us[0]
    scene.world.plant.drive = lambda source, sufferer: (idle_us, _best_us(scene))


def _best_us(scene: Scene) -> float:
    """The pulse [µs] towards a soft sink, by the true forces."""
    plant, rig = scene.world.plant, scene.rig
    if plant.z_m <= 0.0:
        return rig.limits.pulse_us[0]
    mass_kg = rig.sufferer.mass_kg
    known_n = mass_kg * GRAVITY_MPS2 - plant.wake_force_n - plant.push_n
    wanted_n = known_n + mass_kg * (SINK_MPS - plant.vz_mps) / WITHIN_S
    return rig.thrust.sufferer.pulse(min(max(wanted_n, 0.0), rig.thrust.sufferer.thrust_n[-1]))
