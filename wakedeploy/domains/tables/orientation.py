"""One angle from the four columns of a quaternion: yaw, pitch or roll.

In: x, y, z and w of a log. Out: the angle, NaN where there is none, and what was noticed.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from wakedeploy.domains.tables.columns import Angle
from wakedeploy.domains.tables.series import Place

Vector = NDArray[np.float64]

_UNEVEN = 0.05  # by which lengths of one log's quaternions may differ
_ROUNDED = 0.01  # by which a length may miss 1, in a log of few digits
_UPRIGHT = np.sin(np.deg2rad(89.0))  # of a pitch beyond which yaw and roll are one


def angle_of(place: Place, angle: Angle, parts: Sequence[Vector], notes: list[str]) -> Vector:
    """The angle [rad] (n,) of quaternions whose parts are x, y, z and w, (n,) each.

    The angles turn about z, then y, then x, as those of ROS (REP 103). A quaternion of zeros, which
    a sensor without an orientation sends, has no angle. Raises UnusableInput for what is none.
    """
    if len({len(part) for part in parts}) > 1:
        raise place.refused("has parts of several lengths", "name x, y, z and w of one message")
    stacked = np.vstack(parts)
    length = np.sqrt((stacked**2).sum(axis=0))
    has_angle = length > 0.0  # nor is NaN
    if not has_angle.any() and (length == 0.0).any():
        reason = "is 0, 0, 0, 0 in every row: what sent it measures no orientation"
        raise place.refused(reason, "choose another column")
    _require_one_length(place, length)
    with np.errstate(invalid="ignore", divide="ignore"):
        x, y, z, w = np.where(has_angle, stacked / length, np.nan)
    sine = np.clip(2.0 * (w * y - z * x), -1.0, 1.0)
    notes += _remarks(place, angle, length[has_angle], sine)
    if angle == "pitch":
        return np.asarray(np.arcsin(sine))
    if angle == "yaw":
        return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    return np.asarray(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))


def is_orientation(parts: Sequence[Vector]) -> bool:
    """Whether four columns that move have one length all along, as a quaternion's have."""
    if len({len(part) for part in parts}) > 1 or not any(np.ptp(part) for part in parts):
        return False
    length = np.sqrt((np.vstack(parts) ** 2).sum(axis=0))
    there = length[length > 0.0]
    return len(there) > 1 and bool((np.abs(there / np.median(there) - 1.0) < _UNEVEN).all())


def _require_one_length(place: Place, length: Vector) -> None:
    usual = float(np.median(length[length > 0.0])) if (length > 0.0).any() else 1.0
    is_odd = (length > 0.0) & ~(np.abs(length / usual - 1.0) < _UNEVEN)
    if is_odd.any():
        at = int(np.argmax(is_odd))
        raise place.refused(
            f"is no orientation in {place.row(at)}: a quaternion's length is that of all others,"
            f" here {length[at]:.4g} and usually {usual:.4g}",
            "name x, y, z and w of one quaternion, in this order",
        )


def _remarks(place: Place, angle: Angle, length: Vector, sine: Vector) -> Iterator[str]:
    of = f"{place.log.path}, column {place.address!r}"
    usual = float(np.median(length)) if len(length) else 1.0
    if abs(usual - 1.0) > _ROUNDED:
        yield f"{of}: its length is {usual:.4g} and not 1; it is divided by it"
    upright = int((np.abs(sine) > _UPRIGHT).sum())
    if upright and angle != "pitch":
        yield f"{of}: nose up or down in {upright} samples, where yaw and roll are one and may jump"
