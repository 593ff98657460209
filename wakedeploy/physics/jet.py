"""The vertical jet in closed form: the paper's wake field where it has no horizontal velocity.

With the source fixed and its jet pointing straight down, the four operations of the field act on
each injected puff alone: it sinks at w_a, widens to s² = σ² + 2κτ and decays with λ. The field is
then a sum over puffs, linear in the square root of the source's thrust, and needs no grid. A wake
whose speed goes with the thrust that made it only lets each puff sink at a pace of its own.
"""

import math
from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from wakedeploy.core.rig_sections import Wake

AIR_DENSITY_KGPM3 = 1.2
LEAST_ROOT_THRUST = 1e-3  # √(u/u_reference) below which a puff's pace no longer changes
_SLOWEST_ROOT, _STRONGEST_ROOT = 0.25, 2.0  # puffs outside these may be given up on their way
FloatArray = npt.NDArray[np.float64]
Floats = npt.NDArray[np.floating[Any]]  # of any precision
Air = TypeVar("Air", float, FloatArray)  # at one place, or along a path (N,)


class PuffTable:
    """What a puff of each age contributes, computed once for a wake and a time step.

    `ages_s` (M,) rises from `newest_age_s` in steps of `dt_s` until a puff has sunk
    `reach_m` and six of its own widths.
    """

    def __init__(self, wake: Wake, dt_s: float, reach_m: float, newest_age_s: float) -> None:
        self.ages_s = newest_age_s + dt_s * np.arange(puff_count(wake, dt_s, reach_m))
        self.amplitude_mps, width2_m2 = puff_shapes(wake, self.ages_s, dt_s)  # (M,) each
        self.inverse_2width2 = 0.5 / width2_m2  # (M,)
        self.sunk_m = wake.speed_mps * self.ages_s  # (M,)

    def velocity(
        self, root_thrust: FloatArray, x_m: float, above_m: float, pace: FloatArray | None = None
    ) -> float:
        """Vertical velocity [m/s] at a lateral offset and a height relative to the source.

        `root_thrust` (M,): √(u/u_reference) when each puff was injected, newest first; `pace` (M,):
        its speed over the wake's, where that is not 1. `above_m` is the point's height minus the
        source's, negative below it.
        """
        sunk_m = self.sunk_m if pace is None else pace * self.sunk_m  # (M,)
        return float(air_mps(self, root_thrust, sunk_m, x_m, above_m))

    def weights(self, x_m: float, above_m: float) -> FloatArray:
        """What each puff (M,) adds to the velocity there, over its `root_thrust`, at one pace."""
        distance2 = x_m * x_m + (above_m + self.sunk_m) ** 2  # (M,)
        return np.asarray(-self.amplitude_mps * np.exp(-distance2 * self.inverse_2width2))


def puff_shapes(wake: Wake, ages_s: Floats, dt_s: float) -> tuple[Floats, Floats]:
    """Axial speed [m/s] at the reference thrust and width² [m²] of puffs of these ages, (M,)."""
    width2_m2 = wake.width_m**2 + 2.0 * wake.diffusivity_m2ps * ages_s
    fading = np.exp(-wake.decay_per_s * ages_s) * wake.width_m**2 / width2_m2
    return wake.strength * dt_s * fading, width2_m2


def paces(root_thrust: FloatArray, speed_exponent: float) -> FloatArray:
    """Speeds of puffs over the wake's, (M,), for the thrusts that made them."""
    return np.asarray(np.maximum(root_thrust, LEAST_ROOT_THRUST) ** (2.0 * speed_exponent))


def air_mps(
    table: PuffTable, root_thrust: FloatArray, sunk_m: Floats, x_m: float, above_m: float
) -> float:
    """The sum over puffs: as `PuffTable.velocity`, with the way [m] that each has sunk, (M,)."""
    distance2 = x_m * x_m + (above_m + sunk_m) ** 2  # (M,)
    shape = np.exp(-distance2 * table.inverse_2width2)  # (M,)
    return -np.dot(table.amplitude_mps * root_thrust, shape)  # type: ignore[no-any-return]


