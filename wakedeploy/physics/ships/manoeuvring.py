"""A ship that steers: surge, sway and yaw, linear in drift and turning, with an autopilot.

Derivatives are Clarke, Gedling and Hine's regressions of model tests (Trans. RINA 125, 1983), in
deep water. Sway and yaw are to port, a positive rudder angle turns to port.
"""

import math
from dataclasses import dataclass

import numpy as np

from wakedeploy.physics.ships.hull import WATER_KGPM3, Hull

# Estimates, where the regressions say nothing. A rudder twice the usual: in a narrow, shallow
# channel an ordinary one cannot hold a ship against another at a fifth of its length.
RUDDER_SWAY, RUDDER_YAW = -0.008, 0.004  # of ½ρL²U² and ½ρL³U², per radian
RUDDER_LARGEST_RAD = math.radians(35.0)
SURGE_S = 80.0  # in which a speed settles
_SUBSTEPS = 5


@dataclass
class State:
    """Where a ship is and how it moves: SI units, angles in radians, earth axes.

    `speed_mps` is ahead, `drift_mps` to port, both along the ship's own axes. `course` is +1 for a
    ship that heads along x and −1 for one that comes the other way; `heading_rad` counts from
    there, to the ship's port.
    """

    x_m: float
    aside_m: float
    speed_mps: float
    course: int = 1
    heading_rad: float = 0.0
    drift_mps: float = 0.0
    turn_radps: float = 0.0

    @property
    def aside_mps(self) -> float:
        """Speed across the channel."""
        along = self.speed_mps * math.sin(self.heading_rad)
        return self.course * (along + self.drift_mps * math.cos(self.heading_rad))


class Ship:
    """A hull under its autopilot; `step` moves it."""

    def __init__(self, hull: Hull, state: State, ordered_mps: float) -> None:
        self.hull, self.state, self.ordered_mps = hull, state, ordered_mps
        self._matrices = _derivatives(hull)

    def step(self, target_m: float, sway_n: float, yaw_nm: float, dt_s: float) -> None:
        """Steer towards `target_m` across the channel for `dt_s`, under a force and a moment.

        The force is along the channel's port side, the moment turns x towards it, whichever way
        the ship heads.
        """
        mass, damping, turning, rudder = self._matrices
        s = self.state
        load = np.array([s.course * sway_n, yaw_nm])
        dt_s /= _SUBSTEPS
        for _ in range(_SUBSTEPS):
            u = s.speed_mps
            motion = np.array([s.drift_mps, s.turn_radps])
            hydrodynamic = u * (damping @ motion + turning * s.turn_radps)
            steered = u * u * rudder * self._rudder_rad(target_m)
            s.drift_mps, s.turn_radps = motion + dt_s * np.linalg.solve(
                mass, hydrodynamic + steered + load
            )
            s.speed_mps += dt_s * (self.ordered_mps - u) / SURGE_S
            s.heading_rad += dt_s * s.turn_radps
            along = s.speed_mps * math.cos(s.heading_rad)
            s.x_m += dt_s * s.course * (along - s.drift_mps * math.sin(s.heading_rad))
            s.aside_m += dt_s * s.aside_mps

    def _rudder_rad(self, target_m: float) -> float:
        """Proportional to how far the heading is from one that leads back, and against turning."""
        s, length_m = self.state, self.hull.length_m
        off = s.course * (target_m - s.aside_m) / length_m
        wanted = float(np.clip(0.7 * off, -0.2, 0.2))
        turned = s.turn_radps * length_m / s.speed_mps
        angle = 3.0 * (wanted - s.heading_rad) - 3.0 * turned
        return float(np.clip(angle, -RUDDER_LARGEST_RAD, RUDDER_LARGEST_RAD))


def _derivatives(
    hull: Hull,
) -> tuple[
    np.typing.NDArray[np.float64],
    np.typing.NDArray[np.float64],
    np.typing.NDArray[np.float64],
    np.typing.NDArray[np.float64],
]:
    """Mass (2, 2), damping per speed (2, 2), centrifugal part per speed (2,), rudder per speed²."""
    length, beam, draught = hull.length_m, hull.beam_m, hull.draught_m
    block = hull.volume_m3 / (length * beam * draught)
    wide, slim = beam / draught, beam / length
    unit = math.pi * (draught / length) ** 2
    added = -unit * np.array(
        [
            [1.0 + 0.16 * block * wide - 5.1 * slim**2, 0.67 * slim - 0.0033 * wide**2],
            [1.1 * slim - 0.041 * wide, 1.0 / 12.0 + 0.017 * block * wide - 0.33 * slim],
        ]
    )
    damped = -unit * np.array(
        [
            [1.0 + 0.40 * block * wide, -0.5 + 2.2 * slim - 0.080 * wide],
            [0.5 + 2.4 * draught / length, 0.25 + 0.039 * wide - 0.56 * slim],
        ]
    )
    scale = np.array([[1.0, length], [length, length**2]])
    mass_kg = WATER_KGPM3 * hull.volume_m3
    inertia = np.diag([mass_kg, mass_kg * (0.25 * length) ** 2])
    dynamic = 0.5 * WATER_KGPM3 * length**2
    return (
        inertia - dynamic * length * scale * added,
        dynamic * scale * damped,
        np.array([-mass_kg, 0.0]),
        dynamic * np.array([RUDDER_SWAY, RUDDER_YAW * length]),
    )
