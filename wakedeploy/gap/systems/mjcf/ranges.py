"""What an answer says of an MJCF file's numbers: a value and an interval for each.

In: the elements of a file, the constants as its system states them and as they were fitted. Out:
ranges to write and to draw from, numbers that follow from them, and sentences. A range holds the
stated value where the logs do not rule that out.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from wakedeploy.gap.search.artefacts import Measured, Sizes
from wakedeploy.gap.systems.mjcf.elements import Attribute, Elements
from wakedeploy.gap.systems.system import Constant
from wakedeploy.gap.wording import listed

CORRECTED, RANGES = "corrected.xml", "ranges.toml"
_RULED_OUT = 3.0  # standard errors between a stated value and the logs'
_AS_WRITTEN = 1e-5  # share by which a template's six digits differ from the file
_IN_HALF = 1.645  # standard errors in half an interval of 90 %

Key = tuple[str, str, str]


@dataclass(frozen=True)
class Range:
    """A number of the file: its value by the logs, and the interval in which it may lie.

    `attribute` is its name in MJCF, with a place where it is one of several: `biasprm[0]`. `stated`
    is what the system's file says of it, of a number that was known before.
    """

    element: str
    name: str
    attribute: str
    nominal: float
    low: float
    high: float
    unit: str
    stated: float | None = None

    @property
    def key(self) -> Key:
        """Its place in the file."""
        return self.element, self.name, self.attribute

    @property
    def size(self) -> Measured:
        """The value with its interval."""
        return Measured(value=self.nominal, low=self.low, high=self.high, unit=self.unit)

    def plus(self, size: Measured, factor: float = 1.0) -> "Range":
        """The same with a found value on top, its interval with it."""
        low, high = sorted((factor * size.low, factor * size.high))
        nominal = self.nominal + factor * size.value
        return replace(
            self, nominal=nominal, low=self.low + low, high=self.high + high, stated=None
        )

    def times(self, size: Measured) -> "Range":
        """The same times a found factor, its interval with it."""
        ends = [end * factor for end in (self.low, self.high) for factor in (size.low, size.high)]
        nominal = self.nominal * size.value
        return replace(self, nominal=nominal, low=min(ends), high=max(ends), stated=None)

    def row(self) -> dict[str, Any]:
        """As the file of ranges has it."""
        row = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: value for name, value in row.items() if value is not None}


@dataclass(frozen=True)
class Following:
    """Numbers that follow from a range and are not drawn: limits that move, a spring's rest."""

    element: str
    name: str
    attribute: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class Found:
    """An effect that was named, `kind@port`, and its parameters with their intervals."""

    name: str
    parameters: Sizes

    @property
    def kind(self) -> str:
        """What it is."""
        return self.name.partition("@")[0]

    @property
    def port(self) -> str:
        """Where it acts."""
        return self.name.partition("@")[2]


@dataclass
class Fitted:
    """What is written: `ranges` and `following` by their place, and sentences about the rest."""

    elements: Elements
    ranges: dict[Key, Range] = field(default_factory=dict)
    following: dict[Key, Following] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    absent: list[str] = field(default_factory=list)  # of effects that MJCF has no attribute for
    has_effects: bool = False
    commands: dict[str, tuple[Range, Range]] = field(default_factory=dict)  # factor and sum of each
    cut: dict[str, tuple[Range, Range]] = field(default_factory=dict)  # lower and upper limit

    def value(self, element: str, name: str, attribute: str, otherwise: float) -> float:
        """A number as it will be written, `otherwise` where it stays."""
        found = self.ranges.get((element, name, attribute))
        return otherwise if found is None else found.nominal

    def add(self, start: Range, size: Measured, factor: float = 1.0) -> None:
        """A found value on top of what is there, which `start` is at first."""
        self.ranges[start.key] = self.ranges.get(start.key, start).plus(size, factor)

    def follow(self, element: str, name: str, attribute: str, *values: float) -> None:
        """A number that follows."""
        self.following[element, name, attribute] = Following(element, name, attribute, values)


def add_constants(
    written: Fitted, constants: Mapping[str, Constant], fitted: Sizes, *, is_open: bool = False
) -> None:
    """As fitted, or as stated where that is exact and not what the file has.

    Where it is open which of several effects is missing, constants bend to those that are left out,
    so no stated value is ruled out.
    """
    doubted = []
    for name, attribute in written.elements.attributes.items():
        constant = constants.get(name)
        if name in fitted:
            by_logs = _plain(attribute, fitted[name].unit).plus(fitted[name])
            known = by_logs if constant is None else _with_stated(by_logs, constant, is_open)
            if constant is not None and not known.low <= _stated(known) <= known.high:
                written.said.append(_contradicted(name, known, constant))
            elif (known.low, known.high) != (by_logs.low, by_logs.high):
                doubted.append(name)
            written.ranges[known.key] = known
        elif constant is not None and not _is_as_written(constant, attribute):
            exact, value = _plain(attribute, attribute.unit), constant.value
            written.ranges[exact.key] = replace(exact, nominal=value, low=value, high=value)
    if doubted:
        why = (
            "with another member of the class the logs may want that."
            if is_open
            else "the logs prefer another, and do not rule it out."
        )
        written.said.append(f"{RANGES} reaches to the stated value of {listed(doubted)}: {why}")


def _is_as_written(constant: Constant, attribute: Attribute) -> bool:
    return math.isclose(constant.value, attribute.value, rel_tol=_AS_WRITTEN)


def _with_stated(fit: Range, constant: Constant, is_open: bool) -> Range:
    """With what was known before, in its interval where the logs do not rule that out."""
    value = constant.value
    if not 0.0 < constant.spread < math.inf:
        return fit
    known = replace(fit, stated=value)
    if not is_open and _is_ruled_out(fit, value):
        return known
    return replace(known, low=min(known.low, value), high=max(known.high, value))


def _stated(known: Range) -> float:
    return known.nominal if known.stated is None else known.stated


def _is_ruled_out(fit: Range, stated: float) -> bool:
    half = fit.high - fit.nominal if stated > fit.nominal else fit.nominal - fit.low
    return abs(stated - fit.nominal) > _RULED_OUT / _IN_HALF * half


def _contradicted(name: str, known: Range, constant: Constant) -> str:
    stated = f"{constant.value:.4g} ± {constant.spread:.2g} {known.unit}"
    return (
        f"{name} is stated as {stated}, and the logs rule that out: {RANGES} has {known.low:.4g} "
        f"to {known.high:.4g}; look at the statement again."
    )


def _plain(of: Attribute, unit: str) -> Range:
    return as_is(of.element, of.of, of.attribute, 0.0, unit)


def as_is(element: str, name: str, attribute: str, value: float, unit: str) -> Range:
    """A number that has no interval yet."""
    return Range(element, name, attribute, value, value, value, unit)
