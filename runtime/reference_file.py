"""A flight plan as a CSV file: read, checked against a rig, and written here and nowhere else.

In: a file with the columns t_s, z_m, x_m, source_us, at any steady or unsteady rate. Out: a
`FlightPlan` at the loop's rate that begins and ends at rest and never asks for what the rig
cannot do.
"""

import csv
import io
from pathlib import Path

import numpy as np

from runtime.reference import PLAN_RATE_HZ, FlightPlan, FloatArray
from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import text_of, write_text_whole
from wakedeploy.core.rig import Rig
from wakedeploy.physics.rail import GRAVITY_MPS2

COLUMNS = ("t_s", "z_m", "x_m", "source_us")
SHORTEST_S, LONGEST_S = 1.0, 3600.0
REST_M, REST_MPS, REST_US = 0.001, 0.02, 1.0  # what counts as being at rest
_SHORTEST_STEP_S = 1e-4
_ABSURD = 1e6  # in the columns' units, nothing here is so large
_ROUNDING = 1e-6  # a limit may be met exactly, in a file with rounded numbers


def write_reference(path: Path, plan: FlightPlan, rig: Rig, name: str = "") -> None:
    """Write a plan, one row per tick; comments name it and the rig it was made for."""
    text = io.StringIO()
    text.write(f"# wakedeploy reference{': ' + name if name else ''}\n")
    text.write(f"# rig_sha256 = {rig.sha256}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for tick in range(len(plan)):
        row = (plan.z_m[tick], plan.x_m[tick], plan.source_us[tick])
        writer.writerow([f"{tick / PLAN_RATE_HZ:.6f}", *(f"{value:.7g}" for value in row)])
    write_text_whole(path, text.getvalue())


def read_reference(path: Path, rig: Rig) -> FlightPlan:
    """Read a plan and bring it to the loop's rate.

    Height and carriage are interpolated by monotone cubics (Fritsch and Carlson 1980), which do not
    overshoot; the source's pulse width linearly, so that a step stays one.

    Raises UnusableInput naming file, time, value and bound for a file that cannot be flown.
    """
    from scipy.interpolate import PchipInterpolator  # 20 MB that other runs do not need

    table = _table(path)  # (n, 4)
    t_s = table[:, 0] - table[0, 0]
    if not SHORTEST_S <= t_s[-1] <= LONGEST_S:
        raise UnusableInput(
            f"{path}: lasts {t_s[-1]:g} s; a reference lasts {SHORTEST_S:g} to {LONGEST_S:g} s."
        )
    ticks = int(np.floor(t_s[-1] * PLAN_RATE_HZ + _ROUNDING)) + 1
    wanted_s = np.minimum(np.arange(ticks) / PLAN_RATE_HZ, t_s[-1])
    z_m, x_m = (np.asarray(PchipInterpolator(t_s, table[:, i])(wanted_s)) for i in (1, 2))
    plan = FlightPlan(z_m, x_m, np.interp(wanted_s, t_s, table[:, 3]))
    require_flyable(plan, rig, str(path))
    return plan


def require_flyable(plan: FlightPlan, rig: Rig, name: str) -> None:
    """UnusableInput when a plan leaves the rig's limits or does not begin and end at rest."""
    _require_rest(plan, rig, name)
    limits, stepper, sufferer = rig.limits, rig.stepper, rig.sufferer
    top_mps2 = rig.thrust.sufferer.thrust_n[-1] / sufferer.mass_kg - GRAVITY_MPS2
    slew_us = limits.slew_us_per_s / PLAN_RATE_HZ
    low_m, high_m = max(0.0, limits.z_m[0]), min(sufferer.travel_m, limits.z_m[1])
    bounded = (
        ("z_m", plan.z_m, low_m, high_m, "m", "limits.z_m and sufferer.travel_m"),
        ("the height's acceleration", _acceleration(plan.z_m), -GRAVITY_MPS2, top_mps2, "m/s²",
         "the sufferer's thrust"),
        ("x_m", plan.x_m, *limits.x_m, "m", "limits.x_m"),
        ("the carriage's speed", _speed(plan.x_m), -stepper.max_speed_mps, stepper.max_speed_mps,
         "m/s", "stepper.max_speed_mps"),
        ("the carriage's acceleration", _acceleration(plan.x_m), -stepper.max_accel_mps2,
         stepper.max_accel_mps2, "m/s²", "stepper.max_accel_mps2"),
        ("source_us", plan.source_us, *limits.pulse_us, "µs", "limits.pulse_us"),
        ("source_us per tick", np.diff(plan.source_us), -slew_us, slew_us, "µs",
         "limits.slew_us_per_s"),
    )  # fmt: skip
    for what, values, low, high, unit, limit in bounded:
        _require_within(name, what, values, (low, high), unit, limit)


def _require_within(
    name: str,
    what: str,
    values: FloatArray,
    bounds: tuple[float, float],
    unit: str,
    limit: str,
) -> None:
    low, high = bounds
    slack = _ROUNDING + 1e-3 * (high - low) * (
        "acceleration" in what
    )  # rounding, differenced twice
    beyond = np.flatnonzero(~((values >= low - slack) & (values <= high + slack)))
    if beyond.size:
        tick = int(beyond[0])
        raise UnusableInput(
            f"{name}: at {tick / PLAN_RATE_HZ:.2f} s {what} is {values[tick]:.4g} {unit}, and "
            f"{limit} allow{'' if ' and ' in limit else 's'} {low:.4g} to {high:.4g} {unit}."
        )


def _require_rest(plan: FlightPlan, rig: Rig, name: str) -> None:
    idle_us = rig.limits.pulse_us[0]
    for word, here, next_to in (("begin", 0, 1), ("end", -1, -2)):
        found = {
            "z_m": (plan.z_m[here], 0.0, REST_M),
            "x_m": (plan.x_m[here], 0.0, REST_M),
            "source_us": (plan.source_us[here], idle_us, REST_US),
        }
        for column, (value, rest, most) in found.items():
            if not abs(value - rest) <= most:
                raise UnusableInput(
                    f"{name}: must {word} at rest, and {column} {word}s at {value:.4g} instead "
                    f"of {rest:g}."
                )
        for column, values in (("z_m", plan.z_m), ("x_m", plan.x_m)):
            speed_mps = abs(values[here] - values[next_to]) * PLAN_RATE_HZ
            if not speed_mps <= REST_MPS:
                raise UnusableInput(
                    f"{name}: must {word} at rest, and {column} {word}s with {speed_mps:.3g} m/s; "
                    "hold it there for a moment."
                )


def _speed(values: FloatArray) -> FloatArray:
    return np.asarray(np.diff(values) * PLAN_RATE_HZ)


def _acceleration(values: FloatArray) -> FloatArray:
    return np.asarray(np.diff(np.pad(values, 1, mode="edge"), 2) * PLAN_RATE_HZ**2)


def _table(path: Path) -> FloatArray:
    """The file's numbers (n, 4), finite and in order of time."""
    try:
        text = text_of(path).removeprefix("\ufeff")
    except (OSError, ValueError) as error:
        raise UnusableInput(
            f"{path}: cannot be read as a reference ({one_line(error)})."
        ) from error
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    names = [name.strip() for name in lines[0][1].split(",")] if lines else []
    if sorted(names) != sorted(COLUMNS):
        raise UnusableInput(
            f"{path}: the columns of a reference are {', '.join(COLUMNS)}, and these are "
            f"{', '.join(names) or 'none'}."
        )
    rows = np.array([_row(line, f"{path}, line {n}") for n, line in lines[1:]])
    if len(rows) < 2:
        held = "a single row" if len(rows) else "no rows"
        raise UnusableInput(f"{path}: holds {held}; a reference needs at least two.")
    table = rows[:, [names.index(column) for column in COLUMNS]]
    _require_order(table[:, 0], [n for n, _ in lines[1:]], path)
    return np.asarray(table)


def _require_order(t_s: FloatArray, numbers: list[int], path: Path) -> None:
    back = np.flatnonzero(~(np.diff(t_s) >= _SHORTEST_STEP_S))
    if back.size:
        raise UnusableInput(
            f"{path}, line {numbers[int(back[0]) + 1]}: t_s = {t_s[back[0] + 1]:g} comes after "
            f"{t_s[back[0]]:g}; time must rise from row to row, by {_SHORTEST_STEP_S:g} s or more."
        )


def _row(line: str, where: str) -> list[float]:
    cells = line.split(",")
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        raise UnusableInput(f"{where}: {line.strip()!r} holds something not a number.") from None
    if len(values) != len(COLUMNS) or not all(abs(value) <= _ABSURD for value in values):
        raise UnusableInput(
            f"{where}: {len(COLUMNS)} finite numbers are needed in every row, "
            f"none beyond {_ABSURD:g}."
        )
    return values
