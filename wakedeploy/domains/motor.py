"""Motor speed after steps of an ESC's duty: recordings of the AutoQuad ESC32.

In: a folder with `.csv` or `.csv.gz` logs of `alspitz/esc_test` (columns Timestamp, RPM, Duty).
Out: one piece per step of the duty, from shortly before it to a second after. The timestamps are
those of arrival: the records come in bursts, one burst in 1/60 s, of which the last is kept.
"""

import csv
import datetime
import gzip
import io
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.errors import UnusableInput, one_line

COLUMNS = ("Timestamp", "RPM", "Duty", "Batt. Volts")
BEFORE_S, AFTER_S = 0.3, 1.0

_BURST_S = 0.005  # records closer than this arrived together
_LOWEST_DUTY = 5.0  # below, a sensorless motor is being started or stopped, which is no lag
_FEWEST = 30  # samples of a step
_MOST_BYTES = 16 << 20  # of a log as text, an hour of records
_ABSURD = 1e6  # [1/min] no motor turns as fast

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the duty [%] at `step_s`: times, speeds and battery voltages (n,)."""

    name: str
    time_s: Vector
    rpm: Vector
    battery_v: Vector
    step_s: float
    before: float
    after: float


def read_steps(path: Path) -> tuple[Step, ...]:
    """Every step in the logs below `path`; UnusableInput names the file and what is wrong.

    Logs without a recorded duty (test stands that hold a speed themselves) are left out.
    """
    steps: list[Step] = []
    for file in _logs(path):
        table = _table(file)
        if table is not None:
            steps += _steps(file.name.split(".")[0], *table)
    if len(steps) < 4:
        raise UnusableInput(
            f"{path}: holds {len(steps)} usable steps of the duty; give logs with at least 4."
        )
    return tuple(steps)


def _logs(path: Path) -> list[Path]:
    if not path.is_dir():
        raise UnusableInput(f"{path}: is not a folder; give one with the ESC's .csv logs.")
    found = sorted(p for p in path.rglob("*.csv*") if p.name.endswith((".csv", ".csv.gz")))
    if not found:
        raise UnusableInput(f"{path}: no .csv or .csv.gz in it or below; give the folder of logs.")
    return found


def _table(file: Path) -> tuple[Vector, Vector, Vector, Vector] | None:
    """Time [s], speed, duty and battery voltage of a log; None for one without a duty."""
    try:
        header, *rows = csv.reader(io.StringIO(_text(file), newline=""))
    except (OSError, EOFError, ValueError, zlib.error, csv.Error) as error:
        raise UnusableInput(
            f"{file}: cannot be read ({one_line(error)}); copy it again."
        ) from error
    places = {name.strip(): i for i, name in enumerate(header)}
    if "Duty" not in places:
        return None
    for name in COLUMNS:
        if name not in places:
            raise UnusableInput(f"{file}: column {name!r} is missing; give the ESC's own log.")
    if not rows:
        raise UnusableInput(f"{file}: holds no record; leave this log out.")
    try:
        time_s = _seconds([row[places["Timestamp"]] for row in rows])
        numbers = [np.array([_number(row[places[n]]) for row in rows]) for n in COLUMNS[1:]]
    except (ValueError, IndexError) as error:
        raise UnusableInput(f"{file}: a row is damaged ({one_line(error)}).") from error
    if (np.diff(time_s) < 0).any():
        raise UnusableInput(f"{file}: its clock runs backwards; leave this log out.")
    kept = np.append(np.diff(time_s) > _BURST_S, True)
    rpm, duty, battery = (n[kept] for n in numbers)
    return time_s[kept], rpm, duty, battery


def _text(file: Path) -> str:
    """The text of a log, compressed or not; ValueError for more than a log is."""
    with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as handle:
        content = handle.read(_MOST_BYTES + 1)
    if len(content) > _MOST_BYTES:
        raise ValueError(f"it is larger than {_MOST_BYTES >> 20} MiB")
    return content.decode("utf-8-sig")


def _number(cell: str) -> float:
    value = float(cell)
    if not abs(value) < _ABSURD:
        raise ValueError(f"{cell!r} is no measurement")
    return value


def _seconds(stamps: Sequence[str]) -> Vector:
    """`2019-11-07 18:45:58:868` as seconds since the first; the last group is milliseconds."""
    times = [datetime.datetime.strptime(f"{s}000", "%Y-%m-%d %H:%M:%S:%f") for s in stamps]
    return np.array([(t - times[0]).total_seconds() for t in times])


def _steps(name: str, time_s: Vector, rpm: Vector, duty: Vector, battery_v: Vector) -> list[Step]:
    """The steps between two duties at which the motor runs, `name`-1 and on."""
    changes = np.flatnonzero(np.diff(duty)) + 1
    borders = np.concatenate([[time_s[0]], time_s[changes], [time_s[-1]]])
    steps: list[Step] = []
    for k, at in enumerate(changes):
        before, after = float(duty[at - 1]), float(duty[at])
        if min(before, after) < _LOWEST_DUTY:
            continue
        start = max(time_s[at] - BEFORE_S, borders[k] + AFTER_S)
        end = min(time_s[at] + AFTER_S, borders[k + 2] - 0.02)
        part = (time_s >= start) & (time_s < end)
        if part.sum() >= _FEWEST and start < time_s[at]:
            arrays = time_s[part], rpm[part], battery_v[part]
            label = f"{name}-{len(steps) + 1}"
            steps.append(Step(label, *arrays, float(time_s[at]), before, after))
    return steps
