"""A column that is wanted of a log: its unit there and here, and what to do where it has no number.

In: an entry of `columns.toml`, and the unit that a system asks for. Out: numbers in that unit, and
sentences about units and names that do not agree.
"""

import re
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.angles import Unwrapped, turn_in, unwrapped
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Origin
from wakedeploy.core.units import (
    SHOWN_ALONE,
    contradicted,
    conversion,
    is_angular,
    is_known,
    is_named,
    same_dimension,
    same_unit,
    si_unit,
)
from wakedeploy.domains.tables.columns import Ahead, Column, Columns, Method

Vector = NDArray[np.float64]

_CELSIUS = re.compile(r"°c|deg_?c(?![a-z])|celsius")


class Wanted:
    """A column, the unit that its numbers shall be in, and how it is brought to the rate."""

    def __init__(self, name: str, column: Column, unit: str | None, columns: Columns) -> None:
        file = columns.file
        self.name, self.column, self._file = name, column, file
        shared = columns.resample.method if columns.resample else None
        self.method: Ahead | Method | None = column.resample or shared
        try:
            self.unit = unit or column.to or si_unit(column.unit)
            self._factor = conversion(column.unit, self.unit)
            if is_angular(column.unit) != is_angular(self.unit) and self._factor != 1:
                raise ValueError(
                    f"{column.unit!r} counts angle and {self.unit!r} does not, or the other way"
                    " round; give both as rad/s, or both as Hz"
                )
        except ValueError as error:
            raise UnusableInput(f"{file}: columns.{name}.unit: {error}.") from None
        self._turn = turn_in(self.unit)
        if column.wraps and self._turn is None:
            raise UnusableInput(
                f"{file}: columns.{name}.wraps: {self.unit!r} is no unit of an angle; give rad, "
                "deg or rev as the unit, or delete the line."
            )

    def require_honest_name(self) -> None:
        """A number in millivolts is not called `motor_v`: Python code would take it for volts."""
        named = contradicted(self.name, self.unit, surely=True)
        if named is not None and same_dimension(named, self.unit):
            advice = "delete the line `to`" if self.column.to else f'give to = "{named}"'
            raise UnusableInput(
                f"{self._file}: columns.{self.name} becomes {self.unit}, but its name says "
                f"{named}; {advice}, or rename it."
            )

    def doubt(self, stated: str | None) -> str:
        """What speaks against the column's unit: what its log states, or a name; "" for nothing.

        `stated` is the unit in the log's header or beside its numbers. A column with a factor of
        its own is not doubted.
        """
        column = self.column
        if column.column is None or self._is_scaled:
            return ""
        if column.unit == "K" and (stated in SHOWN_ALONE or _CELSIUS.search(column.column.lower())):
            return "read as K, and the log says °C; offset = 273.15 is missing"
        if stated is not None and _is_unit(stated) and not same_unit(stated, column.unit):
            return f"read as {column.unit}, and the log says {stated}; check `unit`"
        named = contradicted(column.column.partition("[")[0], column.unit)
        if named is None:
            # In its own name another unit of the same dimension may be what `to` or a system wants.
            renamed = contradicted(self.name.lower(), column.unit)
            is_other = renamed is not None and not same_dimension(renamed, column.unit)
            named = renamed if is_other else None
        if named is None:
            return ""
        return f"read as {column.unit}, and its name says {named}; check `unit`"

    def origin(self, stated: str | None) -> Origin | None:
        """The unit that its numbers have in the log, and whether the log says so, as for `doubt`.

        None for a column with a factor of its own, or that is made of several.
        """
        column = self.column
        if column.column is None or self._is_scaled:
            return None
        is_stated = stated is not None and _is_unit(stated) and same_unit(stated, column.unit)
        name = column.column.partition("[")[0].lower()
        return Origin(column.unit, is_stated or is_named(name, column.unit))

    def converted(self, values: Vector) -> Vector:
        """Numbers of the log in that unit."""
        factor: Fraction = self._factor
        with np.errstate(over="ignore", invalid="ignore"):  # the caller refuses what overflows
            scaled = values * self.column.scale + self.column.offset if self._is_scaled else values
            if factor == 1:
                return scaled
            return np.asarray(scaled * float(factor.numerator) / float(factor.denominator))

    def looked_through(self, values: Vector, stamps_s: Vector) -> Unwrapped:
        """Its numbers in that unit as an angle that goes on, where they are an angle's."""
        if self._turn is None or self.column.wraps is False:
            return Unwrapped(values, 0, 0)
        is_certain = self.column.wraps is True
        return unwrapped(values, self._turn, stamps_s, is_certain=is_certain)

    @property
    def advice_on_missing(self) -> str:
        """What to do where a sample has no number; what is held counts as measured."""
        if set(self.column.roles) == {"output"}:
            what = 'missing = "nan", which ignores it, or "split", which ends the recording there'
        else:
            what = 'missing = "split", or "hold" for what is written only when it changes'
        return f"give {what}, in [columns.{self.name}]"

    @property
    def _is_scaled(self) -> bool:
        return (self.column.scale, self.column.offset) != (1.0, 0.0)


def _is_unit(stated: str) -> bool:
    """Whether a text beside a column is a unit that is known, and not none."""
    return (is_known(stated) or stated in SHOWN_ALONE) and not same_unit(stated, "1")
