"""What a clock's numbers count in: by what the log says, by their date, or by the clock's rate.

In: a clock's field and its numbers. Out: a unit of time, and whether it is a guess.
"""

import math
import re

import numpy as np
from numpy.typing import NDArray

from wakedeploy.domains.tables.log import Field, Values
from wakedeploy.domains.tables.stamps import as_floats, seconds_in

Vector = NDArray[np.float64]

LARGEST = 1e30  # of a stamp; no damaged file overflows
UNITS = ("s", "ms", "us", "ns")
_DATES_S = (946_684_800.0, 4_102_444_800.0)  # the years 2000 to 2100
_POSSIBLE_HZ = (0.05, 50_000.0)
_USUAL_HZ = (1.0, 5_000.0)
_USUAL_FINE_HZ = (2.0, 5_000.0)  # who counts in parts of a second does so for a reason
_USUAL_S = (2.0, 3.0 * 3600.0)


def time_unit(values: Values, field: Field) -> tuple[str | None, bool]:
    """The unit that the log states, or the one in which stamps are likely; and if it is a guess."""
    stated = field.unit or unit_in(field.name)
    if stated is not None:
        try:
            seconds_in(stated)
            return stated, False
        except ValueError:
            pass
    if values.dtype.kind == "M":
        return "ns", False
    numbers = as_floats(values)
    if len(numbers) < 2 or not (np.abs(numbers) < LARGEST).all():
        return None, False
    steps = np.diff(numbers)
    rising = steps[steps > 0]
    if len(rising) < 0.5 * len(steps) or not len(rising):
        return None, False
    unit = _likely(numbers, float(np.median(rising)))
    return unit, unit is not None


def unit_in(name: str) -> str | None:
    """The unit of time that a name ends with."""
    ends = re.search(r"_(s|ms|us|ns|min)$", name)
    if ends:
        return ends[1]
    return "min" if re.search(r"(^|_)minutes?$", name.lower()) else None


def _likely(numbers: Vector, step: float) -> str | None:
    """The unit whose stamps are dates, or else whose rate and length are a log's; None for none."""
    possible = [unit for unit in UNITS if _outside(_hz(step, unit), _POSSIBLE_HZ) == 0.0]
    middle, length = float(np.median(numbers)), float(np.ptp(numbers))
    dates = [unit for unit in possible if _is_date(middle, unit)]
    return min(dates or possible, key=lambda unit: _oddity(unit, step, length), default=None)


def is_dated(numbers: Vector, unit: str) -> bool:
    """Whether stamps in a unit are dates of this century."""
    return _is_date(float(np.median(numbers)), unit)


def _is_date(stamp: float, unit: str) -> bool:
    return _outside(stamp * _seconds(unit), _DATES_S) == 0.0


def _oddity(unit: str, step: float, length: float) -> float:
    """By how many decades the rate and the length of a log are unusual."""
    usual_hz = _USUAL_HZ if unit == "s" else _USUAL_FINE_HZ
    return _outside(_hz(step, unit), usual_hz) + _outside(length * _seconds(unit), _USUAL_S)


def _outside(value: float, bounds: tuple[float, float]) -> float:
    """How many decades a value lies outside of bounds."""
    low, high = bounds
    if value <= 0.0:
        return math.inf
    return max(math.log10(low / value), math.log10(value / high), 0.0)


def _hz(step: float, unit: str) -> float:
    return 1.0 / (step * _seconds(unit))


def _seconds(unit: str) -> float:
    return float(seconds_in(unit))
