"""A column of a log with its stamps, and what it shows at even ticks.

In: numbers of a log and their clock. Out: numbers at ticks, NaN where a reading is not measured.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.tables.columns import Resampling
from wakedeploy.domains.tables.log import Clock, Log, refused
from wakedeploy.domains.tables.resampling import averaged, held, interpolated, low_passed, refreshed
from wakedeploy.domains.tables.stamps import Timeline
from wakedeploy.domains.tables.wanted import Wanted

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Place:
    """Where a column stands: its log, its addresses there, and its clock (None: a stated rate).

    `address` is what it is called in sentences; it has several `addresses` if it is computed.
    """

    log: Log
    address: str
    clock: Clock | None
    addresses: tuple[str, ...]

    @property
    def stamped_by(self) -> str:
        """What columns that were stamped together share: file and clock."""
        clock = (self.clock.address, self.clock.nanoseconds) if self.clock else ()
        return f"{self.log.path.name}:{' and '.join(filter(None, clock))}"

    def row(self, index: int) -> str:
        """What a row of it is called."""
        return self.log.place(self.addresses[0], index)

    def refused(self, reason: str, advice: str) -> UnusableInput:
        """The sentence for this column."""
        return refused(self.log.path, self.address, reason, advice)

    def clock_refused(self, reason: str, advice: str) -> UnusableInput:
        """The sentence for this column's clock."""
        address = self.clock.address if self.clock else self.address
        return refused(self.log.path, address, reason, advice)


@dataclass(frozen=True, eq=False)
class Series:
    """A column with its stamps: `values` (m,) in the unit wanted, NaN where there is none."""

    wanted: Wanted
    place: Place
    times: Timeline
    values: Vector

    @property
    def name(self) -> str:
        """What it is called in `columns.toml`."""
        return self.wanted.name

    @property
    def is_event(self) -> bool:
        """Whether its last sample holds to the end."""
        return self.wanted.column.event

    @property
    def is_reading(self) -> bool:
        """Whether it counts only where it was measured."""
        return self.wanted.column.is_reading

    @property
    def is_held(self) -> bool:
        """Whether the last number stands for those that are missing."""
        is_told_to = self.wanted.column.missing == "hold" and not self.is_reading
        return is_told_to or self.is_event

    def with_numbers(self) -> tuple[Vector, Vector]:
        """The stamps that have a number, and those numbers."""
        is_there = ~np.isnan(self.values)
        return self.times.stamps_s[is_there], self.values[is_there]

    def filled(self) -> Vector:
        """The values, with the last one held where one is missing and shall be held."""
        if not self.is_held:
            return self.values
        is_there = ~np.isnan(self.values)
        newest = np.maximum.accumulate(np.where(is_there, np.arange(len(is_there)), -1))
        return np.where(newest >= 0, self.values[np.maximum(newest, 0)], np.nan)

    def at_ticks(self, ticks_s: Vector, how: Resampling) -> Vector:
        """Its values at ticks; of a reading only where a number came since the tick before.

        A reading that is repeated would count as measured again: the likelihood would take the
        repeats for physics. What drives the system acts on, and is held.
        """
        if self.wanted.method == "interpolate":
            return interpolated(*self.with_numbers(), ticks_s)
        if self.wanted.method == "average":
            return averaged(*self.with_numbers(), ticks_s)
        if not self.is_reading:
            return self._brought(self.times.stamps_s, self.filled(), ticks_s, how)
        stamps_s, values = self.with_numbers()
        if how.method == "low-pass" and self.wanted.column.missing == "nan":
            stamps_s, values = self.times.stamps_s, self.values
        brought = self._brought(stamps_s, values, ticks_s, how)
        return np.where(refreshed(stamps_s, ticks_s), brought, np.nan)

    def _brought(
        self, stamps_s: Vector, values: Vector, ticks_s: Vector, how: Resampling
    ) -> Vector:
        if how.method == "hold":
            return held(stamps_s, values, ticks_s)
        first = max(int(np.searchsorted(stamps_s, ticks_s[0], side="right")) - 1, 0)
        if np.isnan(values[first:]).any():
            also = ', or "hold" where other columns have rows between its own'
            advice = f'give missing = "split"{also if self.is_reading else ""}'
            raise self.place.refused(
                "has samples without a number, which no filter takes",
                f"{advice}, in [columns.{self.name}]",
            )
        try:
            return low_passed(stamps_s, values, ticks_s, how.effective_cutoff_hz)
        except ValueError as error:
            raise self.place.refused(f"cannot be filtered: {error}", "cut the log") from error
