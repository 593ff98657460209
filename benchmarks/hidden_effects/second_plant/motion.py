"""The equations of motion: spool, jet, thrust losses, Stribeck friction, a body between two stops.

The state y (S,) holds height, speed, each motor's winding and rotor (in √N, thrust = rotor²), the
charge drawn in seconds of hover, and a mast that may swing.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .compiled import compiled
from .constants import Numbers
from .jet import Jet

FloatArray = npt.NDArray[np.float64]

Z, SPEED, SOURCE_WINDING, SOURCE, WINDING, ROTOR, CHARGE, MAST, MAST_SPEED = range(9)
STATES = 9
_INSTANT_S = 1e-4


class Inputs(NamedTuple):
    """What is held over a stretch of time; `newest` counts the history's samples so far."""

    start_s: float
    x_m: float  # where the carriage is at `start_s`, as the jet sees it
    vx_mps: float
    source_target: float  # √N
    sufferer_target: float
    gust: float  # relative fluctuation of the wake's force
    newest: int
    dt_s: float


@compiled
def air_speed(
    t_s: float, distance_m: float, lateral_m: float, jet: Jet, i: Inputs, history: FloatArray
) -> float:
    """Vertical speed [m/s] of the jet's air, down negative.

    `history` (R,) is a ring of √(u / u_reference), one sample each `dt_s`.
    """
    d = max(distance_m, 0.0)
    lag = max(jet.mixing_s + jet.mixing_s_per_m * d, i.dt_s)
    dead = max(jet.delay_s + jet.delay_s_per_m * d - 2.0 * lag, 0.0)
    source, speed = _arrived(t_s, dead, lag, jet.speed_exponent, i, history)
    width = max(jet.width_m + jet.spread * d / speed, 0.01)  # slower air has longer to spread
    shape = math.exp(-jet.loss_per_m * d - 0.5 * (lateral_m / width) ** 2) / width
    return -jet.speed_m2ps * shape * source


@compiled
def _arrived(
    t_s: float, dead_s: float, lag_s: float, exponent: float, i: Inputs, history: FloatArray
) -> tuple[float, float]:
    """The source's root of thrust as it arrives, after a dead time and two equal lags; its speed.

    The speed is relative: with an exponent, air of a stronger jet moves (u / u_reference)^exponent
    times as fast, so its age counts that much more; it thins out as it runs ahead, and piles up
    where it catches up with weaker air.
    """
    if exponent != 0.0:
        return _arrived_unevenly(t_s, dead_s, lag_s, exponent, i, history)
    total = weights = 0.0
    last = min(i.newest, math.floor((t_s - dead_s) / i.dt_s))
    for back in range(len(history) - 1):
        k = last - back
        waited = (t_s - k * i.dt_s - dead_s) / lag_s
        if waited > 14.0:
            break
        weight = waited * math.exp(-waited)
        total += weight * (history[k % len(history)] if k >= 0 else 0.0)
        weights += weight
    return (total / weights if weights > 0.0 else 0.0), 1.0


@compiled
def _arrived_unevenly(
    t_s: float, dead_s: float, lag_s: float, exponent: float, i: Inputs, history: FloatArray
) -> tuple[float, float]:
    total = speeds = 0.0
    slowest = 0.2 ** abs(exponent)
    for k in range(i.newest, max(i.newest - len(history) + 1, -1), -1):
        age = t_s - k * i.dt_s
        if age * slowest > dead_s + 14.0 * lag_s:
            break
        root = history[k % len(history)]
        speed = max(root * root, 0.05) ** exponent
        waited = (age * speed - dead_s) / lag_s
        if 0.0 < waited < 14.0:
            arriving = waited * math.exp(-waited) * root * i.dt_s / lag_s
            total += arriving
            speeds += arriving * speed
    return total, (speeds / total if total > 1e-9 else 1.0)


@compiled
def settle(y: FloatArray, n: Numbers, i: Inputs) -> None:
    """Motors without a lag follow at once."""
    if max(n.source_up_s, n.source_down_s) < _INSTANT_S:
        y[SOURCE_WINDING] = y[SOURCE] = i.source_target
    if max(n.sufferer_up_s, n.sufferer_down_s) < _INSTANT_S:
        y[WINDING] = y[ROTOR] = i.sufferer_target


