"""Stamps of a log as seconds that rise: texts read, epochs kept exact, doubles and falls handled.

In: the numbers or texts under a clock's address. Out: a `Timeline`, and remarks on what was done.
"""

import itertools
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from typing import Literal

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
_NO_SECONDS = "mend it, or leave [time] nanoseconds out"
_MOST_WHOLE_S = 9.2e9  # beside nanoseconds: those of 64 bits end there, and ms since 1970 are more
_SWAPPED_ROWS = 20  # that a message comes late, and not a clock that was set back
_DATE = re.compile(r"%[dDjxcsuwFyYG]")  # of a form that has the day, too
_DAY_NS = 86_400 * 1_000_000_000
_DATES_BEGIN_S = 1_000_000  # a clock that shows more counts from a year, not from a start


@dataclass(frozen=True, eq=False)
class Timeline:
    """When the rows of a clock were taken: `stamps_s` (m,) rises, with one row or more for each.

    `order` (n,) are the log's rows by their stamps, `starts` (m,) where those of a stamp begin in
    it. `keeps` says which of several numbers at one stamp is a column's.
    """

    stamps_s: Vector
    order: NDArray[np.intp]
    starts: NDArray[np.intp]
    keeps: Literal["first", "last"] = "last"

    @property
    def rows(self) -> NDArray[np.intp]:
        """The log's row (m,) that stands for each stamp."""
        ends = np.append(self.starts[1:], len(self.order)) - 1
        return self.order[ends if self.keeps == "last" else self.starts]

    def merged(self, values: Vector) -> Vector:
        """A column (m,) of the log's rows: of the rows with one stamp a number that is there."""
        ordered = values[self.order]
        if len(self.starts) == len(self.order):
            return ordered
        places = np.arange(len(ordered))
        is_there = ~np.isnan(ordered)
        if self.keeps == "last":
            chosen = np.maximum.reduceat(np.where(is_there, places, self.starts[0]), self.starts)
        else:
            chosen = np.minimum.reduceat(np.where(is_there, places, len(places) - 1), self.starts)
        is_own = np.maximum.reduceat(is_there, self.starts)
        return np.where(is_own, ordered[chosen], np.nan)

    def numbers(self, values: Vector) -> NDArray[np.intp]:
        """How many numbers (m,) a column has at each stamp."""
        return np.add.reduceat((~np.isnan(values[self.order])).astype(np.intp), self.starts)

    def same_as(self, other: "Timeline") -> bool:
        """Whether another clock has the same times."""
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
    if form is None or values.dtype.kind == "M":
        return values
    stamps = np.array([_ns_of(str(v), form, i, place, refuse) for i, v in enumerate(values)])
    return _past_midnight(stamps) if is_time_of_day(form) else stamps


def is_time_of_day(form: str | None) -> bool:
    """Whether stamps are written without a day, as `%H:%M:%S`."""
    return form is not None and form != "iso" and not _DATE.search(form)


def begun_after_midnight(clocks_ns: Sequence[NDArray[np.int64]]) -> list[bool]:
    """Of the times of day of one recording, each (n,), those that begin a day after the others.

    A clock is of the next day if it has nothing in common with the one that begins latest, and does
    a day later: some hours alone may also be those of a sensor that was switched on late.
    """
    latest = max(clocks_ns, key=lambda clock: int(clock[0]))
    begin, end = int(latest.min()), int(latest.max())
    first, last = (np.array([int(f(clock)) for clock in clocks_ns]) for f in (np.min, np.max))
    is_apart = last < begin
    is_common = (first + _DAY_NS <= end) & (last + _DAY_NS >= begin)
    return [bool(found) for found in is_apart & is_common]


