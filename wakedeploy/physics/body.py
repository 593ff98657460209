"""The planar multicopter of the 2D downwash simulator: thrust along its axis, a torque in pitch.

World axes x right, z up. Pitch θ turns the thrust towards −x: it points along (−sin θ, cos θ), and
the jet opposite to it (the paper, 2D Downwash Simulator). A body on a vertical rail is in `rail`.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput
from wakedeploy.physics.rail import GRAVITY_MPS2

FloatArray = npt.NDArray[np.float64]

STATE = ("x_m", "z_m", "pitch_rad", "vx_mps", "vz_mps", "pitch_rate_radps")


def thrust_vector_n(thrust_n: FloatArray, pitch_rad: FloatArray) -> FloatArray:
    """Thrust (...) at a pitch (...) as components (..., 2) in world axes x, z."""
    return np.stack([-thrust_n * np.sin(pitch_rad), thrust_n * np.cos(pitch_rad)], axis=-1)


@dataclass(frozen=True)
class PlanarBody:
    """A rigid body in the XZ plane; mass and pitch inertia are one number or one per episode."""

    mass_kg: float | FloatArray
    inertia_kgm2: float | FloatArray

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not np.all(np.isfinite(value) & (np.asarray(value) > 0.0)):
                raise UnusableInput(
                    f"PlanarBody: {name} is {value}; it must be finite and above 0."
                )

    def step(
        self,
        state: FloatArray,
        thrust_n: npt.ArrayLike,
        torque_nm: npt.ArrayLike,
        force_n: npt.ArrayLike,
        dt_s: float,
    ) -> FloatArray:
        """The state (E, 6), ordered as `STATE`, after `dt_s` of inputs held over the step.

        `thrust_n` and `torque_nm` are (E,), `force_n` (E, 2) is what else pushes, gravity apart.
        The fourth-order Runge–Kutta method, written out: the pitch depends on the torque alone and
        is exact, which leaves Simpson's rule for the velocity. Exact while the pitch rests.
        """
        pitch, pitch_rate = state[..., 2], state[..., 5]
        pitch_acceleration = np.asarray(torque_nm, float) / self.inertia_kgm2
        half_s = 0.5 * dt_s
        pitch_half = pitch + pitch_rate * half_s + 0.5 * pitch_acceleration * half_s**2
        pitch_end = pitch + pitch_rate * dt_s + 0.5 * pitch_acceleration * dt_s**2
        start, middle, end = (
            self._acceleration_mps2(angle, thrust_n, force_n)
            for angle in (pitch, pitch_half, pitch_end)
        )
        place, velocity = state[..., 0:2], state[..., 3:5]
        after = np.empty_like(state)
        after[..., 0:2] = place + velocity * dt_s + (start + 2.0 * middle) * dt_s**2 / 6.0
        after[..., 2] = pitch_end
        after[..., 3:5] = velocity + (start + 4.0 * middle + end) * dt_s / 6.0
        after[..., 5] = pitch_rate + pitch_acceleration * dt_s
        return after

    def _acceleration_mps2(
        self, pitch_rad: FloatArray, thrust_n: npt.ArrayLike, force_n: npt.ArrayLike
    ) -> FloatArray:
        total_n = thrust_vector_n(np.asarray(thrust_n, float), pitch_rad) + np.asarray(force_n)
        acceleration = total_n / np.asarray(self.mass_kg, float)[..., np.newaxis]  # (E, 2)
        acceleration[..., 1] -= GRAVITY_MPS2
        return np.asarray(acceleration, float)
