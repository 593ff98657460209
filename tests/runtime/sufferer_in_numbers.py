"""A sufferer on its rail in plain numbers, and what a range sensor says of it."""

import math
from collections.abc import Callable, Iterator

import numpy as np

from runtime.loop.estimate import Estimate, Measurement, initial_estimate
from wakedeploy.physics.rail import GRAVITY_MPS2, smooth_friction
from wakedeploy.rig.file import default_rig

RIG = default_rig()
MASS_KG = RIG.sufferer.mass_kg
WEIGHT_N = MASS_KG * GRAVITY_MPS2
HOVER_US = RIG.thrust.sufferer.pulse(WEIGHT_N)
DT_S, AGE_S, INNER = 1.0 / 32.0, 0.02, 25


def hovering(z_m: float) -> Estimate:
    """At rest in the air, and sure of it; the motor carries the weight."""
    start = initial_estimate(0.0)
    return Estimate(
        0.0,
        np.array([z_m, 0.0, 0.0]),
        np.diag([0.005**2, 0.05**2, 0.2**2]),
        start.lateral,
        start.lateral_cov,
        math.sqrt(WEIGHT_N),
    )


def moved(
    z_m: float, push_n: Callable[[float], float], seconds: float
) -> Iterator[tuple[float, float, float]]:
    """Time [s], height [m] and speed [m/s] at every tick, the weight carried, under a push [N]."""
    t_s, vz_mps, dt_s = 0.0, 0.0, DT_S / INNER
    for _ in range(round(seconds / DT_S)):
        for _ in range(INNER):
            vz_mps += (push_n(t_s) - smooth_friction(RIG.rail, vz_mps)) / MASS_KG * dt_s
            z_m, t_s = z_m + vz_mps * dt_s, t_s + dt_s
        yield t_s, z_m, vz_mps


def reading(
    t_s: float, z_m: float, vz_mps: float, rng: np.random.Generator, noise_m: float = 0.004
) -> Measurement:
    """What the sensor said `AGE_S` ago, rounded to its millimetre."""
    said_m = z_m - AGE_S * vz_mps + noise_m * float(rng.standard_normal())
    return Measurement(t_s, round(said_m, 3), AGE_S, 0, 0)
