"""Values with intervals, one row each, as SVG that says a row's numbers under the pointer.

In: numbers. Out: places in a drawing, for the macro `dots` of the common templates; no script.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from wakedeploy.core.line_chart import WIDTH, round_ticks, shown

_RIGHT, _TOP, _BOTTOM = 24, 44, 40
_ROW = 19
_LETTER, _GAP = 6.6, 14  # width of a letter, and between a name and the axis
_MOST_LETTERS = 32
_APART = 46  # between two words below the axis
_EDGE = 0.02  # of the axis, left free at either end
_BESIDE = 9  # from a mark to its note

BLUE, ORANGE, GREEN, GREY = "of-0", "of-1", "of-2", "of-rest"  # the classes of report.css


@dataclass(frozen=True)
class Dot:
    """A named value with its interval; what is NaN is not drawn. A pointer reads what it `says`.

    `note` stands beside it; a marked one stands out.
    """

    name: str
    value: float
    low: float
    high: float
    says: str
    colour: str = BLUE
    marked: bool = False
    note: str = ""


class Row(NamedTuple):
    """A dot with its places; None for what is not drawn."""

    y: float
    name: str
    dot: Dot
    x: float | None
    ends: tuple[float, float] | None
    is_begun: bool  # an end alone, of what has no other
    note_x: float
    note_anchor: str


@dataclass(frozen=True)
class DotChart:
    """Rows over one axis. `limit` is a dashed line (NaN: none), `limit_says` its name.

    The axis is linear within ± `linear`, and logarithmic beyond.
    """

    title: str
    x_label: str
    dots: Sequence[Dot]
    limit: float = math.nan
    limit_says: str = ""
    linear: float = math.inf

    width, row_height, y_top = WIDTH, _ROW, _TOP
    x_right = WIDTH - _RIGHT

    @property
    def y_bottom(self) -> int:
        """Where the axis ends at the bottom [px]."""
        return self.y_top + _ROW * len(self.dots)

    @property
    def height(self) -> int:
        """The height of the drawing [px]."""
        return self.y_bottom + _BOTTOM

    @property
    def x_left(self) -> float:
        """Behind the longest name."""
        longest = max((len(_cut(dot.name)) for dot in self.dots), default=0)
        return round(_LETTER * longest + _GAP, 1)

    @property
    def rows(self) -> list[Row]:
        """From the top."""
        return [self._row(self.y_top + _ROW * (at + 0.5), dot) for at, dot in enumerate(self.dots)]

    @property
    def limit_at(self) -> float | None:
        """Where the dashed line is."""
        return self.across(self.limit) if math.isfinite(self.limit) else None

    @property
    def limit_anchor(self) -> str:
        """Where its name fits: it is centred unless the drawing ends there."""
        half = 0.5 * _LETTER * len(self.limit_says)
        return "end" if (self.limit_at or 0.0) + half > self.width else "middle"

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Places and words below the axis, none too near the next one."""
        placed: list[tuple[float, str]] = []
        for value in self._tick_values():
            place = self.across(value)
            if all(abs(place - other) >= _APART for other, _ in placed):
                placed.append((place, shown(value)))
        return placed

    def across(self, value: float) -> float:
        """The place of a value."""
        low, high = map(self._bent, self._range)
        edge = _EDGE * (high - low)
        share = (self._bent(value) - low + edge) / (high - low + 2 * edge)
        return round(self.x_left + (self.x_right - self.x_left) * share, 1)

    def _row(self, y: float, dot: Dot) -> Row:
        x = self.across(dot.value) if math.isfinite(dot.value) else None
        has_ends = math.isfinite(dot.low + dot.high)
        ends = (self.across(dot.low), self.across(dot.high)) if has_ends else None
        taken = [place for place in (x, *(ends or ())) if place is not None] or [self.across(0.0)]
        behind = max(taken) + _BESIDE
        fits = behind + _LETTER * len(dot.note) <= self.width
        place = behind if fits else min(taken) - _BESIDE
        is_begun = x is None and ends is not None and ends[0] == ends[1]
        anchor = "start" if fits else "end"
        return Row(y, _cut(dot.name), dot, x, ends, is_begun, round(place, 1), anchor)

    def _tick_values(self) -> list[float]:
        """The more important ones first: zero, then outwards."""
        low, high = self._range
        if max(-low, high) <= self.linear:
            return sorted(round_ticks(low, high), key=abs)
        first = math.floor(math.log10(self.linear / 2))
        last = math.ceil(math.log10(max(-low, high)))
        sizes = [step * 10.0**decade for decade in range(first, last + 1) for step in (1, 2, 5)]
        outwards = [sign * size for size in sizes if size >= self.linear / 2 for sign in (1, -1)]
        return [value for value in (0.0, *outwards) if low <= value <= high]

    @property
    def _range(self) -> tuple[float, float]:
        """All that is drawn, and zero."""
        every = [self.limit, *(v for dot in self.dots for v in (dot.value, dot.low, dot.high))]
        known = [value for value in every if math.isfinite(value)]
        low, high = min(0.0, *known, 0.0), max(0.0, *known, 0.0)
        return (low, high) if high > low else (-1.0, 1.0)

    def _bent(self, value: float) -> float:
        """Linear near zero, and as long for each decade beyond as from zero to there."""
        if math.isinf(self.linear):
            return value
        size = abs(value) / self.linear
        return math.copysign(size if size <= 1.0 else 1.0 + math.log10(size), value)


def _cut(name: str) -> str:
    """A name as long as there is room for."""
    return name if len(name) <= _MOST_LETTERS else f"{name[: _MOST_LETTERS - 1]}…"
