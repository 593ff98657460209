"""The 2D wake field in plain numpy and scipy: read this one to learn what `field` computes.

The paper's four operations in order (2D Downwash Simulator): inject, advect, diffuse, decay. It
exists to be compared with: `field.WakeField` takes the same arguments and gives the same numbers,
many times faster.
"""

import numpy as np
import numpy.typing as npt
from scipy.ndimage import convolve1d

from wakedeploy.physics.field_grid import (
    FieldGrid,
    FieldPhysics,
    FloatArray,
    blur_weights,
    check_resolved,
)


class ReferenceField:
    """The wakes of E episodes, advanced in lockstep; see `field.WakeField`."""

    def __init__(
        self, grid: FieldGrid, physics: FieldPhysics, *, dt_s: float, episodes: int = 1
    ) -> None:
        self.grid, self.dt_s, self.episodes = grid, dt_s, episodes
        self._constants = physics.for_episodes(episodes)
        check_resolved(grid, self._constants["width_m"])
        variance_m2 = 2.0 * self._constants["diffusivity_m2ps"] * dt_s  # (E,)
        self._weights_x = blur_weights(variance_m2 / grid.cell_x_m**2)  # (E, R + 1)
        self._weights_z = blur_weights(variance_m2 / grid.cell_z_m**2)
        self.velocity_mps = np.zeros((episodes, 2, grid.columns, grid.rows))
        self.sunk_m = np.zeros(episodes)

    @property
    def z_m(self) -> FloatArray:
        """Present heights of the rows (E, rows) [m]."""
        return self.grid.z_m(self.sunk_m)

    def step(
        self,
        x_m: npt.ArrayLike,
        z_m: npt.ArrayLike,
        pitch_rad: npt.ArrayLike,
        thrust_n: npt.ArrayLike,
    ) -> None:
        """Advance by `dt_s` with each episode's source at a place, a pitch and a thrust, (E,)."""
        arguments = np.broadcast_arrays(np.zeros(self.episodes), x_m, z_m, pitch_rad, thrust_n)
        for e in range(self.episodes):
            self._inject(e, *(float(values[e]) for values in arguments[1:]))
            self._sink(e)
            self.velocity_mps[e] = advected_sideways(
                self.velocity_mps[e], self.dt_s / self.grid.cell_x_m
            )
            self.velocity_mps[e] = blurred(
                self.velocity_mps[e], self._weights_x[e], self._weights_z[e]
            )
            self.velocity_mps[e] *= np.exp(-self._constants["decay_per_s"][e] * self.dt_s)

    def velocity(self, x_m: npt.ArrayLike, z_m: npt.ArrayLike) -> FloatArray:
        """Air velocity (E, 2) [m/s] at one place per episode, (E,) each, bilinearly."""
        _, x, z = np.broadcast_arrays(np.zeros(self.episodes), x_m, z_m)
        result = np.empty((self.episodes, 2))
        for e in range(self.episodes):
            i = (x[e] - self.grid.left_m) / self.grid.cell_x_m
            j = (z[e] - self.z_m[e, 0]) / self.grid.cell_z_m
            result[e] = _bilinear(self.velocity_mps[e], float(i), float(j))
        return result

    def _inject(self, e: int, x_m: float, z_m: float, pitch_rad: float, thrust_n: float) -> None:
        physics = {name: values[e] for name, values in self._constants.items()}
        distance2 = (self.grid.x_m[:, np.newaxis] - x_m) ** 2 + (self.z_m[e] - z_m) ** 2
        root = np.sqrt(max(thrust_n, 0.0) / physics["reference_thrust_n"])
        puff = np.exp(-distance2 / (2.0 * physics["width_m"] ** 2))  # (columns, rows)
        puff *= physics["strength"] * root * self.dt_s
        self.velocity_mps[e, 0] += puff * np.sin(pitch_rad)
        self.velocity_mps[e, 1] -= puff * np.cos(pitch_rad)

    def _sink(self, e: int) -> None:
        """Descend: the rows sink with the wake, and those that leave come back empty on top."""
        self.sunk_m[e] += self._constants["speed_mps"][e] * self.dt_s
        passed = int(np.floor(self.sunk_m[e] / self.grid.cell_z_m + 0.5))
        self.sunk_m[e] -= passed * self.grid.cell_z_m
        kept = self.velocity_mps[e, :, :, passed:]
        self.velocity_mps[e] = np.pad(kept, [(0, 0), (0, 0), (0, min(passed, self.grid.rows))])


def advected_sideways(velocity: FloatArray, cells_per_mps: float) -> FloatArray:
    """The field (2, columns, rows) one semi-Lagrangian step later, each cell traced back in x.

    x_src = i − v_x·Δt/Δx as in the paper; between cells the cubic through the four nearest.
    """
    columns, rows = velocity.shape[1:]
    source = np.arange(columns)[:, np.newaxis] - velocity[0] * cells_per_mps  # (columns, rows)
    source = np.clip(source, -3.0, columns + 2.0)  # further out there is nothing but air at rest
    left_columns = np.floor(source).astype(int)
    padded = np.pad(velocity, [(0, 0), (4, 4), (0, 0)])
    row = np.arange(rows)
    moved = np.zeros_like(velocity)
    for offset, weight in zip((-1, 0, 1, 2), _cubic(source - left_columns), strict=True):
        moved += weight * padded[:, left_columns + offset + 4, row]
    return moved


def _cubic(f: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Lagrange's weights of the points −1, 0, 1, 2 for a place f in [0, 1)."""
    return (
        -f * (f - 1.0) * (f - 2.0) / 6.0,
        (f + 1.0) * (f - 1.0) * (f - 2.0) / 2.0,
        -(f + 1.0) * f * (f - 2.0) / 2.0,
        (f + 1.0) * f * (f - 1.0) / 6.0,
    )


def blurred(velocity: FloatArray, weights_x: FloatArray, weights_z: FloatArray) -> FloatArray:
    """The field (2, columns, rows) after a separable blur with one-sided weights (R + 1,)."""
    sideways = convolve1d(velocity, _two_sided(weights_x), axis=1, mode="constant")
    reach = len(weights_z) - 1
    below = np.pad(sideways, [(0, 0), (0, 0), (reach, 0)], mode="edge")
    padded = np.pad(below, [(0, 0), (0, 0), (0, reach)])
    upwards = convolve1d(padded, _two_sided(weights_z), axis=2, mode="constant")
    within: FloatArray = upwards[:, :, reach : reach + velocity.shape[2]]
    return within


def _two_sided(weights: FloatArray) -> FloatArray:
    return np.concatenate([weights[:0:-1], weights])


def _bilinear(velocity: FloatArray, i: float, j: float) -> FloatArray:
    """Both components (2,) at fractional cell indices; beyond the grid the air is at rest."""
    columns, rows = velocity.shape[1:]
    if not (-1.0 < i < columns and -1.0 < j < rows):
        return np.zeros(2)
    padded = np.pad(velocity, [(0, 0), (1, 1), (1, 1)])
    left_column, low_row = int(np.floor(i)), int(np.floor(j))
    weights = np.outer(
        [left_column + 1 - i, i - left_column], [low_row + 1 - j, j - low_row]
    )  # (2, 2)
    corners = padded[:, left_column + 1 : left_column + 3, low_row + 1 : low_row + 3]
    return np.asarray(np.sum(corners * weights, axis=(1, 2)), float)