class VerticalJet:
    """The wake of one fixed, downward source whose thrust changes from step to step."""

    def __init__(self, wake: Wake, source_height_m: float, dt_s: float) -> None:
        self._wake = wake
        self._height_m = source_height_m
        # The thrust is held over a step, so a puff stands for the step's middle.
        self._table = PuffTable(wake, dt_s, source_height_m, 0.5 * dt_s)
        self._dt_s = dt_s
        self._length = len(self._table.ages_s)
        self._history = np.zeros(2 * self._length)  # a ring written twice: always a plain view
        self._newest = 0
        self._known = np.empty(self._length)

    def inject(self, thrust_n: float) -> None:
        """Add the puff of one step at the source's present thrust [N]."""
        root = math.sqrt(max(thrust_n, 0.0) / self._wake.reference_thrust_n)
        self._newest = (self._newest - 1) % self._length
        self._history[self._newest] = self._history[self._newest + self._length] = root

    def velocity(self, x_m: float, z_m: float) -> float:
        """Vertical air velocity [m/s], up positive, at a point of the gantry's plane."""
        roots = self._history[self._newest : self._newest + self._length]
        return self._table.velocity(roots, x_m, z_m - self._height_m, self._pace(roots))

    def velocity_ahead(
        self, x_m: float, z_m: float, lead_s: float, idle_after_s: float = math.inf
    ) -> float:
        """The velocity `lead_s` from now, from the puffs that are already in the air.

        What the source will inject in the meantime is taken as its present thrust, and after
        `idle_after_s` as none; it matters only nearer to the source than a puff sinks until then.
        """
        steps = min(round(lead_s / self._dt_s), self._length)
        idle = round(max(lead_s - idle_after_s, 0.0) / self._dt_s)
        roots = self._history[self._newest : self._newest + self._length]
        known = self._known
        known[:steps], known[steps:] = roots[0], roots[: self._length - steps]
        known[:idle] = 0.0
        return self._table.velocity(known, x_m, z_m - self._height_m, self._pace(known))

    def velocities_ahead(
        self, x_m: float, z_m: float, leads_s: Iterable[float], idle_after_s: float
    ) -> list[float]:
        """`velocity_ahead` for many leads at one place, whose puffs weigh the same for all."""
        if self._wake.speed_exponent != 0.0:
            return [self.velocity_ahead(x_m, z_m, lead_s, idle_after_s) for lead_s in leads_s]
        weights = self._table.weights(x_m, z_m - self._height_m)  # (M,)
        roots = self._history[self._newest : self._newest + self._length]
        summed = [0.0, *np.cumsum(weights).tolist()]  # at k, the sum over the k newest
        found = []
        for lead_s in leads_s:
            steps = min(round(lead_s / self._dt_s), self._length)
            idle = round(max(lead_s - idle_after_s, 0.0) / self._dt_s)
            new = roots[0] * (summed[steps] - summed[min(idle, steps)])
            found.append(float(new + roots[: self._length - steps].dot(weights[steps:])))
        return found

    def _pace(self, roots: FloatArray) -> FloatArray | None:
        """Each puff's speed over the wake's, (M,); None where all have the same."""
        exponent = self._wake.speed_exponent
        return None if exponent == 0.0 else paces(roots, exponent)


def drag_force(wake: Wake, vx_mps: float, vz_mps: Air) -> Air:
    """Vertical force [N] of moving air: ½ρ·CdA·v_z·‖v‖ (the paper, § 2D Downwash Simulator)."""
    speed_mps = math.hypot(vx_mps, vz_mps) if vx_mps else abs(vz_mps)
    return 0.5 * AIR_DENSITY_KGPM3 * wake.drag_area_m2 * vz_mps * speed_mps


def puff_count(wake: Wake, dt_s: float, reach_m: float) -> int:
    """How many puffs are still within reach: the last one has sunk past it by six widths.

    With a speed that goes with the thrust, of those made at a sixteenth to four times the reference
    thrust the slowest.
    """
    exponent = wake.speed_exponent
    root = _SLOWEST_ROOT if exponent > 0.0 else _STRONGEST_ROOT
    speed_mps = wake.speed_mps * math.pow(root, 2.0 * exponent)
    age_s = reach_m / speed_mps
    for _ in range(20):  # the width grows with the age; this converges in a few rounds
        width_m = math.sqrt(wake.width_m**2 + 2.0 * wake.diffusivity_m2ps * age_s)
        age_s = (reach_m + 6.0 * width_m) / speed_mps
    return max(2, math.ceil(age_s / dt_s))
