"""What the 2D wake field and its plain twin share: the grid, the constants, the blur's weights.

In: cell sizes, extents, the paper's constants. Out: the same, checked, and arrays made from them.
Nothing here advances a field; `field` (compiled) and `field_reference` (numpy, scipy) do.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig_sections import Wake
from wakedeploy.physics.jet import AIR_DENSITY_KGPM3

FloatArray = npt.NDArray[np.float64]

# A sampled Gaussian stands for the continuous one to 1e-5 or better down to this many cells of
# standard deviation; a narrower one would inject more or less depending on where it falls.
NARROWEST_CELLS = 0.8
KERNEL_REACH = 4.0  # standard deviations of the blur at which its weights are cut off


@dataclass(frozen=True)
class FieldGrid:
    """Where the field is resolved: cell sizes, extents, world axes (x right, z up), metres.

    The defaults are 6.0 m × 4.8 m around a source near the origin. At 1.2 m above it the wake that
    diffuses against its own descent has died out. The 3.6 m below it are the paper's separation of
    2.3 m and more than half as much again. Laterally 3 m are five widths of the
    oldest puff in the paper's fluid; at a quarter of its speed, the paper's −75 %, the wake spreads
    twice as far, and needs twice the columns and 110 rows. Cells of 0.06 m are what the paper's
    wake sinks in 0.01 s.

    Cells are placed by their centres. The air is at rest left, right and above the grid; below it
    the wake flows out, its last row continued. Against the descent everything fades as
    exp(−w_a d / κ): a source 8 κ/w_a below the top edge, and a point 4 κ/w_a and the blur's own
    reach above the bottom edge, are within 0.1 % of an unbounded field's peak.
    """

    cell_x_m: float = 0.06
    cell_z_m: float = 0.06
    left_m: float = -2.97
    bottom_m: float = -3.57
    columns: int = 100
    rows: int = 80

    def __post_init__(self) -> None:
        if not (self.cell_x_m > 0.0 and self.cell_z_m > 0.0):
            raise UnusableInput(
                f"FieldGrid: cells of {self.cell_x_m} m × {self.cell_z_m} m; both must be above 0."
            )
        if self.columns < 2 or self.rows < 2:
            raise UnusableInput(
                f"FieldGrid: {self.columns} columns × {self.rows} rows; each must be at least 2."
            )

    @property
    def x_m(self) -> FloatArray:
        """Centres of the columns (columns,) [m]."""
        return self.left_m + self.cell_x_m * np.arange(self.columns, dtype=np.float64)

    def z_m(self, sunk_m: FloatArray | float = 0.0) -> FloatArray:
        """Centres of the rows (..., rows) [m], once they have sunk by `sunk_m` (...)."""
        rest_m = self.bottom_m + self.cell_z_m * np.arange(self.rows, dtype=np.float64)
        heights: FloatArray = rest_m - np.asarray(sunk_m, float)[..., np.newaxis]
        return heights


@dataclass(frozen=True)
class FieldPhysics:
    """The constants of the paper's field, each one number or one per episode (E,).

    `speed_mps` is the wake's descent w_a, `diffusivity_m2ps` κ, `decay_per_s` λ, `strength` S
    [m/s²], `width_m` σ, `reference_thrust_n` the thrust called hover.
    """

    speed_mps: float | FloatArray
    diffusivity_m2ps: float | FloatArray
    decay_per_s: float | FloatArray
    strength: float | FloatArray
    width_m: float | FloatArray
    reference_thrust_n: float | FloatArray

    @classmethod
    def of(cls, wake: Wake) -> Self:
        """The constants of a rig's `[wake]` section.

        Raises UnusableInput for a speed that depends on the thrust: the grid sinks as a whole.
        """
        if wake.speed_exponent != 0.0:
            raise UnusableInput(
                f"wake.speed_exponent = {wake.speed_exponent:g}: the 2D field has one speed for "
                "all of its air; set it to 0."
            )
        return cls(
            speed_mps=wake.speed_mps,
            diffusivity_m2ps=wake.diffusivity_m2ps,
            decay_per_s=wake.decay_per_s,
            strength=wake.strength,
            width_m=wake.width_m,
            reference_thrust_n=wake.reference_thrust_n,
        )

    def for_episodes(self, episodes: int) -> dict[str, FloatArray]:
        """Each constant as an array (E,); raises UnusableInput for one out of bounds."""
        arrays = {
            name: np.array(np.broadcast_to(np.asarray(value, float), (episodes,)))
            for name, value in vars(self).items()
        }
        for name, values in arrays.items():
            above_zero = name in ("width_m", "reference_thrust_n")
            usable = np.isfinite(values) & ((values > 0.0) if above_zero else (values >= 0.0))
            if not usable.all():
                bound = "above 0" if above_zero else "0 or more"
                raise UnusableInput(
                    f"FieldPhysics: {name} is {values[~usable][0]}; it must be finite and {bound}."
                )
        return arrays


def check_resolved(grid: FieldGrid, width_m: FloatArray) -> None:
    """Refuse a grid on which the injected Gaussian falls between the cells."""
    narrowest_m = float(np.min(width_m))
    cell_m = max(grid.cell_x_m, grid.cell_z_m)
    if narrowest_m < NARROWEST_CELLS * cell_m:
        raise UnusableInput(
            f"FieldGrid: cells of {cell_m} m are too coarse for a wake of width {narrowest_m} m; "
            f"make them {narrowest_m / NARROWEST_CELLS:.3g} m or smaller."
        )


def blur_weights(variance_cells2: FloatArray) -> FloatArray:
    """Weights (E, R + 1) of symmetric blurs, the centre first, of given variances [cells²] (E,).

    A sampled Gaussian, cut at `KERNEL_REACH` standard deviations and scaled to sum 1, whose
    parameter is chosen so that its variance is exact: cutting and sampling would otherwise make the
    field diffuse too slowly, or not at all when the blur is much narrower than a cell.
    """
    variance = np.asarray(variance_cells2, float)
    reach = np.ceil(KERNEL_REACH * np.sqrt(variance))  # (E,)
    offsets = np.arange(int(reach.max(initial=0.0)) + 1)  # (R + 1,)
    inside = offsets <= reach[:, np.newaxis]  # (E, R + 1)
    low, high = np.full(len(variance), 1e-3), np.maximum(4.0 * variance, 1.0)
    for _ in range(100):  # bisection for the Gaussian's parameter, to the last bit
        middle = np.sqrt(low * high)
        weights = _sampled_gaussian(middle, offsets, inside)
        too_wide = 2.0 * weights @ (offsets.astype(float) ** 2) > variance
        low, high = np.where(too_wide, low, middle), np.where(too_wide, middle, high)
    return weights


def _sampled_gaussian(
    parameter: FloatArray, offsets: npt.NDArray[np.int64], inside: npt.NDArray[np.bool_]
) -> FloatArray:
    weights = np.where(inside, np.exp(-0.5 * offsets**2 / parameter[:, np.newaxis]), 0.0)
    both_sides = 2.0 * weights.sum(axis=1) - weights[:, 0]
    scaled: FloatArray = weights / both_sides[:, np.newaxis]
    return scaled


def drag_force_n(velocity_mps: FloatArray, drag_area_m2: float | FloatArray) -> FloatArray:
    """Force (..., 2) [N] of air moving at (..., 2) [m/s] on a body: ½ρ·CdA·v·‖v‖.

    The paper's disturbance force (2D Downwash Simulator); `drag_area_m2` is Cd·A, (...) or one.
    """
    speed_mps = np.linalg.norm(velocity_mps, axis=-1)  # (...)
    factor = 0.5 * AIR_DENSITY_KGPM3 * np.asarray(drag_area_m2, float) * speed_mps
    force: FloatArray = factor[..., np.newaxis] * velocity_mps
    return force
