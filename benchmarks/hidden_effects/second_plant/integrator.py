"""Dormand and Prince's pair of orders 5 and 4 with step control, and events that end a step.

J. R. Dormand, P. J. Prince, *A family of embedded Runge–Kutta formulae*, J. Comp. Appl. Math. 6
(1980). The equations are those of `motion`.
"""

import numpy as np
import numpy.typing as npt

from .compiled import compiled
from .constants import Numbers
from .jet import Jet
from .motion import SPEED, STATES, Inputs, Z, derivative, driving_force, settle

FloatArray = npt.NDArray[np.float64]

_NODES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
_STAGES = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
_ERROR = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
_SHORTEST_S = 1e-7
_LONGEST_REST_S = 0.002  # how finely a resting body is asked whether it still rests
_NOTHING, _TURNS, _FLOOR, _CEILING = 0, 1, 2, 3


@compiled
def advance(
    y: FloatArray,
    t_s: float,
    until_s: float,
    tolerance: float,
    n: Numbers,
    jet: Jet,
    i: Inputs,
    history: FloatArray,
    ground: FloatArray,
) -> int:
    """Move the state y (S,) on to `until_s` in place; returns how many steps that took."""
    work = np.empty((7, STATES))
    after = np.empty(STATES)
    h = until_s - t_s
    steps = 0
    while t_s < until_s - 1e-12:
        settle(y, n, i)
        moving, direction = _moving(y, t_s, n, jet, i, history, ground)
        h = min(h, until_s - t_s)
        if not moving:
            h = min(h, _LONGEST_REST_S)
        error = _attempt(y, after, work, t_s, h, moving, direction, n, jet, i, history, ground)
        error /= tolerance
        if error > 1.0 and h > _SHORTEST_S:
            h = max(h * max(0.2, 0.9 * error**-0.2), _SHORTEST_S)
            continue
        event = _event(y, after, direction, n) if moving else _NOTHING
        if event != _NOTHING:
            h = _until_event(y, after, work, t_s, h, event, direction, n, jet, i, history, ground)
        y[:] = after
        if event != _NOTHING:
            y[SPEED] = 0.0
        if event == _FLOOR:
            y[Z] = 0.0
        elif event == _CEILING:
            y[Z] = n.travel_m
        t_s += h
        steps += 1
        h = max(h * min(5.0, 0.9 * max(error, 1e-6) ** -0.2), _SHORTEST_S)
    return steps


@compiled
def _moving(
    y: FloatArray,
    t_s: float,
    n: Numbers,
    jet: Jet,
    i: Inputs,
    history: FloatArray,
    ground: FloatArray,
) -> tuple[bool, float]:
    """Whether the body moves, and where to; a resting one is held by friction or a stop."""
    if y[SPEED] != 0.0:
        return True, np.sign(y[SPEED])
    force = driving_force(t_s, y, n, jet, i, history, ground)[0]
    held = abs(force) <= max(n.stiction_n, n.coulomb_n)
    held = held or (y[Z] <= 0.0 and force < 0.0) or (y[Z] >= n.travel_m and force > 0.0)
    return not held, np.sign(force)


@compiled
def _attempt(
    y: FloatArray,
    after: FloatArray,
    work: FloatArray,
    t_s: float,
    h: float,
    moving: bool,
    direction: float,
    n: Numbers,
    jet: Jet,
    i: Inputs,
    history: FloatArray,
    ground: FloatArray,
) -> float:
    """One step of length h from y to `after`; the largest error over 1 + |y|."""
    for stage in range(7):
        for s in range(STATES):
            slope = 0.0
            for before in range(stage):
                slope += _STAGES[stage, before] * work[before, s]
            after[s] = y[s] + h * slope
        t = t_s + h * _NODES[stage]
        derivative(t, after, work[stage], moving, direction, n, jet, i, history, ground)
    worst = 0.0
    for s in range(STATES):
        error = 0.0
        for stage in range(7):
            error += _ERROR[stage] * work[stage, s]
        worst = max(worst, abs(h * error) / (1.0 + abs(y[s])))
    return worst


@compiled
def _event(y: FloatArray, after: FloatArray, direction: float, n: Numbers) -> int:
    """What the step ran into: nothing, a turn of the motion under friction, or an end stop."""
    if after[Z] < 0.0 and direction < 0.0:
        return _FLOOR
    if after[Z] > n.travel_m and direction > 0.0:
        return _CEILING
    if after[SPEED] * direction < 0.0 and n.coulomb_n + n.stiction_n > 0.0:
        return _TURNS
    return _NOTHING


@compiled
def _until_event(
    y: FloatArray,
    after: FloatArray,
    work: FloatArray,
    t_s: float,
    h: float,
    event: int,
    direction: float,
    n: Numbers,
    jet: Jet,
    i: Inputs,
    history: FloatArray,
    ground: FloatArray,
) -> float:
    """The step's length up to the event, by bisection; `after` is the state there."""
    low, high = 0.0, h
    for _ in range(24):
        h = 0.5 * (low + high)
        _attempt(y, after, work, t_s, h, True, direction, n, jet, i, history, ground)
        if _event(y, after, direction, n) == _NOTHING:
            low = h
        else:
            high = h
    return h
