"""Which columns of a log are the inputs and outputs that a system asks for.

In: what is asked for, and the columns of a log with their units. Out: pairs that are called the
same, or of which one is called by more words that say nothing new, or that are alone in a unit.
What could be two is neither: a wrong column looks like a wrong model.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from wakedeploy.core.units import SHOWN_ALONE, is_angular, same_dimension, unit_at_end

Place = tuple[str, str]  # a file in a folder, "" for one that is alone, and a column's name there

SAME, BY_NAME, BY_UNIT = "", "by its name", "the only one in such a unit"
ONLY_ORIENTATION = "of the only orientation"

_CUT_SHORT = 3  # letters from which on a word may stand for a longer one, as pos for position
_UNIT = re.compile(r"\s*[(\[][^()\[\]]*[^()\[\]\d][^()\[\]]*[)\]]\s*$")  # (deg), and not [0]
_CELSIUS = ("degc", "celsius")
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z][a-z])")  # motorVoltage, and not motor_mV
_WORD = re.compile(r"[^\W\d_]+|\d+")
_QUANTITIES: Mapping[str, tuple[str, ...]] = {  # words that only say what a unit says, too
    "voltage": ("V",), "current": ("A",), "torque": ("N m",), "effort": ("N m", "N"),
    "force": ("N",), "thrust": ("N",), "power": ("W",), "pressure": ("Pa",),
    "temperature": ("K", "°C"), "angle": ("rad",), "position": ("m", "rad"),
    "height": ("m",), "distance": ("m",), "speed": ("m/s", "rad/s"), "rate": ("rad/s",),
    "velocity": ("m/s", "rad/s"), "acceleration": ("m/s^2", "rad/s^2"),
}  # fmt: skip
_OF_MESSAGES = {"data"}  # the only field of a message that is no more than a number
_OF_ROLE = {
    "input": {"command", "cmd", "input", "control", "ctrl"},
    "output": {"measured", "meas", "actual", "output", "sensor", "encoder", "observation", "state"},
}
# What a controller asks for has many names. Between two names that both have one they are the same.
_WANTED = {"command", "cmd", "ref", "reference", "setpoint", "target", "desired", "goal", "action"}
_MEANT = {"command", "cmd", "ref", "reference", "setpoint", "sp", "target", "desired", "des",
          "goal", "wanted", "error", "err"}  # fmt: skip


@dataclass(frozen=True)
class Asked:
    """What a system asks of its logs: a name, a role ("input" or "output") and a unit."""

    name: str
    role: str
    unit: str


@dataclass(frozen=True)
class Match:
    """What a column is of, and how that was seen: `SAME`, or a few words."""

    asked: Asked
    seen: str


@dataclass(frozen=True)
class Matches:
    """The columns that were found, and those that what was not found could be; maybe none.

    Where none is called like it, `in_unit` has the free ones in such a unit.
    """

    found: Mapping[Place, Match]
    undecided: Mapping[Asked, Sequence[Place]]
    in_unit: Mapping[Asked, Sequence[Place]] = field(default_factory=dict)


NOTHING_ASKED = Matches({}, {})


def matched(
    asked: Sequence[Asked], columns: Mapping[Place, str | None], left_out: Collection[str] = ()
) -> Matches:
    """The columns that are what is asked for.

    `columns` has each column's unit, None where the log does not say one; one in another dimension
    than what is asked for is none of it. `left_out` are the names of columns that cannot be read:
    what is called so is no other column.
    """
    found: dict[Place, Match] = {}
    undecided: dict[Asked, Sequence[Place]] = {}
    unread = {name.lower() for name in left_out}
    wanted = [each for each in asked if each.name.lower() not in unread]
    ranks = {(each, p): _rank(each, p[1], unit) for each in wanted for p, unit in columns.items()}
    for rank in sorted({r for r in ranks.values() if r is not None}):
        gone = {*undecided, *(m.asked for m in found.values())}
        taken = {*found, *(place for places in undecided.values() for place in places)}
        pairs = [
            (each, place)
            for (each, place), r in ranks.items()
            if r == rank and each not in gone and place not in taken
        ]
        for each, place in pairs:
            if sum(e == each or p == place for e, p in pairs) == 1:
                found[place] = Match(each, SAME if rank == 0 else BY_NAME)
            else:
                undecided[each] = [p for e, p in pairs if e == each]
    gone = {*undecided, *(m.asked for m in found.values())}
    for each in wanted:
        alone = _alone_in_unit(each, asked, columns)
        if each not in gone and alone is not None and alone not in found:
            found[alone] = Match(each, BY_UNIT)
            gone.add(each)
    free = {place: unit for place, unit in columns.items() if place not in found}
    undecided |= {each: _alike(each, free) for each in wanted if each not in gone}
    in_unit = {each: _in_unit(each, free) for each, places in undecided.items() if not places}
    return Matches(found, undecided, in_unit)


def may_be(asked: Asked, column: str) -> bool:
    """Whether a column is asked for by its name, whatever its unit is."""
    return _rank(asked, column, None) is not None


def _rank(asked: Asked, column: str, unit: str | None) -> int | None:
    """0 for the same name, then 1 and one for each word that only one of two names has.

    It is one more where both ask for something in other words, as `pan_cmd` and `pan_target`.

    None where such a word says something else, or where the units are of different quantities.
    """
    if unit is not None and not _fits(unit, asked.unit):
        return None
    names = _names(column, asked)
    if asked.name in names:
        return 0
    wanted, ranks = _words(asked.name, asked.unit), list[int]()
    for words in (_words(name, unit) for name in names):
        both = asked.role == "input" and wanted & _WANTED and words & _WANTED
        pairs = [(wanted, words), *([(wanted - _WANTED, words - _WANTED)] if both else [])]
        for place, (ours, theirs) in enumerate(pairs):
            apart = _apart(ours, theirs)
            if apart is not None and all(_says_nothing(word, asked) for word in apart):
                ranks.append(1 + place + len(apart))
    return min(ranks, default=None)


def _names(column: str, asked: Asked) -> set[str]:
    """What a column may be called: all of it, or what it is within its group.

    Of `/joint_states/knee/position`, as PlotJuggler writes a joint, that is `knee/position`; of
    `/cmd/knee/position` it is what a controller asks for, and no reading.
    """
    *above, group, last = ["", *column.split("/")]
    names = {column, last}
    is_quantity = all(any(_is_one(word, q) for q in _QUANTITIES) for word in _words(last, None))
    is_asked_for = bool(_words("/".join(above), None) & _MEANT)
    if group and is_quantity and is_asked_for == (asked.role == "input"):
        names.add(f"{group}/{last}")
    return names


def _apart(words: frozenset[str], others: frozenset[str]) -> frozenset[str] | None:
    """The words that one of two names has more; None where none is in both, or each has more."""
    extra = {w for w in words if not any(_is_one(w, other) for other in others)}
    foreign = {other for other in others if not any(_is_one(w, other) for w in words)}
    is_apart = len(extra) == len(words) or (extra and foreign)
    return None if is_apart else frozenset(extra | foreign)


def _is_one(word: str, other: str) -> bool:
    """Whether two words are the same, or one is the other cut short."""
    short, long = sorted((word, other), key=len)
    return word == other or (len(short) >= _CUT_SHORT and long.startswith(short))


def _says_nothing(word: str, asked: Asked) -> bool:
    """Whether a word says no more than a unit or a role says already."""
    units = next((u for q, u in _QUANTITIES.items() if _is_one(word, q)), ())
    return word in _OF_ROLE[asked.role] | _OF_MESSAGES or any(
        _fits(unit, asked.unit) for unit in units
    )


def _alone_in_unit(
    each: Asked, asked: Sequence[Asked], columns: Mapping[Place, str | None]
) -> Place | None:
    """The only column in such a unit, where nothing else is asked for in one.

    None where a column may be it whose unit the log does not say, by a word of its name.
    """
    if _fits(each.unit, "1") or sum(_fits(other.unit, each.unit) for other in asked) > 1:
        return None
    wanted = _words(each.name, each.unit)
    if any(unit is None and wanted & _words(p[1], None) for p, unit in columns.items()):
        return None
    places = [p for p, unit in columns.items() if unit is not None and _fits(unit, each.unit)]
    if len(places) != 1 or (each.role == "output" and _words(places[0][1], None) & _MEANT):
        return None
    return places[0]


def _alike(each: Asked, columns: Mapping[Place, str | None]) -> list[Place]:
    """Columns in such a unit whose names have all that the wanted one says, among other words."""
    wanted = {word for word in _words(each.name, each.unit) if not _says_nothing(word, each)}
    found = []
    for place, unit in columns.items():
        if wanted and unit is not None and _fits(unit, each.unit):
            words = _words(place[1], unit)
            is_meant = each.role == "output" and words & _MEANT - wanted
            if not is_meant and all(any(_is_one(w, other) for other in words) for w in wanted):
                found.append(place)
    return found


def _in_unit(each: Asked, columns: Mapping[Place, str | None]) -> list[Place]:
    """Columns whose log says such a unit, however they are called; none for a pure number."""
    if _fits(each.unit, "1"):
        return []
    fit = [p for p, unit in columns.items() if unit is not None and _fits(unit, each.unit)]
    return [p for p in fit if each.role == "input" or not _words(p[1], None) & _MEANT]


def _fits(unit: str, other: str) -> bool:
    """Whether two units are of one quantity; an angle is no pure number, and °C may become K."""
    if unit in SHOWN_ALONE:
        return other in SHOWN_ALONE or other == "K"
    return same_dimension(unit, other) and is_angular(unit) == is_angular(other)


def _words(name: str, unit: str | None) -> frozenset[str]:
    """The words of a name, without the unit at its end."""
    bare = _HUMP.sub("_", _UNIT.sub("", name)).lower()
    words = _WORD.findall(bare)
    by_unit = {"".join(_WORD.findall((unit or "").lower())), *_CELSIUS}
    by_itself = unit_at_end(bare.replace(" ", "_")) is not None
    if len(words) > 1 and (by_itself or words[-1] in by_unit):
        del words[-1]
    return frozenset(words)
