"""The sufferer on its vertical rail: gravity, Coulomb and viscous friction, stiction, end stops."""

import math
from dataclasses import dataclass

from wakedeploy.core.rig import Rail

GRAVITY_MPS2 = 9.81

_SLOW_MPS = 0.02


def smooth_friction(rail: Rail, vz_mps: float) -> float:
    """Friction [N] against a motion, without jumps: Coulomb, from 2 cm/s on, and viscous.

    For estimator and controller, to which the sign of a speed near zero is noise.
    """
    return rail.coulomb_n * math.tanh(vz_mps / _SLOW_MPS) + rail.viscous_n_per_mps * vz_mps


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
        v0 = self.vz_mps
        v1 = self._velocity_after(force_n - self.mass_kg * GRAVITY_MPS2, dt_s)
        self.z_m += 0.5 * (v0 + v1) * dt_s
        self.vz_mps = v1
        self._stop_at_ends()

    def _velocity_after(self, driving_n: float, dt_s: float) -> float:
        v, rail = self.vz_mps, self.rail
        if v == 0.0 and self._held(driving_n):
            return 0.0
        direction = math.copysign(1.0, v if v != 0.0 else driving_n)
        resisting_n = rail.coulomb_n * direction + rail.viscous_n_per_mps * v
        after = v + (driving_n - resisting_n) / (self.mass_kg + self.added_kg) * dt_s
        # Friction stops a motion but does not turn it round: the next step decides afresh.
        return 0.0 if v != 0.0 and after * v < 0.0 and rail.coulomb_n > 0.0 else after

    def _held(self, driving_n: float) -> bool:
        """Whether stiction or a stop keeps a resting body where it is."""
        if abs(driving_n) <= max(self.rail.stiction_n, self.rail.coulomb_n):
            return True
        return (self.z_m <= self.floor_m and driving_n < 0.0) or (
            self.z_m >= self.travel_m and driving_n > 0.0
        )

    def _stop_at_ends(self) -> None:
        if self.z_m <= self.floor_m and self.vz_mps <= 0.0:
            self.z_m, self.vz_mps = self.floor_m, 0.0
        elif self.z_m >= self.travel_m and self.vz_mps >= 0.0:
            self.z_m, self.vz_mps = self.travel_m, 0.0
