"""Places, whiteness, variables and detectable sizes in words.

In: parts of artefacts. Out: phrases for sentences and tables.
"""

import math
import re
from collections.abc import Mapping

from wakedeploy.gap.search.artefacts import Place, White
from wakedeploy.gap.systems.gantry.findings import (
    Detectable,
)
from wakedeploy.gap.wording import (
    probability,
    quantity,
    span,
    spoken,
    with_name,
)
from wakedeploy.physics.effects import LIBRARY

_STATED_Q = re.compile(r",? ?\(?q [=<] [0-9.e-]+\)?$")  # at the end of a place's own words


def plain(name: str) -> str:
    """An effect of the library in words before its name: what it does, and `range-drift`."""
    clause = LIBRARY[name].physics.partition(";")[0].rstrip(".") if name in LIBRARY else ""
    return with_name(f"{clause[:1].lower()}{clause[1:]}", name)


def place_words(place: Place) -> str:
    """A place in words: those it came with, without the q value, or made of its bounds."""
    if place.words:
        return _STATED_Q.sub("", place.words.rstrip("."))
    where = span(place.low, place.high, place.coordinate_unit)
    residual = quantity(place.residual, place.unit, signed=True)
    return f"at {place.coordinate} {where}: {place.channel} {residual}"


def detectable_sizes(sizes: Mapping[str, Detectable]) -> list[tuple[str, str, str]]:
    """(effect, parameter, smallest size that would have been found) where that is known."""
    return [
        (name, spoken(size.parameter), quantity(size.size, size.unit))
        for name, size in sizes.items()
        if not math.isnan(size.size)
    ]


def undetectable(sizes: Mapping[str, Detectable]) -> list[str]:
    """Effects that would not have been found at any size within their bounds."""
    return [name for name, size in sizes.items() if math.isnan(size.size) and size.known]


def untold(sizes: Mapping[str, Detectable]) -> list[str]:
    """Effects so far from linear that no size can be stated without flying them."""
    return [name for name, size in sizes.items() if math.isnan(size.size) and not size.known]


def whiteness_words(white: White) -> str:
    """The statistic beside what noise alone hardly exceeds; the p value where no limit is known."""
    if math.isnan(white.limit):
        return probability("p", white.p_value)
    statistic, limit = (quantity(each, "") for each in (white.statistic, white.limit))
    return f"statistic {statistic}, of noise alone at most {limit}"


def coordinate(symbol: str) -> str:
    """A variable of an expression in words: `carriage position (x_m)`."""
    return f"{_SPOKEN[symbol]} ({symbol})" if symbol in _SPOKEN else symbol


_SPOKEN = {
    "time_s": "time in flight",
    "x_m": "carriage position",
    "vx_mps": "carriage speed",
    "z_m": "height",
    "vz_mps": "vertical speed",
    "source_n": "source's thrust",
    "source_rate_nps": "slope of the source's thrust",
    "sufferer_n": "sufferer's thrust",
    "wake_mps": "wake's speed at the sufferer",
    "wake_n": "wake's force",
    "charge_s": "charge drawn",
    "travelled_m": "carriage's way",
    "direction": "carriage's direction",
}