def _past_midnight(stamps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Times of day that go on behind midnight, where they fall by more than half a day.

    A row that comes too late belongs to the day before, where they rise by as much again.
    """
    steps = np.diff(stamps_ns, prepend=stamps_ns[:1])
    days, passed = np.zeros(len(steps), np.int64), 0
    for at in np.flatnonzero(np.abs(steps) > _DAY_NS // 2):
        if steps[at] < 0:
            passed += 1
        elif passed:
            passed -= 1
        days[at:] = passed
    return np.asarray(stamps_ns + _DAY_NS * days)


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


def whole_ns(seconds: Values, nanoseconds: Values, row: Place, refuse: Refuse) -> Values:
    """Stamps [ns] (n,) of whole seconds and the nanoseconds beyond them; UnusableInput by row."""
    for values in (seconds, nanoseconds):
        if values.dtype.kind not in "fiub":
            raise refuse(f"with nanoseconds: {str(values[0])[:40]!r} is no number", _NO_SECONDS)
    whole, beyond = as_floats(seconds), as_floats(nanoseconds)
    finer = "give the column of whole seconds, or leave [time] nanoseconds out and give the unit"
    for values, is_wrong, reason, advice in (
        (seconds, np.isnan(whole) | (whole != np.floor(whole)), "no whole second", _NO_SECONDS),
        (seconds, ~(np.abs(whole) < _MOST_WHOLE_S), "too large for seconds", finer),
        (nanoseconds, ~(np.abs(beyond / 1e9 - 0.5) <= 0.5), "no nanoseconds of one", _NO_SECONDS),
    ):
        if is_wrong.any():
            at = int(np.argmax(is_wrong))
            raise refuse(f"with nanoseconds: {values[at]} in {row(at)} is {reason}", advice)
    return np.asarray(seconds).astype(np.int64) * 10**9 + np.asarray(nanoseconds).astype(np.int64)


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
    stamps_s: Vector,
    first: int,
    base: TimeBase,
    place: Place,
    refuse: Refuse,
    notes: list[str],
    instead: str = "",
) -> Timeline:
    """Stamps in rising order, of the rows from `first` on, with what was done about falls.

    `instead` is the advice for a clock that lacks a stamp, where it can do better than mend it.
    """
    is_stamp = np.abs(stamps_s) < _LATEST_S  # nor is NaN
    if not is_stamp.all():
        at = int(np.argmin(is_stamp))
        reason = f"has no stamp in {place(first + at)}"
        raise refuse(reason, instead or "mend or delete that row")
    order = np.arange(len(stamps_s))
    falls = np.flatnonzero(np.diff(stamps_s) < 0)
    if len(falls) and base.falling == "refuse":
        back_s = float(stamps_s[falls[0]] - stamps_s[falls[0] + 1])
        reason = f"falls by {back_s:.3g} s at {place(first + int(falls[0]) + 1)}"
        raise refuse(reason, _advice_on_falls(stamps_s))
    if len(falls) and base.falling == "sort":
        order = np.argsort(stamps_s, kind="stable")
        back_s = float((np.maximum.accumulate(stamps_s) - stamps_s).max())
        notes.append(f"{len(falls)} stamps fell and were sorted, by up to {back_s:.3g} s")
    ordered_s = stamps_s[order]
    starts = np.flatnonzero(np.diff(ordered_s, prepend=-np.inf) > 0)
    keeps: Literal["first", "last"] = "first" if base.repeated == "first" else "last"
    return Timeline(ordered_s[starts], first + order, starts, keeps)


def is_set_back(stamps_s: Vector) -> bool:
    """Whether a clock that falls goes on from there, where messages that swap places catch up.

    Messages that came in another order are behind the newest stamp for a few rows; behind a clock
    that was set back, or that began again, are all those of a stretch.
    """
    is_behind = stamps_s < np.maximum.accumulate(stamps_s)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_behind, [False]]).astype(int)))
    return bool(len(edges)) and int((edges[1::2] - edges[::2]).max()) > _SWAPPED_ROWS


def on_mixed(stamps_s: Vector, columns: Sequence[Vector], base: TimeBase) -> list[str]:
    """The remark on a clock that was set back for rows of one column, and not for another stream.

    Its runs are sorted into each other: what was at one time stands beside what was at another.
    """
    own_s = (stamps_s[~np.isnan(values)] for values in columns)
    if base.falling != "sort" or not any(map(is_set_back, own_s)):
        return []
    return [
        "its clock was set back or began again, and rows of two times are mixed now; falling ="
        ' "split" parts them'
    ]


def _advice_on_falls(stamps_s: Vector) -> str:
    if is_set_back(stamps_s):
        return (
            'give [time] falling = "split" where the clock was set back or a log begins again, or'
            ' "sort" where a file holds one stream after the other'
        )
    return 'give [time] falling = "sort", or "split" where another recording begins'


def on_repeats(
    line: Timeline, columns: Sequence[Vector], base: TimeBase, place: Place, refuse: Refuse
) -> list[str]:
    """Remarks on the rows that share a stamp; those of one column contradict each other."""
    if len(line.starts) == len(line.order):
        return []
    rows = np.diff(np.append(line.starts, len(line.order)))
    again, filled = np.zeros(len(rows), dtype=np.intp), np.zeros(len(rows), dtype=np.intp)
    for values in columns:
        counts = line.numbers(values)
        filled += counts
        if base.repeated == "refuse" and (counts > 1).any():
            at = _second_row(line, values, int(np.argmax(counts > 1)))
            advice = 'give [time] repeated = "last" or "first"'
            raise refuse(f"repeats a stamp at {place(at)}", advice)
        again = np.maximum(again, counts - 1)
    merged = int(((rows - 1 > again) & (filled > again + 1)).sum())
    notes = [f"{merged} stamps have rows that fill different columns; they were merged"]
    return (notes if merged else []) + ([_doubled(again, line.keeps)] if again.any() else [])


def _doubled(again: NDArray[np.intp], kept: str) -> str:
    """The remark on stamps (T,) that have so many rows more; where most have, what they may be."""
    repeated, most = int((again > 0).sum()), int(again.max()) + 1
    times = "twice" if most == 2 else f"up to {most} times"
    stamps = "1 stamp was" if repeated == 1 else f"{repeated} stamps were"
    remark = f"{stamps} there {times}; the {kept} row of each was kept"
    if 2 * repeated < len(again):
        return remark
    return f"{remark}. Where these are several robots or runs in one table, make a log of each"


def _second_row(line: Timeline, values: Vector, stamp: int) -> int:
    """The row of the log with the second number that a column has at a stamp."""
    end = line.starts[stamp + 1] if stamp + 1 < len(line.starts) else len(line.order)
    rows = line.order[line.starts[stamp] : end]
    return int(rows[~np.isnan(values[rows])][1])


def between_falls(stamps_s: Vector) -> list[slice]:
    """The pieces of a clock between its falls."""
    cuts = [0, *(np.flatnonzero(np.diff(stamps_s) < 0) + 1).tolist(), len(stamps_s)]
    return [slice(a, b) for a, b in itertools.pairwise(cuts)]
