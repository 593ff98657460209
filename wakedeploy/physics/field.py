"""The paper's 2D wake field, compiled: many episodes in lockstep on grids that sink with the wake.

Four operations a step, in the order of the paper (2D Downwash Simulator): inject, advect, diffuse,
decay. The rows of the grid sink at w_a, so that the descent is exact for any w_a and adds no
diffusion of its own; a row that has left at the bottom comes back empty on top. `field_reference`
is the same in plain numpy.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from wakedeploy.physics.field_grid import (
    FieldGrid,
    FieldPhysics,
    FloatArray,
    blur_weights,
    check_resolved,
)

__all__ = ["FieldGrid", "FieldPhysics", "WakeField"]

_THIRD, _SIXTH, _TWELFTH = 1.0 / 3.0, 1.0 / 6.0, 1.0 / 12.0  # factors, for divisions are slow
_SIDE = 4  # columns of air at rest that the cubic of the horizontal advection may reach into


class WakeField:
    """The wakes of E episodes, advanced in lockstep.

    A puff injected by the m-th last call of `step` has sunk, spread and decayed for m·`dt_s`. To
    compare with air that is pushed continuously, take a puff for the middle of its step.

    Raises UnusableInput for constants out of bounds and for cells coarser than the wake.
    """

    def __init__(
        self, grid: FieldGrid, physics: FieldPhysics, *, dt_s: float, episodes: int = 1
    ) -> None:
        self.grid, self.dt_s, self.episodes = grid, dt_s, episodes
        constants = physics.for_episodes(episodes)
        check_resolved(grid, constants["width_m"])
        variance_m2 = 2.0 * constants["diffusivity_m2ps"] * dt_s  # (E,)
        weights_x = blur_weights(variance_m2 / grid.cell_x_m**2)  # (E, R + 1)
        weights_z = blur_weights(variance_m2 / grid.cell_z_m**2)
        weights_z *= np.exp(-constants["decay_per_s"] * dt_s)[:, np.newaxis]  # decay for free
        self._geometry = np.array([grid.left_m, grid.bottom_m, grid.cell_x_m, grid.cell_z_m])
        self._constants = (
            constants["speed_mps"] * dt_s,
            constants["strength"] * dt_s / np.sqrt(constants["reference_thrust_n"]),
            -0.5 / constants["width_m"] ** 2,
            weights_x,
            weights_z,
        )
        self._side = max(_SIDE, weights_x.shape[1] - 1)
        padded = (2, grid.columns + 2 * self._side, grid.rows)
        self._velocity = np.zeros((episodes, *padded))
        self._scratch = np.zeros(padded)
        self._line = np.zeros(grid.rows + 2 * (weights_z.shape[1] - 1))
        self._sunk_m = np.zeros(episodes)

    @property
    def velocity_mps(self) -> FloatArray:
        """The cells' v_x and v_z (E, 2, columns, rows) [m/s], a view to read or to write."""
        return self._velocity[:, :, self._side : self._side + self.grid.columns]

    @property
    def z_m(self) -> FloatArray:
        """Present heights of the rows (E, rows) [m]."""
        return self.grid.z_m(self._sunk_m)

    def step(
        self,
        x_m: npt.ArrayLike,
        z_m: npt.ArrayLike,
        pitch_rad: npt.ArrayLike,
        thrust_n: npt.ArrayLike,
    ) -> None:
        """Advance by `dt_s` with each episode's source at a place, a pitch and a thrust, (E,).

        The jet points along (sin θ, −cos θ); a negative thrust injects nothing.
        """
        source = self._per_episode(x_m, z_m, pitch_rad, thrust_n)
        _step(
            self._velocity,
            self._sunk_m,
            source,
            self._scratch,
            self._line,
            self._side,
            self.dt_s,
            *self._constants,
            self._geometry,
        )

    def velocity(self, x_m: npt.ArrayLike, z_m: npt.ArrayLike) -> FloatArray:
        """Air velocity (E, 2) [m/s] at one place per episode, (E,) each.

        Bilinear between the cells' centres, as in the paper: low by up to Δ²/8 of the field's
        curvature. Beyond the grid the air is at rest.
        """
        result = np.zeros((self.episodes, 2))
        places = self._per_episode(x_m, z_m)
        _sample(self._velocity, self._sunk_m, places, self._side, self._geometry, result)
        return result

    def _per_episode(self, *values: npt.ArrayLike) -> FloatArray:
        """The values side by side, (E, n)."""
        result = np.empty((self.episodes, len(values)))
        for column, value in enumerate(values):
            result[:, column] = value
        return result


