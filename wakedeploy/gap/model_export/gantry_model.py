"""The gantry's model as it is exported: the order in which the stages of the physics act.

This file is the text of the exported Python module and the source of the MATLAB script, so it keeps
to what both can say: numbers, arrays, loops, conditions. The physics itself is exported from the
functions that the simulation calls. The functions below the second mark stand for those that the
export writes for one rig: its constants, and what its effects change.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np

from wakedeploy.physics.effects.acting import in_steps
from wakedeploy.physics.jet import air_mps, drag_force, paces, puff_shapes
from wakedeploy.physics.motor import mean_thrust, spooled
from wakedeploy.physics.rail import slid
from wakedeploy.physics.range_sensor import seen_m

# exported from here on


def delayed(values: Any, k: int, delay_s: float, dt_s: float, initial: float) -> Any:
    """The value of delay_s before step k, linear between the steps."""
    whole, share = in_steps(delay_s, dt_s)
    newer = initial
    older = initial
    if k - whole >= 0:
        newer = values[k - whole]
    if k - whole - 1 >= 0:
        older = values[k - whole - 1]
    return (1.0 - share) * newer + share * older


def puff_table(c: Any, dt_s: float) -> Any:
    """What a puff of each age contributes; as the simulation's own table."""
    table = SimpleNamespace()
    ages_s = dt_s * (0.5 + np.arange(int(np.ceil(c.wake_life_s / dt_s - 1e-9))))
    table.amplitude_mps, width2_m2 = puff_shapes(c.wake, ages_s, dt_s)
    table.inverse_2width2 = 0.5 / width2_m2
    table.sunk_m = c.wake.speed_mps * ages_s
    return table


def wake_velocity(c: Any, table: Any, roots: Any, x_m: float, above_m: float) -> Any:
    """Vertical speed of the air [m/s] as a sum over puffs; roots are newest first."""
    sunk_m = table.sunk_m
    if c.wake.speed_exponent != 0.0:
        sunk_m = sunk_m * paces(roots, c.wake.speed_exponent)
    return air_mps(table, roots, sunk_m, x_m, above_m)


def started(
    c: Any,
    z0_m: float,
    x0_m: float,
    frame_phase_s: float,
    range_phase_s: float,
    reading_phase_s: float,
    puffs: int,
) -> Any:
    """The state before the first step: at rest, motors idle, no wake in the air, no play taken."""
    s = SimpleNamespace()
    s.height_m = z0_m
    s.carriage_m = x0_m
    s.speed_mps = 0.0
    s.source_speed = 0.0
    s.source_n = 0.0
    s.source_target = 0.0
    s.sufferer_speed = 0.0
    s.sufferer_n = 0.0
    s.sufferer_target = 0.0
    s.source_us = c.idle_us
    s.sufferer_us = c.idle_us
    s.next_frame_s = frame_phase_s
    s.next_range_s = range_phase_s
    s.range_m = np.nan
    s.made_m = np.nan
    s.next_reading_s = reading_phase_s
    s.taken_off_s = np.inf
    s.roots = np.zeros(puffs)
    return s


def looked(c: Any, m: Any, s: Any, now_s: float, x_m: float, way_m: float, dt_s: float) -> Any:
    """What effects may look at, at the beginning of a step."""
    m.time_s = max(now_s - s.taken_off_s, 0.0)
    m.x_m = x_m
    m.vx_mps = way_m / dt_s
    m.travelled_m = m.travelled_m + abs(way_m)
    m.z_m = s.height_m
    m.vz_mps = s.speed_mps
    if abs(m.vx_mps) >= c.least_motion_mps:
        m.direction = np.sign(m.vx_mps)
    return m


