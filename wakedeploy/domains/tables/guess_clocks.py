"""Which of several clocks in one log is a column's: that of its length, its group and its words.

In: a log, its first clock and what its columns hold. Out: a `Timing` for each column whose clock is
another one.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from wakedeploy.domains.tables.guess_clock import Timing, called_times, even_clock, words_of
from wakedeploy.domains.tables.log import Field, Log, Values

_MOST_TIMES, _SHORTEST_S = 2.0, 1e-9  # longer or shorter than the first clock; of any log


def clocks_of(
    log: Log, fields: Sequence[Field], first: Timing, values: Mapping[str, Values]
) -> dict[str, Timing]:
    """The clock of each column that has not the first one; where none fits, the first stays."""
    if first.stamps_s is None:
        return {}
    called = called_times(log, log.fields())
    by_name = {clock.column: clock for clock in called if clock.nanoseconds is None}
    clocks = [first, *(clock for name, clock in by_name.items() if name != first.column)]
    for field in fields:  # where no clock that is called so has its length
        seen = values.get(field.name)
        if seen is not None and len(seen) > 1 and not any(_fits(clock, seen) for clock in clocks):
            clocks += _even(log, fields, values, len(seen))
    found = {name: _clock_of(name, seen, clocks) for name, seen in values.items()}
    return {name: c for name, c in found.items() if c is not first and c.column != name}


def _even(
    log: Log, fields: Sequence[Field], values: Mapping[str, Values], count: int
) -> list[Timing]:
    """The columns of a length that rise evenly."""
    same = [field for field in fields if len(values.get(field.name, ())) == count]
    found = [even_clock(log, field) for field in same]
    return [clock for clock in found if clock is not None]


def _clock_of(name: str, seen: Values, clocks: Sequence[Timing]) -> Timing:
    """A column's clock: of those as long as it, that of its group or with most of its words.

    Where none is nearer the first one stays.
    """
    first = clocks[0]
    fitting = [clock for clock in clocks if _fits(clock, seen)]
    if first in fitting:
        fitting = [clock for clock in fitting if clock is first or _is_beside(clock, first)]
    return max(fitting, key=lambda clock: _nearness(clock.column or "", name), default=first)


def _fits(clock: Timing, seen: Values) -> bool:
    return clock.stamps_s is not None and len(clock.stamps_s) == len(seen)


def _is_beside(clock: Timing, first: Timing) -> bool:
    """Whether a clock says other times than the first one, and is of as long a log."""
    if clock.stamps_s is None or first.stamps_s is None:
        return False
    share = float(np.ptp(clock.stamps_s)) / max(float(np.ptp(first.stamps_s)), _SHORTEST_S)
    is_as_long = 1.0 / _MOST_TIMES < share < _MOST_TIMES
    return is_as_long and not np.array_equal(clock.stamps_s, first.stamps_s)


def _nearness(clock: str, column: str) -> tuple[bool, int]:
    """Whether two addresses are of one group, or both of none, and how many words they share."""
    is_of_group = clock.rpartition("/")[0] == column.rpartition("/")[0]
    return is_of_group, len(words_of(clock) & words_of(column))
