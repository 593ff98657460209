"""The equations of motion of a gantry whose form is not the model's, compiled; one step a call.

In: arrays of state, tables and numbers. Out: the state, moved on. Imports numpy and numba alone.
"""

import math
from typing import Any, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

Z, SPEED, BRISTLE, SOURCE_WINDING, SOURCE, WINDING, ROTOR, CHARGE, WAKE_N, OTHER_N = range(10)
STATES = 10
COULOMB, STRIBECK, LUGRE = 0.0, 1.0, 2.0
_SUBSTEPS = 4
_GRAVITY_MPS2 = 9.81


class Numbers(NamedTuple):
    """What the equations use; effects are neutral by default. SI units."""

    mass_kg: float = 0.45
    travel_m: float = 1.2
    source_height_m: float = 2.0
    half_rho_area: float = 0.03  # ½ρ·CdA
    reference_thrust_n: float = 4.41
    first_distance_m: float = 0.4
    distance_step_m: float = 0.02
    first_lateral_m: float = -0.9
    lateral_step_m: float = 0.01
    # Motors: a rotor behind its windings, which take `winding_share` of the lag; `lag_bend` makes
    # the lag longer where the rotor is slow.
    source_up_s: float = 0.06
    source_down_s: float = 0.10
    sufferer_up_s: float = 0.06
    sufferer_down_s: float = 0.10
    winding_share: float = 0.0
    lag_bend: float = 0.0
    # Rail.
    friction: float = COULOMB
    coulomb_n: float = 0.05
    stiction_n: float = 0.08
    viscous_n_per_mps: float = 0.05
    stribeck_mps: float = 0.02
    bristle_m: float = 5e-5
    along_rail: float = 0.0  # share by which friction grows over the travel
    # Library effects.
    offset_m: float = 0.0
    deflection_s: float = 0.0
    sag_per_s: float = 0.0
    inflow_s_per_m: float = 0.0
    wake_inflow_s_per_m: float = 0.0
    ground_gain: float = 0.0
    ground_height_m: float = 0.1
    tether_n_per_m: float = 0.0
    tether_slack_m: float = 0.0
    added_mass_kg: float = 0.0
    # Beyond any library.
    detent_n: float = 0.0
    detent_m: float = 0.09
    bend_n_per_m: float = 0.0


def compiled(function: Any) -> Any:
    """Compile on first use; the machine code is kept on disk where there is a place for it."""
    try:
        return numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:
        return numba.njit(error_model="numpy")(function)


@compiled
def advance(
    y: FloatArray,  # (STATES,) changed in place
    dt_s: float,
    n: Numbers,
    targets: FloatArray,  # (2,) √N that source and sufferer are asked for
    x_m: float,
    vx_mps: float,
    gust: float,
    ring: FloatArray,  # (R,) past of √(u / u_reference), one a step
    count: int,
    speed_table: FloatArray,  # (D, L)
    delay_s: FloatArray,  # (D,)
    mixing_s: FloatArray,  # (D,)
) -> None:
    """One step of `dt_s`, in substeps: motors exactly, friction as an impulse, Euler else."""
    h = dt_s / _SUBSTEPS
    for k in range(_SUBSTEPS):
        _spool(y, SOURCE_WINDING, targets[0], n.source_up_s, n.source_down_s, h, n)
        _spool(y, WINDING, targets[1], n.sufferer_up_s, n.sufferer_down_s, h, n)
        x = x_m + vx_mps * h * k
        lateral = x - n.offset_m - n.deflection_s * vx_mps
        distance = n.source_height_m - y[Z]
        air = -air_speed(distance, lateral, n, ring, count, dt_s, speed_table, delay_s, mixing_s)
        y[WAKE_N] = -n.half_rho_area * air * air * (1.0 + gust)
        full = max(y[ROTOR], 0.0) ** 2
        weight = n.mass_kg * _GRAVITY_MPS2
        thrust = full * _factor(y, air, n)
        y[OTHER_N] = thrust - full + _further(y, x, n)
        y[CHARGE] += h * thrust / weight
        _move(y, full + y[WAKE_N] + y[OTHER_N] - weight, h, n)


