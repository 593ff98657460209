"""How the planar multicopter is flown: an LQR around hover, and the pitch that answers a force.

In: a body, what its controller minimises, a reference. Out: thrust and torque. All arrays have one
row per episode.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve_discrete_are

from wakedeploy.core.errors import UnusableInput
from wakedeploy.physics.body import STATE, FloatArray
from wakedeploy.physics.rail import GRAVITY_MPS2

_X, _Z, _PITCH, _VX, _VZ, _RATE = range(len(STATE))


@dataclass(frozen=True)
class Lqr:
    """Gains (2, 6) from the deviation of the state to thrust [N] and torque [N·m]."""

    gain: FloatArray
    mass_kg: float
    thrust_n: tuple[float, float]
    torque_nm: float

    def control(
        self, state: FloatArray, reference: FloatArray, expected_n: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Thrust and torque (E,) for states and references (E, 6) and an expected force (E, 2).

        What is expected vertically is taken off the thrust; what is expected sideways is leant
        against: the reference pitch is the one at which the thrust holds it.
        """
        weight_n = self.mass_kg * GRAVITY_MPS2
        lift_n = np.maximum(weight_n - expected_n[:, 1], 0.1 * weight_n)
        leaning = reference.copy()
        leaning[:, _PITCH] += np.arctan2(expected_n[:, 0], lift_n)
        # Not by BLAS, which rounds otherwise for other numbers of episodes.
        thrust, torque = -np.einsum("ij,ej->ie", self.gain, state - leaning)
        thrust = (thrust + lift_n) / np.cos(np.clip(state[:, _PITCH], -1.0, 1.0))
        return (
            np.clip(thrust, *self.thrust_n),
            np.clip(torque, -self.torque_nm, self.torque_nm),
        )


def lqr(
    mass_kg: float,
    inertia_kgm2: float,
    *,
    dt_s: float,
    state_scale: FloatArray,
    thrust_scale_n: float,
    torque_scale_nm: float,
    thrust_n: tuple[float, float],
    torque_nm: float,
) -> Lqr:
    """The regulator of a hovering body with inputs held over `dt_s`.

    Costs are the squares of deviations over their scales: `state_scale` (6,), ordered as the
    body's `STATE`, `…_scale_…` for the inputs. `thrust_n` and `torque_nm` are limits. The Riccati
    equation is solved by scipy.
    """
    if np.any(np.asarray(state_scale) <= 0.0) or min(thrust_scale_n, torque_scale_nm) <= 0.0:
        raise UnusableInput("lqr: every scale must be above 0.")
    continuous = np.zeros((8, 8))
    continuous[_X, _VX] = continuous[_Z, _VZ] = continuous[_PITCH, _RATE] = 1.0
    continuous[_VX, _PITCH] = -GRAVITY_MPS2
    continuous[_VZ, 6] = 1.0 / mass_kg
    continuous[_RATE, 7] = 1.0 / inertia_kgm2
    discrete = expm(continuous * dt_s)
    a, b = discrete[:6, :6], discrete[:6, 6:]
    q = np.diag(np.asarray(state_scale, float) ** -2)
    r = np.diag([thrust_scale_n**-2, torque_scale_nm**-2])
    p = solve_discrete_are(a, b, q, r)
    gain = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
    return Lqr(gain, mass_kg, thrust_n, torque_nm)
