"""The sufferer on its vertical rail: gravity, Coulomb and viscous friction, stiction, end stops."""

import math
from dataclasses import dataclass

from wakedeploy.core.rig_sections import Rail

GRAVITY_MPS2 = 9.81

_SLOW_MPS = 0.02


def sliding_n(
    coulomb_n: float, viscous_n_per_mps: float, vz_mps: float, smooth_mps: float
) -> float:
    """Friction [N] against a motion; Coulomb's grows within `smooth_mps` and has no jump."""
    return coulomb_n * math.tanh(vz_mps / smooth_mps) + viscous_n_per_mps * vz_mps


def smooth_friction(rail: Rail, vz_mps: float) -> float:
    """Friction [N] against a motion, without jumps: Coulomb, from 2 cm/s on, and viscous.

    For estimator and controller, to which the sign of a speed near zero is noise.
    """
    return sliding_n(rail.coulomb_n, rail.viscous_n_per_mps, vz_mps, _SLOW_MPS)


def smooth_friction_slope(rail: Rail, vz_mps: float) -> float:
    """How steeply `smooth_friction` grows with the speed [N s/m]."""
    steep = 1.0 - math.tanh(vz_mps / _SLOW_MPS) ** 2
    return rail.viscous_n_per_mps + rail.coulomb_n / _SLOW_MPS * steep


def is_held(rail: Rail, z_m: float, driving_n: float, floor_m: float, travel_m: float) -> bool:
    """Whether stiction or a stop keeps a resting body where it is."""
    if abs(driving_n) <= max(rail.stiction_n, rail.coulomb_n):
        return True
    return (z_m <= floor_m and driving_n < 0.0) or (z_m >= travel_m and driving_n > 0.0)


def slid(
    rail: Rail,
    z_m: float,
    vz_mps: float,
    driving_n: float,
    inertia_kg: float,
    floor_m: float,
    travel_m: float,
    dt_s: float,
) -> tuple[float, float]:
    """Height [m] and speed [m/s] after `dt_s` under a force [N] held over it, weight included."""
    after = 0.0
    if vz_mps != 0.0 or not is_held(rail, z_m, driving_n, floor_m, travel_m):
        direction = math.copysign(1.0, vz_mps if vz_mps != 0.0 else driving_n)
        resisting_n = rail.coulomb_n * direction + rail.viscous_n_per_mps * vz_mps
        after = vz_mps + (driving_n - resisting_n) / inertia_kg * dt_s
        # Friction stops a motion but does not turn it round: the next step decides afresh.
        if after * vz_mps < 0.0 and rail.coulomb_n > 0.0:
            after = 0.0
    z_m += 0.5 * (vz_mps + after) * dt_s
    if z_m <= floor_m and after <= 0.0:
        return floor_m, 0.0
    if z_m >= travel_m and after >= 0.0:
        return travel_m, 0.0
    return z_m, after


@dataclass
class RailBody:
    """A mass on a vertical rail between two inelastic stops at `floor_m` and `travel_m`.

    `added_kg` is what moves along without weighing anything.
    """

    mass_kg: float
    rail: Rail
    travel_m: float
    z_m: float = 0.0
    vz_mps: float = 0.0
    added_kg: float = 0.0
    floor_m: float = 0.0

    def step(self, force_n: float, dt_s: float) -> None:
        """Advance by `dt_s` under a vertical force [N] held over the step, gravity apart."""
        self.z_m, self.vz_mps = slid(
            self.rail,
            self.z_m,
            self.vz_mps,
            force_n - self.mass_kg * GRAVITY_MPS2,
            self.mass_kg + self.added_kg,
            self.floor_m,
            self.travel_m,
            dt_s,
        )
