"""Curves as SVG whose points say their values under the pointer, for reports, without a script.

In: numbers. Out: places in a drawing of fixed size, for the macro `chart` of the common templates.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

WIDTH, HEIGHT = 720, 260
_LEFT, _RIGHT, _TOP, _BOTTOM = 58, 12, 30, 40
_MOST_POINTS = 300  # of a curve: more cannot be told apart
_TICKS = 5

Point = tuple[float, float]


@dataclass(frozen=True)
class Curve:
    """A named line past None and NaN, as between the readings of a slow sensor."""

    name: str
    x: Sequence[float]
    y: Sequence[float | None]


@dataclass(frozen=True)
class LineChart:
    """Up to three curves over one axis; `x_label` and `y_label` also name a point's values."""

    curves: Sequence[Curve]
    x_label: str
    y_label: str

    width, height = WIDTH, HEIGHT
    x_left, x_right = _LEFT, WIDTH - _RIGHT
    y_top, y_bottom = _TOP, HEIGHT - _BOTTOM

    # Once for a chart: each point's place asks for the ranges, and these for every point.
    @functools.cached_property
    def _points(self) -> list[Point]:
        return [point for curve in self.curves for point in _known(curve)]

    def __bool__(self) -> bool:
        """A chart without two points is none."""
        return len(self._points) > 1

    @functools.cached_property
    def _x_range(self) -> tuple[float, float]:
        known = [x for x, _ in self._points]
        return min(known), max(known)

    @functools.cached_property
    def _y_range(self) -> tuple[float, float]:
        """From zero, or from the ticks around the values where these are far from zero."""
        known = [y for _, y in self._points]
        low, high = min(0.0, *known), max(known)
        step = _step(low, high)
        return step * math.floor(low / step), step * math.ceil(high / step)

    @property
    def x_ticks(self) -> list[tuple[float, str]]:
        """Places and words below the axis."""
        return [(self._across(x), shown(x)) for x in round_ticks(*self._x_range)]

    @property
    def y_ticks(self) -> list[tuple[float, str]]:
        """Places and words beside the axis."""
        return [(self._up(y), shown(y)) for y in round_ticks(*self._y_range)]

    @property
    def lines(self) -> list[tuple[str, str, list[tuple[float, float, str]]]]:
        """Name, path and dots (x, y, what is said there) of each curve."""
        return [(curve.name, self._path(curve), self._dots(curve)) for curve in self.curves]

    def _path(self, curve: Curve) -> str:
        places = (f"{self._across(x):.1f},{self._up(y):.1f}" for x, y in _known(curve))
        return "M" + "L".join(places)

    def _dots(self, curve: Curve) -> list[tuple[float, float, str]]:
        return [
            (
                self._across(x),
                self._up(y),
                f"{curve.name}: {shown(y, '.4g')} at {self.x_label} {shown(x)}",
            )
            for x, y in _known(curve)
        ]

    def _across(self, x: float) -> float:
        low, high = self._x_range
        return round(
            self.x_left + (self.x_right - self.x_left) * (x - low) / ((high - low) or 1.0), 1
        )

    def _up(self, y: float) -> float:
        low, high = self._y_range
        return round(
            self.y_bottom - (self.y_bottom - self.y_top) * (y - low) / ((high - low) or 1.0), 1
        )


def shown(value: float, digits: str = "g") -> str:
    """A number with a minus sign, as in sentences and tables."""
    return format(value, digits).replace("-", "−")


def _known(curve: Curve) -> list[Point]:
    pairs = zip(curve.x, curve.y, strict=True)
    known = [(x, y) for x, y in pairs if y is not None and math.isfinite(y)]
    every = -(-len(known) // _MOST_POINTS) or 1
    return known[::every]


def _step(low: float, high: float) -> float:
    """A round distance between some five ticks."""
    rough = max(high - low, 1e-12) / _TICKS
    decade = 10.0 ** math.floor(math.log10(rough))
    return decade * next(step for step in (1, 2, 5, 10) if step * decade >= rough * (1 - 1e-9))


def round_ticks(low: float, high: float) -> list[float]:
    """Some five round numbers between two."""
    step = _step(low, high)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(number * step, 12) for number in range(first, last + 1)]