@compiled
def derivative(
    t_s: float,
    y: FloatArray,
    slope: FloatArray,
    moving: bool,
    direction: float,
    n: Numbers,
    jet: Jet,
    i: Inputs,
    history: FloatArray,
    ground: FloatArray,
) -> None:
    """Fill `slope` (S,) with dy/dt; friction acts against `direction`."""
    force, _, _, thrust = driving_force(t_s, y, n, jet, i, history, ground)
    weight = n.mass_kg * n.gravity_mps2
    speed = y[SPEED]
    slope[Z] = speed if moving else 0.0
    slope[SPEED] = 0.0
    if moving:
        resisting = direction * stribeck(n, speed) + n.viscous_n_per_mps * speed
        slope[SPEED] = (force - resisting) / (n.mass_kg + n.added_mass_kg)
    up, down = n.source_up_s, n.source_down_s
    _spool(y, slope, SOURCE_WINDING, i.source_target, up, down, n.electrical_share)
    up, down = n.sufferer_up_s, n.sufferer_down_s
    _spool(y, slope, WINDING, i.sufferer_target, up, down, n.electrical_share)
    slope[CHARGE] = thrust / weight
    pull = n.mast_n * (y[SOURCE] ** 2 / jet.reference_thrust_n)
    omega = 2.0 * math.pi * n.mast_hz
    slope[MAST] = y[MAST_SPEED]
    slope[MAST_SPEED] = omega**2 * (pull - y[MAST]) - 2.0 * n.mast_damping * omega * y[MAST_SPEED]


@compiled
def _spool(
    y: FloatArray, slope: FloatArray, k: int, target: float, up: float, down: float, share: float
) -> None:
    """Winding k and rotor k + 1 of one motor."""
    slope[k] = slope[k + 1] = 0.0
    if max(up, down) < _INSTANT_S:
        return
    lag = max(up if target > y[k + 1] else down, 10.0 * _INSTANT_S)
    slope[k] = (target - y[k]) / max(share * lag, _INSTANT_S)
    slope[k + 1] = (y[k] - y[k + 1]) / ((1.0 - share) * lag)


@compiled
def stribeck(n: Numbers, speed_mps: float) -> float:
    """Dry friction [N]: from `stiction_n` at rest down to `coulomb_n` in motion."""
    extra = max(n.stiction_n - n.coulomb_n, 0.0)
    return n.coulomb_n + extra * math.exp(-((speed_mps / n.stribeck_mps) ** 2))


@compiled
def driving_force(
    t_s: float,
    y: FloatArray,
    n: Numbers,
    jet: Jet,
    i: Inputs,
    history: FloatArray,
    ground: FloatArray,
) -> tuple[float, float, float, float]:
    """All vertical force [N] but rail friction; the wake's part, the hidden part, the thrust."""
    x = i.x_m + i.vx_mps * (t_s - i.start_s)
    lateral = x - n.offset_m - n.deflection_s * i.vx_mps
    air = air_speed(t_s, n.source_height_m - y[Z], lateral, jet, i, history)
    wake = -jet.drag_n_s2_per_m2 * air * air * (1.0 + i.gust)
    full = max(y[ROTOR], 0.0) ** 2
    thrust = full * thrust_factor(y, air, n, i, ground)
    weight = n.mass_kg * n.gravity_mps2
    thrust -= n.recirculation * full * full / weight * math.exp(-y[Z] / n.recirculation_height_m)
    hidden = thrust - full + further_forces(t_s, y, x, n)
    hidden -= n.tether_n_per_m * max(y[Z] - n.tether_slack_m, 0.0)
    return full + wake + hidden - weight, wake, hidden, thrust


@compiled
def thrust_factor(
    y: FloatArray, air_mps: float, n: Numbers, i: Inputs, ground: FloatArray
) -> float:
    """What is left of the sufferer's static thrust: battery, inflow, ground (table of 2 × G)."""
    weight = n.mass_kg * n.gravity_mps2
    drawn = (y[ROTOR] ** 2 + y[SOURCE] ** 2) / weight
    voltage = 1.0 - n.resistance * drawn - 0.5 * n.sag_per_s * y[CHARGE]
    voltage -= n.coupling * max(i.source_target - y[SOURCE], 0.0)
    incidence = float(1.0 - 0.5 * n.inflow_s_per_m * y[SPEED]) ** 2
    incidence *= (1.0 - 0.5 * n.wake_inflow_s_per_m * max(-air_mps, 0.0)) ** 2
    return float(voltage * voltage * incidence * np.interp(y[Z], ground[0], ground[1]))


@compiled
def further_forces(t_s: float, y: FloatArray, x_m: float, n: Numbers) -> float:
    """Forces [N] that no library knows: each is zero unless its size is set.

    A vibration in time, a detent periodic in height, a bent rail, drag in climb alone, a gust that
    comes and goes, a mast that the source swings.
    """
    force = n.vibration_n * math.sin(2.0 * math.pi * n.vibration_hz * t_s + n.vibration_phase)
    force += n.detent_n * math.sin(2.0 * math.pi * y[Z] / n.detent_m)
    force += n.bend_n_per_m * x_m
    force -= n.climb_drag_n_s2_per_m2 * max(y[SPEED], 0.0) ** 2
    if n.gust_n != 0.0 and n.gust_start_s < t_s < n.gust_end_s:
        share = (t_s - n.gust_start_s) / (n.gust_end_s - n.gust_start_s)
        force += n.gust_n * math.sin(math.pi * share) ** 2
    return float(force + y[MAST_SPEED] / (2.0 * math.pi * n.mast_hz))