def _compiled(function: Callable[..., None]) -> Any:
    """Compile on first use and keep the machine code on disk, where there is a place to keep it."""
    compiler = functools.partial(numba.njit, error_model="numpy", fastmath={"contract"})
    try:
        return compiler(cache=True)(function)
    except RuntimeError:  # neither the package's folder nor the user's cache can be written to
        return compiler()(function)


@_compiled
def _step(
    velocity: FloatArray,  # (E, 2, columns + 2 sides, rows)
    sunk_m: FloatArray,  # (E,)
    source: FloatArray,  # (E, 4): x, z, pitch, thrust
    scratch: FloatArray,  # (2, columns + 2 sides, rows)
    line: FloatArray,  # (rows + 2 R,) of working space
    side: int,
    dt_s: float,
    descent_m: FloatArray,  # (E,)
    push_mps: FloatArray,  # (E,)
    steepness_per_m2: FloatArray,  # (E,)
    weights_x: FloatArray,  # (E, R + 1)
    weights_z: FloatArray,  # (E, R + 1), decay included
    geometry: FloatArray,  # left, bottom, cell_x, cell_z
) -> None:
    cell_x_m, cell_z_m = geometry[2], geometry[3]
    for e in range(velocity.shape[0]):
        _inject(velocity[e], side, sunk_m[e], source[e], push_mps[e], steepness_per_m2[e], geometry)
        sunk_m[e] += descent_m[e]
        passed = math.floor(sunk_m[e] / cell_z_m + 0.5)
        sunk_m[e] -= passed * cell_z_m
        _advect_sideways(velocity[e], scratch, side, dt_s / cell_x_m)
        _blur(scratch, velocity[e], line, side, weights_x[e], weights_z[e], passed)


@_compiled
def _inject(
    velocity: FloatArray,  # (2, columns + 2 sides, rows), changed
    side: int,
    sunk_m: float,
    source: FloatArray,  # (4,)
    push_mps: float,
    steepness_per_m2: float,
    geometry: FloatArray,
) -> None:
    """Add one step's puff; its Gaussian is a product of one in x and one in z."""
    left_m, bottom_m, cell_x_m, cell_z_m = geometry
    rows = velocity.shape[2]
    push = push_mps * math.sqrt(max(source[3], 0.0))
    push_x, push_z = push * math.sin(source[2]), -push * math.cos(source[2])
    profile = np.empty(rows)
    for j in range(rows):
        above_m = bottom_m + j * cell_z_m - sunk_m - source[1]
        profile[j] = math.exp(steepness_per_m2 * above_m * above_m)
    for i in range(velocity.shape[1] - 2 * side):
        aside_m = left_m + i * cell_x_m - source[0]
        share = math.exp(steepness_per_m2 * aside_m * aside_m)
        for j in range(rows):
            velocity[0, side + i, j] += push_x * share * profile[j]
            velocity[1, side + i, j] += push_z * share * profile[j]


@_compiled
def _advect_sideways(
    velocity: FloatArray,  # (2, columns + 2 sides, rows)
    moved: FloatArray,  # the same, written
    side: int,
    cells_per_mps: float,
) -> None:
    """Trace each cell back to x_src = i − v_x·Δt/Δx; between cells the cubic through four."""
    columns, rows = velocity.shape[1] - 2 * side, velocity.shape[2]
    for i in range(columns):
        along = velocity[0, side + i]
        far = 0  # counted, for a maximum would not be vectorised
        for j in range(rows):
            far += abs(along[j]) * cells_per_mps >= 1.0
        if far == 0:
            _advect_near(velocity, moved, side + i, cells_per_mps)
            continue
        for j in range(rows):
            source = i - velocity[0, side + i, j] * cells_per_mps
            source = min(max(source, -3.0), columns + 2.0)  # further out there is air at rest
            left_column = math.floor(source)
            f = source - left_column
            k = left_column + side
            before = -f * (f - 1.0) * (f - 2.0) / 6.0
            here = (f + 1.0) * (f - 1.0) * (f - 2.0) / 2.0
            after = -(f + 1.0) * f * (f - 2.0) / 2.0
            beyond = (f + 1.0) * f * (f - 1.0) / 6.0
            for c in range(2):
                moved[c, side + i, j] = (
                    before * velocity[c, k - 1, j]
                    + here * velocity[c, k, j]
                    + after * velocity[c, k + 1, j]
                    + beyond * velocity[c, k + 2, j]
                )


