"""A hull as slender-body theory sees it, and where its images in channel walls lie."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

WATER_KGPM3 = 1000.0


@dataclass(frozen=True)
class Hull:
    """A hull with parabolic waterlines and vertical sides, symmetric fore and aft.

    `x` along the hull counts from amidships, positive towards the bow [m].
    """

    length_m: float = 100.0
    beam_m: float = 15.0
    draught_m: float = 5.0
    midship: float = 0.98  # area of the midship section over beam times draught

    @property
    def volume_m3(self) -> float:
        """Displaced volume."""
        return 2.0 / 3.0 * self.midship * self.beam_m * self.draught_m * self.length_m

    def area_m2(self, x_m: FloatArray) -> FloatArray:
        """Sectional area S(x) = S_m (1 − (2x/L)²)."""
        largest = self.midship * self.beam_m * self.draught_m
        return np.asarray(largest * (1.0 - (2.0 * x_m / self.length_m) ** 2))

    def area_slope_m(self, x_m: FloatArray) -> FloatArray:
        """S′(x)."""
        largest = self.midship * self.beam_m * self.draught_m
        return np.asarray(-8.0 * largest * x_m / self.length_m**2)

    def blockage_m(self, x_m: FloatArray, depth_m: float) -> FloatArray:
        """How much farther apart the water beside the hull is than without it, C(x).

        A flow V across leaves a potential jump of 2 C V. Two parts: what a thin plate of the same
        draught blocks, 2h/π · ln sec(πT/2h), exact for a hull without beam (a grating: Lamb,
        Hydrodynamics, art. 306); and the way under the keel, S/2(h − T), exact where the clearance
        is small. Their sum is within 0.05 h of Taylor's expansion for a rectangle there (J. Fluid
        Mech. 59, 1973).
        """
        draught = self.draught_m
        plate = -2.0 * depth_m / math.pi * math.log(math.cos(0.5 * math.pi * draught / depth_m))
        return np.asarray(plate + 0.5 * self.area_m2(x_m) / (depth_m - draught))


def mirrors(wall_m: float | None, images: int) -> list[tuple[int, float]]:
    """The reflections in a channel with walls at ±`wall_m`, as (sign, shift [m]).

    What is at y seems to be at sign · y + shift, too. The first is the body itself. Sources keep
    their strength in a mirror, a potential jump takes the sign. Without walls, the body alone.
    """
    found = [(1, 0.0)]
    if wall_m is None:
        return found
    for n in range(1, images + 1):
        sign = -1 if n % 2 else 1
        found += [(sign, 2.0 * n * side * wall_m) for side in (-1.0, 1.0)]
    return found
