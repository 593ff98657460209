"""Numbers as words: what is not a finite number becomes a dash, never an error.

In: numbers, None or NaN where nobody measured one. Out: plain floats and arrays, and text with
units.
"""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

UNKNOWN = "–"
DETAILS = "In detail:"  # what comes before it needs no statistics
_LARGEST = 1e60
_LARGE = 1e12  # from here on an exponent reads better than zeros do
_SMALL = 0.2  # below this, seconds and metres read better in thousandths
_THOUSANDTHS = {"s": "ms", "m": "mm"}
_WIDEST = 100.0  # intervals that span more orders of magnitude get no further digits
_MOST_DECIMALS = 7  # smaller numbers are written with an exponent
_MOST_DIGITS = 12
_DIMENSIONLESS = ("", "1", "-", "–")
_SIGNS = {r"\bus\b": "µs", r"\^2": "²", r"\^3": "³"}
_UNIT_SUFFIX = re.compile(r"_(n_per_mps|n_per_m|s_per_m|per_s|per_m|m2ps|mps|us|s|m|n|kg|hz)$")


def number(value: Any) -> float:
    """A finite float, or NaN for whatever is none (null, text, infinity, what nobody measured)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    return float(value) if abs(value) <= _LARGEST else math.nan


def numbers(values: Any) -> FloatArray:
    """A list of numbers (n,); NaN where an entry is none."""
    if not isinstance(values, Sequence) or isinstance(values, str):
        return np.empty(0)
    return np.array([number(value) for value in values], dtype=np.float64)


def scale_of(values: Sequence[float] | FloatArray, unit: str) -> tuple[float, str]:
    """Factor and unit in which values read best: small seconds and metres in thousandths."""
    finite = np.abs(np.asarray(values, dtype=np.float64))
    finite = finite[np.isfinite(finite)]
    if unit in _THOUSANDTHS and finite.size and finite.max() < _SMALL:
        return 1e3, _THOUSANDTHS[unit]
    return 1.0, "" if unit in _DIMENSIONLESS else signs(unit)


def signs(unit: str) -> str:
    """A unit as printed: `µs` for `us`, `m²/s` for `m^2/s`."""
    for plain, printed in _SIGNS.items():
        unit = re.sub(plain, printed, unit)
    return unit


def quantity(value: Any, unit: str, signed: bool = False) -> str:
    """A value with its unit, two to three significant digits: `12.4 mm`."""
    known = number(value)
    if math.isnan(known):
        return UNKNOWN
    factor, shown = scale_of([known], unit)
    return _with_unit(_digits(factor * known, abs(factor * known) / 10, signed), shown)


def measured(value: Any, low: Any, high: Any, unit: str) -> str:
    """A value with interval, to the digits that the interval allows: `52 ms (47 to 58)`."""
    known, bottom, top = number(value), number(low), number(high)
    if math.isnan(known) or math.isnan(bottom) or math.isnan(top):
        return quantity(value, unit)
    factor, shown = scale_of([known, bottom, top], unit)
    spread = factor * (top - bottom) / 2 or factor * abs(known)
    if bottom * top > 0.0:  # an end far nearer to 0 than to the other one would read "0.00"
        spread = min(spread, max(factor * min(abs(bottom), abs(top)), spread / _WIDEST))
    middle, first, last = (_digits(factor * each, spread) for each in (known, bottom, top))
    return f"{_with_unit(middle, shown)} ({first} to {last})"


def span(low: Any, high: Any, unit: str) -> str:
    """A range of values: `from 2.0 to 3.5 N`, to the digits in which its ends differ."""
    first, last = number(low), number(high)
    if math.isnan(first) or math.isnan(last):
        return f"from {quantity(low, unit)} to {quantity(high, unit)}"
    factor, shown = scale_of([first, last], unit)
    spread = factor * abs(last - first) / 10
    return _with_unit(
        f"from {_digits(factor * first, spread)} to {_digits(factor * last, spread)}", shown
    )


def percent(share: Any) -> str:
    """A share as a percentage."""
    known = number(share)
    return UNKNOWN if math.isnan(known) else f"{minus(f'{100 * known:.0f}')} %"


def confidence(share: Any) -> str:
    """A probability as a percentage that is never quite 0 or 100."""
    known = number(share)
    if known >= 0.995:
        return "over 99 %"
    return "under 1 %" if known < 0.005 else percent(share)


def probability(symbol: str, value: Any) -> str:
    """`q = 0.012`, or `q < 0.001`."""
    known = number(value)
    if math.isnan(known):
        return f"{symbol} {UNKNOWN}"
    return f"{symbol} < 0.001" if known < 0.001 else f"{symbol} = {known:.2g}"


def listed(names: Sequence[str], last: str = "and") -> str:
    """`a, b and c`."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


def with_name(phrase: str, name: str) -> str:
    """What an effect is, then its name as code; the name alone where there is no phrase."""
    return f"{phrase} (`{name}`)" if phrase else f"`{name}`"


def halves_said(agree: bool, halves: Sequence[str], recordings: str) -> str:
    """Whether both halves of the `recordings` agree, and what each of them says."""
    each = "; and ".join(halves)
    if agree:
        return f"Both halves of the {recordings} say so by themselves: {each}."
    said = f"The two halves of the {recordings} do not agree: {each}."
    return f"{said} More {recordings} would tell."


def nats(gain: float) -> str:
    """A gain in nats with a minus sign as in all other numbers: `−1.4 nats`."""
    return f"{minus(f'{gain:.1f}')} nats"


def counted(count: int, thing: str) -> str:
    """`1 flight`, `3 flights`."""
    return f"{count:,} {thing}{'' if count == 1 else 's'}"


def spoken(parameter: str) -> str:
    """A parameter's name without its unit: `up` for `up_s`."""
    return _UNIT_SUFFIX.sub("", parameter).replace("_", " ")


def _digits(value: float, spread: float, signed: bool = False) -> str:
    """A number to the digit in which its spread counts between 3 and 30."""
    if spread > 0.0 and math.isfinite(spread):
        decimals = max(0, -math.floor(math.log10(spread / 3.0)))
    else:
        decimals = 0
    sign = "+" if signed else ""
    if decimals > _MOST_DECIMALS and abs(value) < 10.0**-_MOST_DECIMALS:
        return minus(f"{value:{sign}.3g}")
    if abs(value) >= _LARGE:
        digits = math.log10(3.0 * abs(value) / spread) if 0.0 < spread < math.inf else 2.0
        return minus(f"{value:{sign}.{min(max(math.ceil(digits), 2), _MOST_DIGITS)}e}")
    decimals = min(decimals, _MOST_DECIMALS + 2)
    text = f"{value:{sign},.{decimals}f}"
    return text.lstrip("-") if float(text.replace(",", "")) == 0.0 else minus(text)


def _with_unit(text: str, unit: str) -> str:
    return f"{text} {unit}" if unit else text


def behind(unit: str) -> str:
    """A unit as it stands behind a number; nothing for a pure number."""
    return "" if unit in ("", "1") else f" {unit}"


def minus(text: str) -> str:
    """A number's text with a minus sign in the place of a hyphen."""
    return text.replace("-", "−")