@_compiled
def _advect_near(velocity: FloatArray, moved: FloatArray, at: int, cells_per_mps: float) -> None:
    """A column whose air has gone less than a cell: the same cubic, without a choice of cells.

    The cubic goes through two cells upstream, the cell itself and one downstream. For g cells gone,
    with q = 1 − g², Lagrange's weights are sums of a part even in g and a part odd in it.
    """
    along = velocity[0, at]
    for c in range(2):
        far_left, near_left, centre = velocity[c, at - 2], velocity[c, at - 1], velocity[c, at]
        near_right, far_right, result = velocity[c, at + 1], velocity[c, at + 2], moved[c, at]
        for j in range(len(result)):
            gone = along[j] * cells_per_mps
            q = 1.0 - gone * gone
            even, odd = abs(gone) * q, gone * q
            result[j] = (
                (q - 0.5 * even) * centre[j]
                + (0.5 * gone * gone + _THIRD * even) * (near_left[j] + near_right[j])
                + (0.5 * gone + _SIXTH * odd) * (near_left[j] - near_right[j])
                - _TWELFTH * even * (far_left[j] + far_right[j])
                - _TWELFTH * odd * (far_left[j] - far_right[j])
            )


@_compiled
def _blur(
    field: FloatArray,  # (2, columns + 2 sides, rows), at rest in the sides
    blurred: FloatArray,  # the same, written
    line: FloatArray,  # (rows + 2 R,) of working space
    side: int,
    weights_x: FloatArray,  # (R + 1,)
    weights_z: FloatArray,
    passed: int,
) -> None:
    """Blur along x, then along z, dropping the `passed` lowest rows on the way."""
    rows, reach = field.shape[2], len(weights_z) - 1
    kept = max(rows - passed, 0)
    line[reach + kept :] = 0.0
    for c in range(2):
        for i in range(side, field.shape[1] - side):
            middle = line[reach : reach + kept]
            _blur_columns(field[c], i, passed, weights_x, middle)
            line[:reach] = line[reach]  # the wake flows out below: its last row goes on
            _blur_line(line, weights_z, blurred[c, i])


@_compiled
def _blur_columns(
    field: FloatArray, i: int, passed: int, weights: FloatArray, result: FloatArray
) -> None:
    """Column i and its neighbours, weighted, from row `passed` upwards."""
    centre = weights[0]
    column = field[i, passed:]
    for j in range(len(result)):
        result[j] = centre * column[j]
    for m in range(1, len(weights)):
        weight = weights[m]
        left_column, right_column = field[i - m, passed:], field[i + m, passed:]
        for j in range(len(result)):
            result[j] += weight * (left_column[j] + right_column[j])


@_compiled
def _blur_line(line: FloatArray, weights: FloatArray, result: FloatArray) -> None:
    """Each cell of a line with its neighbours, weighted; the line is R longer at both ends."""
    reach = len(weights) - 1
    centre = weights[0]
    same = line[reach:]
    for j in range(len(result)):
        result[j] = centre * same[j]
    for m in range(1, len(weights)):
        weight = weights[m]
        below, above = line[reach - m :], line[reach + m :]
        for j in range(len(result)):
            result[j] += weight * (below[j] + above[j])


@_compiled
def _sample(
    velocity: FloatArray,  # (E, 2, columns + 2 sides, rows)
    sunk_m: FloatArray,  # (E,)
    places: FloatArray,  # (E, 2)
    side: int,
    geometry: FloatArray,
    result: FloatArray,  # (E, 2), written
) -> None:
    left_m, bottom_m, cell_x_m, cell_z_m = geometry
    columns, rows = velocity.shape[2] - 2 * side, velocity.shape[3]
    for e in range(velocity.shape[0]):
        i = (places[e, 0] - left_m) / cell_x_m
        j = (places[e, 1] - bottom_m + sunk_m[e]) / cell_z_m
        result[e] = 0.0
        if not (-1.0 < i < columns and -1.0 < j < rows):
            continue
        left_column, low_row = math.floor(i), math.floor(j)
        for c in range(2):
            for column, row in (
                (left_column, low_row),
                (left_column + 1, low_row),
                (left_column, low_row + 1),
                (left_column + 1, low_row + 1),
            ):
                if 0 <= row < rows:  # the sides hold air at rest, above and below is none
                    share = (1.0 - abs(i - column)) * (1.0 - abs(j - row))
                    result[e, c] += share * velocity[e, c, side + column, row]