@compiled
def air_speed(
    distance_m: float,
    lateral_m: float,
    n: Numbers,
    ring: FloatArray,
    count: int,
    dt_s: float,
    speed_table: FloatArray,
    delay_s: FloatArray,
    mixing_s: FloatArray,
) -> float:
    """Downward speed of the air [m/s]: the table's, times what the source did when it set out.

    Three arrivals, at the mean age and √3 spreads about it, weigh as a Gaussian spread of ages.
    """
    rows, columns = speed_table.shape
    at = min(max((distance_m - n.first_distance_m) / n.distance_step_m, 0.0), rows - 1.001)
    aside = min(max((lateral_m - n.first_lateral_m) / n.lateral_step_m, 0.0), columns - 1.001)
    i, j = int(at), int(aside)
    a, b = at - i, aside - j
    near = (1.0 - b) * speed_table[i, j] + b * speed_table[i, j + 1]
    far = (1.0 - b) * speed_table[i + 1, j] + b * speed_table[i + 1, j + 1]
    mean = (1.0 - a) * delay_s[i] + a * delay_s[i + 1]
    spread = (1.0 - a) * mixing_s[i] + a * mixing_s[i + 1]
    root = 0.0
    for k in range(3):
        age = max(mean + (k - 1) * 1.7320508 * spread, 0.0) / dt_s
        whole = int(age)
        share = age - whole
        newer, older = count - whole, count - whole - 1
        past = 0.0
        if newer >= 0:
            past += (1.0 - share) * ring[newer % len(ring)]
        if older >= 0:
            past += share * ring[older % len(ring)]
        root += (2.0 / 3.0 if k == 1 else 1.0 / 6.0) * past
    return float(((1.0 - a) * near + a * far) * root)


@compiled
def _spool(
    y: FloatArray, k: int, target: float, up_s: float, down_s: float, h: float, n: Numbers
) -> None:
    """Winding k and rotor k + 1 of one motor, √N."""
    lag = max(up_s if target > y[k + 1] else down_s, 1e-4)
    usual = math.sqrt(n.mass_kg * _GRAVITY_MPS2)
    lag *= max(1.0 + n.lag_bend * (1.0 - y[k + 1] / usual), 0.3)
    share = n.winding_share
    y[k] = target + (y[k] - target) * (math.exp(-h / (share * lag)) if share > 0.0 else 0.0)
    y[k + 1] = y[k] + (y[k + 1] - y[k]) * math.exp(-h / ((1.0 - share) * lag))


@compiled
def _factor(y: FloatArray, air: float, n: Numbers) -> float:
    """What is left of the static thrust: battery, inflow, ground."""
    thrust_share = 1.0 - n.sag_per_s * y[CHARGE]
    thrust_share *= 1.0 - n.inflow_s_per_m * y[SPEED]
    thrust_share *= 1.0 - n.wake_inflow_s_per_m * max(-air, 0.0)
    return float(thrust_share * (1.0 + n.ground_gain / (1.0 + (y[Z] / n.ground_height_m) ** 2)))


@compiled
def _further(y: FloatArray, x_m: float, n: Numbers) -> float:
    force = -n.tether_n_per_m * max(y[Z] - n.tether_slack_m, 0.0)
    force += n.detent_n * math.sin(2.0 * math.pi * y[Z] / n.detent_m)
    return float(force + n.bend_n_per_m * x_m)


@compiled
def _move(y: FloatArray, force_n: float, h: float, n: Numbers) -> None:
    """Speed and height over a substep; dry friction takes no more than stops the motion."""
    mass = n.mass_kg + n.added_mass_kg
    along = 1.0 + n.along_rail * (y[Z] / n.travel_m - 0.5)
    v = y[SPEED] + (force_n - n.viscous_n_per_mps * y[SPEED]) * h / mass
    extra = max(n.stiction_n - n.coulomb_n, 0.0) * math.exp(-((y[SPEED] / n.stribeck_mps) ** 2))
    if n.friction == LUGRE:
        v -= _bristles(y, along * (n.coulomb_n + extra), h, n) * h / mass
    else:
        dry = along * n.coulomb_n
        if n.friction == STRIBECK:
            dry = along * (n.coulomb_n + extra)
        if y[SPEED] == 0.0:
            dry = along * max(n.stiction_n, n.coulomb_n)
        v -= min(max(v * mass / h, -dry), dry) * h / mass
    y[Z] += 0.5 * h * (y[SPEED] + v)
    y[SPEED] = v
    if (y[Z] <= 0.0 and v <= 0.0) or (y[Z] >= n.travel_m and v >= 0.0):
        y[Z], y[SPEED], y[BRISTLE] = min(max(y[Z], 0.0), n.travel_m), 0.0, 0.0


@compiled
def _bristles(y: FloatArray, most_n: float, h: float, n: Numbers) -> float:
    """LuGre's friction [N] (Canudas de Wit et al. 1995), its bristle exactly over a substep."""
    stiffness, v = n.coulomb_n / n.bristle_m, y[SPEED]
    rate = stiffness * abs(v) / most_n
    before = y[BRISTLE]
    if rate * h > 1e-9:
        settled = most_n / stiffness * (1.0 if v > 0.0 else -1.0)
        y[BRISTLE] = settled + (before - settled) * math.exp(-rate * h)
    else:
        y[BRISTLE] = before + v * h
    damping = 2.0 * math.sqrt(stiffness * n.mass_kg) * 0.3
    moved = (y[BRISTLE] - before) / h
    damped = damping * moved * math.exp(-((v / 0.01) ** 2))
    return float(stiffness * 0.5 * (y[BRISTLE] + before) + damped)
