"""Which columns of a log are the inputs and outputs that a system asks for.

In: what is asked for, and the columns of a log with their units. Out: pairs that agree in name, or
in a unit that no other has. What could be two is neither.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from wakedeploy.core.units import is_angular, same_dimension, unit_at_end

Place = tuple[str, str]  # a file in a folder, "" for one that is alone, and a column's name there

BY_NAME, BY_UNIT = "by its name", "the only one left in such a unit"

_LIKE = 0.5  # of two names' words, from which on they may mean one thing; 1 where all are the same
_SHORTEST, _CUT = 3, 0.9  # letters of a word that is cut short, and what it counts for
_BRACKETS = re.compile(r"\s*[(\[][^()\[\]]*[)\]]\s*$")
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z][a-z])")  # motorVoltage, and not motor_mV
_WORD = re.compile(r"[a-z]+|\d+")


@dataclass(frozen=True)
class Asked:
    """What a system asks of its logs: a name, a role ("input" or "output") and a unit."""

    name: str
    role: str
    unit: str


@dataclass(frozen=True)
class Match:
    """What a column is of, and how that was seen: `BY_NAME` or `BY_UNIT`."""

    asked: Asked
    seen: str


def matched(asked: Sequence[Asked], columns: Mapping[Place, str | None]) -> dict[Place, Match]:
    """The columns that are what is asked for; others are left out.

    `columns` has each column's unit, None where the log does not say one. A column in another
    dimension than what is asked for is none of it.
    """
    found: dict[Place, Match] = {}
    for alike, seen in ((_names_alike, BY_NAME), (_units_alike, BY_UNIT)):
        taken = {match.asked for match in found.values()}
        left = [each for each in asked if each not in taken]
        free = {place: unit for place, unit in columns.items() if place not in found}
        found |= {place: Match(each, seen) for place, each in _paired(left, free, alike)}
    return found


_Alike = Callable[[Asked, str, str | None], float]


def _paired(
    asked: Sequence[Asked], columns: Mapping[Place, str | None], alike: _Alike
) -> Iterator[tuple[Place, Asked]]:
    """Pairs of which neither side is as much like anything else that is left, the likest first."""
    likeness = {
        (each, place): alike(each, place[1], unit)
        for each in asked
        for place, unit in columns.items()
        if unit is None or _fits(unit, each.unit)
    }
    likeness = {pair: value for pair, value in likeness.items() if value > 0.0}
    while likeness:
        most = max(likeness.values())
        best = [pair for pair, value in likeness.items() if value == most]
        for each, place in best:
            if sum(e == each or p == place for e, p in best) == 1:
                yield place, each
        done = {side for pair in best for side in pair}  # what could be two is neither
        likeness = {pair: v for pair, v in likeness.items() if not done.intersection(pair)}


def _names_alike(asked: Asked, column: str, unit: str | None) -> float:
    """The share of words that a name has in common with a column's, or with its last part."""
    own = _words(asked.name)
    share = max(_shared(own, _words(name)) for name in {column, column.rpartition("/")[2]})
    return share if share >= _LIKE else 0.0


def _shared(words: frozenset[str], others: frozenset[str]) -> float:
    """The words that are in both, or begin one in the other, over half of all."""
    if not words or not others:
        return 0.0
    alike = sum(max(_alike(word, other) for other in others) for word in words)
    return 2.0 * alike / (len(words) + len(others))


def _alike(word: str, other: str) -> float:
    """1 for the same word, less for one that was cut short, as pos for position."""
    if word == other:
        return 1.0
    short, long = sorted((word, other), key=len)
    return _CUT if len(short) >= _SHORTEST and long.startswith(short) else 0.0


def _units_alike(asked: Asked, column: str, unit: str | None) -> float:
    """1 where the log says a unit and the system asks for one; of pure numbers all are alike."""
    return float(unit is not None and not _fits(asked.unit, "1"))


def _fits(unit: str, other: str) -> bool:
    """Whether two units are of one quantity; an angle is no pure number."""
    return same_dimension(unit, other) and is_angular(unit) == is_angular(other)


def _words(name: str) -> frozenset[str]:
    """The words of a name, without the unit at its end."""
    bare = _HUMP.sub("_", _BRACKETS.sub("", name)).lower()
    words = _WORD.findall(bare)
    if len(words) > 1 and unit_at_end(bare.replace(" ", "_")) is not None:
        del words[-1]
    return frozenset(words)