def sensed(c: Any, m: Any, s: Any, z_m: Any, k: int, dt_s: float) -> Any:
    """The range sensor's sample, if one is due; z_m are the heights [m] up to step k."""
    now_s = k * dt_s
    is_due = now_s >= s.next_range_s - 1e-9
    makes_one = is_due
    if c.range_hold_s > 0.0:
        makes_one = now_s >= s.next_reading_s - 1e-9
    if makes_one:
        height_m = delayed(z_m, k, c.range_delay_s, dt_s, 0.0)
        range_m = seen_m(height_m, c.range_bias_m, c.range_scale)
        s.made_m = max(changed_range_m(c, m, range_m), 0.0)
        s.next_reading_s = s.next_reading_s + c.range_hold_s
    if is_due:
        s.next_range_s = s.next_range_s + c.range_period_s
        s.range_m = s.made_m
    return s


def driven(c: Any, s: Any, source_us: Any, sufferer_us: Any, k: int, dt_s: float) -> Any:
    """The pulses that the ESCs take over, if a servo frame begins with step k."""
    now_s = k * dt_s
    if c.esc_frame_s <= 0.0 or now_s >= s.next_frame_s - 1e-9:
        s.next_frame_s = s.next_frame_s + c.esc_frame_s
        late_us = delayed(source_us, k, c.command_delay_s, dt_s, c.idle_us)
        s.source_us = accepted_us(c, late_us, s.source_us, "source")
        late_us = delayed(sufferer_us, k, c.command_delay_s, dt_s, c.idle_us)
        s.sufferer_us = accepted_us(c, late_us, s.sufferer_us, "sufferer")
        s.source_target = np.sqrt(np.interp(s.source_us, c.source_us, c.source_n))
        s.sufferer_target = np.sqrt(np.interp(s.sufferer_us, c.sufferer_us, c.sufferer_n))
    before = s.source_speed
    s.source_speed = spooled(before, s.source_target, c.source_lag, dt_s)
    s.source_n = mean_thrust(before, s.source_speed, c.source_lag)
    before = s.sufferer_speed
    s.sufferer_speed = spooled(before, s.sufferer_target, c.sufferer_lag, dt_s)
    s.sufferer_n = mean_thrust(before, s.sufferer_speed, c.sufferer_lag)
    return s


def powered(c: Any, m: Any, s: Any, now_s: float, dt_s: float) -> Any:
    """Both thrusts [N] after spool, the source's after its effects, too."""
    before_n = m.source_n
    m.source_n = s.source_n
    m.sufferer_n = s.sufferer_n
    if m.sufferer_n >= c.taken_off_share * c.weight_n and now_s < s.taken_off_s:
        s.taken_off_s = now_s
    m.charge_s = m.charge_s + m.sufferer_n / c.weight_n * dt_s
    m.source_n = changed_source_n(c, m)
    m.source_rate_nps = (m.source_n - before_n) / dt_s
    return m, s


def blown(c: Any, m: Any, s: Any, table: Any) -> Any:
    """The wake's air and force at the sufferer, and the sufferer's thrust in it."""
    s.roots = np.roll(s.roots, 1)
    s.roots[0] = np.sqrt(max(m.source_n, 0.0) / c.wake.reference_thrust_n)
    s.carriage_m = carriage_place_m(c, m.x_m, s.carriage_m)
    aside_m = s.carriage_m - added_offset_m(c, m)
    m.wake_mps = wake_velocity(c, table, s.roots, aside_m, m.z_m - c.source_height_m)
    m.wake_mps = changed_wake_mps(c, m)
    m.wake_n = drag_force(c.wake, 0.0, m.wake_mps)
    m.sufferer_n = changed_sufferer_n(c, m)
    return m, s


