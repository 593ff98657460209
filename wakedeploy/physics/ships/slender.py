"""Forces between two ships by slender-body theory with images, level A: no memory.

In: where and how fast two hulls are. Out: sway force and yaw moment on the first. The water flows
as around the double body; bottom and walls are images. The case of a ship at rest is Wang's (J.
Waterways Div. ASCE 101, 1975).
"""

from dataclasses import dataclass, field

import numpy as np

from wakedeploy.physics.ships.hull import WATER_KGPM3, FloatArray, Hull, mirrors

# Of Gauss and Legendre along each hull, from −1 to 1; the integrands are smooth. Computed once: it
# is a matrix's eigenvalues, and a force asks for it dozens of times.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)
_BOTTOMS = 10  # images in bottom and surface that are summed; the rest is an integral


@dataclass(frozen=True)
class Passing:
    """Two hulls in a waterway. `depth_m` may be infinite; walls at ±`wall_m`, or none.

    `added_mass` is the sway added mass over the displaced mass of each section, k: 1 in deep water.
    """

    own_hull: Hull = field(default_factory=Hull)
    other_hull: Hull = field(default_factory=Hull)
    depth_m: float = float("inf")
    wall_m: float | None = None
    added_mass: float = 1.0
    images: int = 6

    def forces(
        self,
        ahead_m: FloatArray,
        own_aside_m: float,
        other_aside_m: float,
        own_mps: float,
        other_mps: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Sway force [N] and yaw moment [N·m] on the own ship, (n,) each.

        `ahead_m` (n,) is how far the other ship's midship is ahead; `…_aside_m` are distances from
        the channel's middle, to port positive, and so is the force. Speeds are signed: a ship that
        comes towards one is negative. The moment turns the bow to port.
        """
        ahead_m = np.atleast_1d(np.asarray(ahead_m, dtype=float))
        sway, yaw = np.zeros(len(ahead_m)), np.zeros(len(ahead_m))
        seen = mirrors(self.wall_m, self.images)
        for sign, shift in seen:
            apart = own_aside_m - sign * other_aside_m - shift
            flow = self._crossflow(self.other_hull, ahead_m, apart, other_mps)
            sway, yaw = self._added(sway, yaw, flow, own_mps, other_mps)
        for sign, shift in seen[1:]:
            apart = own_aside_m - sign * own_aside_m - shift
            flow = self._crossflow(self.own_hull, np.zeros(1), apart, own_mps)
            sway, yaw = self._added(sway, yaw, flow, own_mps, own_mps)
        return sway, yaw

    def stations(self, hull: Hull) -> tuple[FloatArray, FloatArray]:
        """Nodes [m] along a hull and their weights [m]."""
        return 0.5 * hull.length_m * _NODES, 0.5 * hull.length_m * _WEIGHTS

    def _crossflow(
        self, hull: Hull, ahead_m: FloatArray, apart_m: float, speed_mps: float
    ) -> FloatArray:
        """The flow across the own hull's stations that a passing hull's sources make, (n, s)."""
        x1, _ = self.stations(self.own_hull)
        x2, weight = self.stations(hull)
        along = x2[None, None, :] + ahead_m[:, None, None] - x1[None, :, None]
        kernel = self._kernel(along**2 + apart_m**2)
        return np.asarray(
            -speed_mps * apart_m / (2.0 * np.pi) * kernel @ (weight * hull.area_slope_m(x2))
        )

    def _kernel(self, square_m2: FloatArray) -> FloatArray:
        """Σ (r² + (2nh)²)^(−3/2) over all images in bottom and surface."""
        total = square_m2**-1.5
        if np.isinf(self.depth_m):
            return np.asarray(total)
        for n in range(1, _BOTTOMS + 1):
            total = total + 2.0 * (square_m2 + (2.0 * n * self.depth_m) ** 2) ** -1.5
        last = 2.0 * self.depth_m * (_BOTTOMS + 0.5)
        # 1 − a/√(r² + a²) without losing the digits of a small r
        reach = np.hypot(np.sqrt(square_m2), last)
        return np.asarray(total + 1.0 / (self.depth_m * reach * (reach + last)))

    def _added(
        self,
        sway: FloatArray,
        yaw: FloatArray,
        flow: FloatArray,
        own_mps: float,
        other_mps: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Sums with the forces of a cross-flow (n, s) that travels with its source."""
        x, weight = self.stations(self.own_hull)
        area, slope = self.own_hull.area_m2(x), self.own_hull.area_slope_m(x)
        inertia = 1.0 + self.added_mass
        passing = inertia * (other_mps - own_mps)
        across = (passing + own_mps) * slope
        turning = passing * (area + x * slope) + own_mps * (x * slope + inertia * area)
        return (
            sway + WATER_KGPM3 * flow @ (weight * across),
            yaw + WATER_KGPM3 * flow @ (weight * turning),
        )
