"""Which of several clocks in one log is a column's: that of its length, its group and its words.

In: a log, its first clock and what its columns hold. Out: a `Timing` for each column whose clock is
another one.
"""

import re
from collections.abc import Mapping, Sequence

from wakedeploy.domains.tables.guess_clock import Timing, called_times, even_clock
from wakedeploy.domains.tables.log import Field, Log, Values


def clocks_of(
    log: Log, fields: Sequence[Field], first: Timing, values: Mapping[str, Values]
) -> dict[str, Timing]:
    """The clock of each column that has not the first one; where none fits, the first stays."""
    if first.stamps_s is None:
        return {}
    by_name = {clock.column: clock for clock in called_times(log, log.fields())}
    clocks = [first, *(clock for name, clock in by_name.items() if name != first.column)]
    for field in fields:  # where no clock that is called so has its length
        seen = values.get(field.name)
        if seen is not None and len(seen) > 1 and not any(_fits(clock, seen) for clock in clocks):
            clocks += _even(log, fields, values, len(seen))
    found = {name: _clock_of(name, seen, clocks) for name, seen in values.items()}
    return {name: clock for name, clock in found.items() if clock is not first}


def _even(
    log: Log, fields: Sequence[Field], values: Mapping[str, Values], count: int
) -> list[Timing]:
    """The columns of a length that rise evenly."""
    same = [field for field in fields if len(values.get(field.name, ())) == count]
    found = [even_clock(log, field) for field in same]
    return [clock for clock in found if clock is not None]


def _clock_of(name: str, seen: Values, clocks: Sequence[Timing]) -> Timing:
    """Of the clocks that are as long as a column, the one whose name has most of its words.

    Where the first clock is as long, only one of the column's own group is nearer.
    """
    fitting = [clock for clock in clocks if _fits(clock, seen)]
    if clocks[0] in fitting:
        group = _group(name)
        own = [clock for clock in fitting if group and _group(clock.column or "") == group]
        return (own or fitting)[0]
    return max(fitting, key=lambda clock: _shared(clock.column or "", name), default=clocks[0])


def _fits(clock: Timing, seen: Values) -> bool:
    return clock.stamps_s is not None and len(clock.stamps_s) == len(seen)


def _group(address: str) -> str:
    return address.rpartition("/")[0]


def _shared(address: str, other: str) -> int:
    """How many words two addresses share."""
    return len(_words(address) & _words(other))


def _words(address: str) -> set[str]:
    return set(re.findall(r"[a-z]+", address.lower()))