def simulate(
    t_s: Any,
    source_us: Any,
    sufferer_us: Any,
    x_m: Any,
    z0_m: float = 0.0,
    frame_phase_s: float = 0.0,
    range_phase_s: float = 0.0,
    reading_phase_s: float = 0.0,
) -> Any:
    """Advance the model over a fixed grid of times t_s [s]; all arrays have its length.

    source_us and sufferer_us are the pulse widths [us] that the board puts out, x_m is the
    carriage's position [m]; the sufferer starts at rest at z0_m [m]. The first servo frame begins
    frame_phase_s after the first time, the first range sample is taken range_phase_s after it; a
    sensor that repeats its readings makes the first of them after reading_phase_s.
    Gives heights, speeds and the newest range sample at every time, and thrusts and forces over
    the step that begins there. No turbulence, no noise. Use a grid of 1/256 s, as the plant does.
    """
    c = constants()
    m = motion_at_rest()
    n = len(t_s)
    dt_s = (t_s[n - 1] - t_s[0]) / (n - 1)
    table = puff_table(c, dt_s)
    ages = len(table.sunk_m)
    s = started(c, z0_m, x_m[0], frame_phase_s, range_phase_s, reading_phase_s, ages)
    z_m, vz_mps, range_m = np.zeros(n), np.zeros(n), np.zeros(n)
    source_n, sufferer_n, wake_n, effect_n = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    for k in range(n):
        z_m[k] = s.height_m
        vz_mps[k] = s.speed_mps
        way_m = 0.0
        if k > 0:
            way_m = x_m[k] - x_m[k - 1]
        m = looked(c, m, s, k * dt_s, x_m[k], way_m, dt_s)
        s = sensed(c, m, s, z_m, k, dt_s)
        range_m[k] = s.range_m
        s = driven(c, s, source_us, sufferer_us, k, dt_s)
        m, s = powered(c, m, s, k * dt_s, dt_s)
        m, s = blown(c, m, s, table)
        source_n[k], sufferer_n[k], wake_n[k] = m.source_n, m.sufferer_n, m.wake_n
        effect_n[k] = added_force_n(c, m)
        driving_n = m.sufferer_n + m.wake_n + effect_n[k] - c.weight_n
        inertia_kg = c.mass_kg + added_mass_kg(c, m)
        s.height_m, s.speed_mps = slid(
            c.rail, s.height_m, s.speed_mps, driving_n, inertia_kg, 0.0, c.travel_m, dt_s
        )
    return {
        "t_s": t_s,
        "z_m": z_m,
        "vz_mps": vz_mps,
        "range_m": range_m,
        "source_n": source_n,
        "sufferer_n": sufferer_n,
        "wake_n": wake_n,
        "effect_n": effect_n,
    }


# exported up to here


def constants() -> Any:
    """Replaced by the rig's constants and its effects' values."""
    return SimpleNamespace()


def motion_at_rest() -> Any:
    """Replaced by what effects may look at, all zero."""
    return SimpleNamespace()


def accepted_us(c: Any, pulse_us: float, before_us: float, motor: str) -> float:
    """The pulse [us] that an ESC takes over in a servo frame."""
    return pulse_us


def changed_source_n(c: Any, m: Any) -> Any:
    """The source's thrust [N] after effects."""
    return m.source_n


def changed_sufferer_n(c: Any, m: Any) -> Any:
    """The sufferer's thrust [N] after effects."""
    return m.sufferer_n


def changed_wake_mps(c: Any, m: Any) -> Any:
    """The air's speed [m/s] after effects."""
    return m.wake_mps


def changed_range_m(c: Any, m: Any, range_m: float) -> float:
    """The range [m] after effects."""
    return range_m


def carriage_place_m(c: Any, drive_m: float, before_m: float) -> float:
    """Where the carriage is [m] when its drive is at drive_m, before_m a step earlier."""
    return drive_m


def added_offset_m(c: Any, m: Any) -> float:
    """How far to the right [m] the wake lies."""
    return 0.0


def added_force_n(c: Any, m: Any) -> float:
    """Extra force [N] on the sufferer."""
    return 0.0


def added_mass_kg(c: Any, m: Any) -> float:
    """Extra inertia [kg]."""
    return 0.0
