"""Stamps of a log as seconds that rise: texts read, epochs kept exact, doubles and falls handled.

In: the numbers or texts under a clock's address. Out: a `Timeline`, and remarks on what was done.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.units import conversion
from wakedeploy.domains.tables.columns import TimeBase
from wakedeploy.domains.tables.log import Values

Vector = NDArray[np.float64]
Place = Callable[[int], str]
Refuse = Callable[[str, str], UnusableInput]  # of a reason and an advice

_LATEST_S = 1e12
_DATES_BEGIN_S = 1_000_000  # a clock that shows more counts from a year, not from a start


@dataclass(frozen=True, eq=False)
class Timeline:
    """When the rows of a clock were taken: `stamps_s` (m,) rises, `rows` (m,) are the log's."""

    stamps_s: Vector
    rows: NDArray[np.intp]

    def same_as(self, other: "Timeline") -> bool:
        """Whether another clock tells the same."""
        return (
            self.stamps_s.shape == other.stamps_s.shape
            and np.array_equal(self.rows, other.rows)
            and np.array_equal(self.stamps_s, other.stamps_s)
        )


def seconds_in(unit: str) -> Fraction:
    """Seconds in a unit of time; ValueError with a clause for another unit."""
    return conversion(unit, "s")


def as_floats(values: Values) -> Vector:
    """Numbers as floats; a float of half the size may hold a NaN that signals when it is cast."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


def as_numbers(values: Values, form: str | None, place: Place, refuse: Refuse) -> Values:
    """Stamps as numbers; texts, in the form that is stated, as nanoseconds since 1970."""
    if form is None and values.dtype == object:
        advice = 'say how stamps are written: [time] format = "iso", or as strptime takes it'
        raise refuse(f"holds texts, {str(values[0])[:40]!r} the first", advice)
    if form is None:
        return values
    return np.array([_ns_of(str(v), form, i, place, refuse) for i, v in enumerate(values)])


def _ns_of(text: str, form: str, index: int, place: Place, refuse: Refuse) -> int:
    try:
        at = datetime.fromisoformat(text) if form == "iso" else datetime.strptime(text, form)
        since = at.replace(tzinfo=at.tzinfo or UTC) - datetime(1970, 1, 1, tzinfo=UTC)
    except (ValueError, OverflowError) as error:
        reason = f"holds {text[:40]!r} in {place(index)}, which is not written as {form!r}"
        raise refuse(reason, "correct [time] format") from error
    return (since.days * 86_400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000


def whole_start_s(values: Values, seconds: Fraction) -> int | None:
    """The whole second of a clock's first stamp where it counts from a year; None for no stamp."""
    finite = values[np.abs(as_floats(values)) < 1e30]
    if not len(finite):
        return None
    lowest = finite.min()
    exact = int(lowest) if values.dtype.kind in "iu" else Fraction(float(lowest))
    return math.floor(exact * seconds)


def origin_s(starts_s: list[int]) -> int:
    """What all clocks of a log count from: their own zero, or the first second of dates."""
    first = min(starts_s, default=0)
    return first if abs(first) >= _DATES_BEGIN_S else 0


def in_seconds(values: Values, seconds: Fraction, origin: int) -> Vector:
    """Stamps in seconds since the origin, which is taken off before digits are lost."""
    zero = origin / seconds
    if values.dtype.kind in "iu":
        low, high = np.iinfo(values.dtype).min, np.iinfo(values.dtype).max
        if zero.denominator == 1 and low <= zero.numerator <= high:
            values = values - values.dtype.type(zero.numerator)
            zero = Fraction(0)
    with np.errstate(over="ignore", invalid="ignore"):  # `timeline` refuses what overflows
        numbers = as_floats(values) - float(zero)
        return np.asarray(numbers * seconds.numerator / seconds.denominator, dtype=np.float64)


def timeline(
    stamps_s: Vector, base: TimeBase, place: Place, refuse: Refuse, notes: list[str]
) -> Timeline:
    """Stamps in rising order, with what was done about doubles and falls."""
    is_stamp = np.abs(stamps_s) < _LATEST_S  # nor is NaN
    if not is_stamp.all():
        at = int(np.argmin(is_stamp))
        raise refuse(f"has no stamp in {place(at)}", "mend or delete that row")
    rows = np.arange(len(stamps_s))
    falls = np.flatnonzero(np.diff(stamps_s) < 0)
    if len(falls) and base.falling == "refuse":
        back_s = float(stamps_s[falls[0]] - stamps_s[falls[0] + 1])
        reason = f"falls by {back_s:.3g} s at {place(int(falls[0]) + 1)}"
        advice = 'give [time] falling = "sort", or "split" where another recording begins'
        raise refuse(reason, advice)
    if len(falls) and base.falling == "sort":
        rows = np.argsort(stamps_s, kind="stable")
        notes.append(f"{len(falls)} stamps fell and were sorted")
    return _without_doubles(stamps_s[rows], rows, base, place, refuse, notes)


def _without_doubles(
    stamps_s: Vector,
    rows: NDArray[np.intp],
    base: TimeBase,
    place: Place,
    refuse: Refuse,
    notes: list[str],
) -> Timeline:
    same = np.diff(stamps_s) == 0
    if same.any() and base.repeated == "refuse":
        at = int(rows[int(np.argmax(same)) + 1])
        raise refuse(f"repeats a stamp at {place(at)}", 'give [time] repeated = "last" or "first"')
    if same.any():
        is_last = base.repeated == "last"
        kept = np.append(~same, True) if is_last else np.insert(~same, 0, True)
        notes.append(f"{int(same.sum())} stamps were there twice; the {base.repeated} was kept")
        stamps_s, rows = stamps_s[kept], rows[kept]
    return Timeline(stamps_s, rows)


def between_falls(stamps_s: Vector) -> list[slice]:
    """The pieces of a clock between its falls."""
    cuts = [0, *(np.flatnonzero(np.diff(stamps_s) < 0) + 1).tolist(), len(stamps_s)]
    return [slice(a, b) for a, b in itertools.pairwise(cuts)]
