"""Angles that begin again after a turn: where readings jump by one, and the same without that.

In: readings of an angle and their stamps. Out: readings that go on, and how many jumps there were.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.units import conversion, is_angular

Vector = NDArray[np.float64]

_ROUNDED = 0.01  # of a turn, by which readings of one turn may miss it
_FASTER = 2.0  # how much faster a step beside a jump may be than the fastest elsewhere
_FARTHEST, _FARTHEST_UNSEEN = 0.25, 0.5  # of a turn, that such a step goes; where readings are lost
_LOST = 1.5  # usual steps of time, from which readings are lost in one


@dataclass(frozen=True, eq=False)
class Unwrapped:
    """Readings (n,) that go on through turns, and at how many `places` they jumped by whole ones.

    At `doubtful` places they jump by more than half a turn, and it is none that begins again.
    """

    values: Vector
    places: int
    doubtful: int


def turn_in(unit: str) -> float | None:
    """A whole turn in a unit of angle, as 360 in "deg"; None for a unit of anything else."""
    try:
        return float(conversion("rev", unit)) if is_angular(unit) else None
    except ValueError:  # of another dimension, as rad/s
        return None


def unwrapped(
    values: Vector, turn: float, stamps_s: Vector, *, is_certain: bool = False
) -> Unwrapped:
    """Readings (n,) of an angle at `stamps_s` (n,), without the jumps of a whole turn.

    Readings beyond one turn begin nowhere again, and stay as they are. So does a jump that leaves
    more than a quarter of a turn, or than twice what the fastest of the other steps would be in
    that time. Where readings are lost, which are NaN, the angle went the shorter way.
    `is_certain` takes the shorter way at every step.
    """
    at = np.flatnonzero(np.isfinite(values))
    read = values[at]
    steps = np.diff(read)
    turns = np.round(steps / turn)
    is_jump = turns != 0.0
    if not is_jump.any() or not (is_certain or np.ptp(read) <= (1.0 + _ROUNDED) * turn):
        return Unwrapped(values, 0, 0)
    rest = np.abs(steps - turn * turns)
    is_turn = is_jump & (is_certain | (rest <= _reach(steps, np.diff(stamps_s[at]), turn)))
    gone = values.copy()
    gone[at[1:]] -= turn * np.cumsum(np.where(is_turn, turns, 0.0))
    return Unwrapped(gone, int(is_turn.sum()), int((is_jump & ~is_turn).sum()))


def _reach(steps: Vector, apart_s: Vector, turn: float) -> Vector:
    """How far an angle may have gone in each step, by what it does in the others."""
    rows = np.maximum(apart_s / np.median(apart_s), 1.0)
    is_plain = np.abs(steps) <= _FARTHEST * turn
    fastest = float(np.max(np.abs(steps[is_plain]) / rows[is_plain], initial=0.0))
    farthest = np.where(rows < _LOST, _FARTHEST, _FARTHEST_UNSEEN) * turn
    return np.minimum(np.maximum(_FASTER * fastest * rows, _ROUNDED * turn), farthest)
