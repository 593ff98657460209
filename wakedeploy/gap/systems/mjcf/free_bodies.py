"""A body that moves freely, as six axes: three along the world's, and three angles.

In: states of the axes. Out: MuJoCo's positions, and the rates of the angles. MuJoCo has speeds
along the world's axes, turning rates about the body's own, and a quaternion. As states, four
numbers of which three are free would each get noise of their own. Roll, pitch and yaw are free of
that; they turn about x, y and z, yaw last (Diebel, Representing Attitude, Stanford 2006). Where
pitch nears 90°, the rates of roll and yaw have no end.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.gap.systems.system import FloatArray

if TYPE_CHECKING:
    from wakedeploy.gap.systems.mjcf.elements import Joint

_STEEP_DEG, _FAR_M = 80.0, 1e4
SLIDES, ANGLES, TURNS = ("x", "y", "z"), ("roll", "pitch", "yaw"), ("p", "q", "r")


def quaternion(roll: Any, pitch: Any, yaw: Any) -> FloatArray:
    """The orientation (4, …), real part first, of angles (…) [rad]."""
    half = [np.asarray(angle, dtype=float) / 2.0 for angle in (roll, pitch, yaw)]
    (sr, sp, sy), (cr, cp, cy) = ([f(h) for h in half] for f in (np.sin, np.cos))
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def twist(angles: Sequence[Any], pushes: Sequence[Any], centre: FloatArray) -> Sequence[Any]:
    """The torques (3, …) about a body's own axes of pushes along the world's (3, …) at a centre.

    `centre` (3,) is in the body's axes, from its origin.
    """
    w, x, y, z = quaternion(*angles)
    a, b, c = (np.asarray(push, dtype=float) for push in pushes)
    along = (  # the push in the body's axes
        (1 - 2 * (y * y + z * z)) * a + 2 * (x * y + w * z) * b + 2 * (x * z - w * y) * c,
        2 * (x * y - w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z + w * x) * c,
        2 * (x * z + w * y) * a + 2 * (y * z - w * x) * b + (1 - 2 * (x * x + y * y)) * c,
    )
    return (
        centre[1] * along[2] - centre[2] * along[1],
        centre[2] * along[0] - centre[0] * along[2],
        centre[0] * along[1] - centre[1] * along[0],
    )


def angle_rates(angles: Sequence[Any], turns: Sequence[Any]) -> tuple[Any, Any, Any]:
    """How fast roll, pitch and yaw change [rad/s] where the body turns by p, q, r [rad/s]."""
    (roll, pitch, _), (p, q, r) = angles, turns
    about = q * np.sin(roll) + r * np.cos(roll)
    return p + about * np.tan(pitch), q * np.cos(roll) - r * np.sin(roll), about / np.cos(pitch)


def turning(angles: Sequence[Any], rates: Sequence[Any]) -> tuple[Any, Any, Any]:
    """The reverse: p, q, r [rad/s] where roll, pitch and yaw change so fast [rad/s]."""
    (roll, pitch, _), (of_roll, of_pitch, of_yaw) = angles, rates
    along = of_yaw * np.cos(pitch)
    return (
        of_roll - of_yaw * np.sin(pitch),
        of_pitch * np.cos(roll) + along * np.sin(roll),
        along * np.cos(roll) - of_pitch * np.sin(roll),
    )


def place_notes(axes: Sequence["Joint"], outputs: Mapping[str, FloatArray]) -> list[str]:
    """What to know of where logs (N,) of a body have been: upright, or far from the origin."""
    notes = []
    for axis in axes:
        values = outputs.get(axis.position)
        if values is None or not np.isfinite(values).any():
            continue
        most = float(np.nanmax(np.abs(values)))
        if axis.word.endswith("_pitch") and np.degrees(most) > _STEEP_DEG:
            notes.append(
                f"{axis.position} reaches {np.degrees(most):.0f}°. Where a body points straight up "
                "or down, roll and yaw are one, and small errors of the angles are large ones of "
                "how it turns: leave such parts out."
            )
        elif not axis.turns and most > _FAR_M:
            notes.append(
                f"{axis.position} is up to {most / 1e3:.0f} km from the origin, which hides how "
                f"far it moves: take that off by offset in [columns.{axis.position}] of "
                "columns.toml."
            )
    return notes
