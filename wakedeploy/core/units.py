"""Units: the one that a constant's name ends in, and numbers in others of the same dimension.

In: a unit as people write it ("m/s²", "N s/m", "mps"). Out: what a number in it is multiplied by to
be in another. Factors are exact, so that 450 g is 0.45 kg to the last digit.
"""

import math
import re
from fractions import Fraction
from typing import NamedTuple

_UNIT_OF_NAME = {  # of the last parts of a name
    "m": "m",
    "kg": "kg",
    "s": "s",
    "n": "N",
    "us": "us",
    "mps": "m/s",
    "mps2": "m/s^2",
    "m2ps": "m^2/s",
    "m2": "m^2",
    "per_s": "1/s",
    "us_per_s": "us/s",
    "steps_per_m": "steps/m",
    "n_per_m": "N/m",
    "n_per_ms": "N/(m s)",
    "ns_per_m": "N s/m",
    "n_per_mps": "N s/m",
    "strength": "m/s^2",
    "scale": "1",
    "exponent": "1",
    "fraction": "1",
    "probability": "1",
}
_UNDERSTOOD = {  # what a sentence offers; the other prefixes and products are understood, too
    "m": "m, cm, mm, um, in or ft",
    "kg": "kg, g, mg, lb or oz",
    "s": "s, ms, us, ns, min or h",
    "us": "us, ms or s",
    "N": "N, mN, kN, gf, kgf or lbf",
    "m/s": "m/s, cm/s, mm/s, km/h or mps",
    "m/s^2": "m/s^2, cm/s^2, mm/s^2 or mps2",
    "1/s": "1/s, Hz or 1/min",
    "us/s": "us/s, us/ms or ms/s",
    "1": "1 or %",
    "rad": "rad, mrad or deg",
    "V": "V or mV",
    "A": "A or mA",
    "W": "W, mW or kW",
    "K": "K or mK",
    "N m": "N m, mN m or kgf m",
    "rad/s": "rad/s, deg/s, dps, rpm or rps",
}
_SI = (  # the units that a number is put into where nobody asks for one; every factor is 1
    "1", "m", "kg", "s", "m/s", "m/s^2", "N", "N m", "N/m", "N s/m", "V", "A", "W", "K", "Pa", "T",
    "1/s", "m^2", "m^2/s", "kg m^2", "N s", "V/m", "N/V", "N/A", "N m/A", "ohm", "V s", "A s",
)  # fmt: skip
_SI_ANGLES = ("rad", "rad/s", "rad/s^2", "N m/rad", "N m s/rad", "V s/rad", "m/rad", "rad/m")


_BASES = ("m", "kg", "s", "step", "a", "k")  # metre to kelvin, in the order of a unit's powers


class Quantity(NamedTuple):
    """A unit as a factor to SI units, and its powers in the order of `_BASES`."""

    factor: Fraction
    powers: tuple[int, ...] = (0, 0, 0, 0, 0, 0)

    def __mul__(self, other: "Quantity") -> "Quantity":  # type: ignore[override]
        """The product of two units."""
        powers = tuple(a + b for a, b in zip(self.powers, other.powers, strict=True))
        return Quantity(self.factor * other.factor, powers)

    def raised(self, power: int) -> "Quantity":
        """The unit to a power."""
        return Quantity(self.factor**power, tuple(power * a for a in self.powers))


def _unit(factor: Fraction | int | str, **powers: int) -> Quantity:
    return Quantity(Fraction(factor), tuple(powers.get(base, 0) for base in _BASES))


_G = Fraction("9.80665")  # m/s², of which gram-force and pound-force are made
_POUND = Fraction("0.45359237")
_PREFIXED = {  # as they are, and with one of _PREFIXES before them
    "m": _unit(1, m=1),
    "g": _unit(Fraction(1, 1000), kg=1),
    "s": _unit(1, s=1),
    "N": _unit(1, m=1, kg=1, s=-2),
    "Ns": _unit(1, m=1, kg=1, s=-1),
    "Nm": _unit(1, m=2, kg=1, s=-2),
    "gf": _unit(_G / 1000, m=1, kg=1, s=-2),
    "Hz": _unit(1, s=-1),
    "V": _unit(1, m=2, kg=1, s=-3, a=-1),
    "A": _unit(1, a=1),
    "W": _unit(1, m=2, kg=1, s=-3),
    "J": _unit(1, m=2, kg=1, s=-2),
    "K": _unit(1, k=1),
    "Pa": _unit(1, m=-1, kg=1, s=-2),
    "ohm": _unit(1, m=2, kg=1, s=-3, a=-2),
    "Ohm": _unit(1, m=2, kg=1, s=-3, a=-2),
    "rad": _unit(1),
    "mps": _unit(1, m=1, s=-1),
}
_ALONE = {
    "1": _unit(1),
    "-": _unit(1),
    "": _unit(1),
    "%": _unit(Fraction(1, 100)),
    "deg": _unit(Fraction(math.pi / 180.0)),
    "°": _unit(Fraction(math.pi / 180.0)),
    "rpm": _unit(Fraction(math.pi) / 30, s=-1),
    "bar": _unit(100_000, m=-1, kg=1, s=-2),
    "min": _unit(60, s=1),
    "h": _unit(3600, s=1),
    "in": _unit("0.0254", m=1),
    "ft": _unit("0.3048", m=1),
    "lb": _unit(_POUND, kg=1),
    "oz": _unit(_POUND / 16, kg=1),
    "lbf": _unit(_POUND * _G, m=1, kg=1, s=-2),
    "step": _unit(1, step=1),
    "steps": _unit(1, step=1),
    "mps2": _unit(1, m=1, s=-2),
    "m2ps": _unit(1, m=2, s=-1),
    "kmh": _unit(Fraction(1000, 3600), m=1, s=-1),
    "knots": _unit(Fraction(1852, 3600), m=1, s=-1),
    "kt": _unit(Fraction(1852, 3600), m=1, s=-1),
    "T": _unit(1, kg=1, s=-2, a=-1),  # without kT and its like: fields are small, and kt is knots
    "mT": _unit(Fraction(1, 1000), kg=1, s=-2, a=-1),
    "uT": _unit(Fraction(1, 10**6), kg=1, s=-2, a=-1),
    "nT": _unit(Fraction(1, 10**9), kg=1, s=-2, a=-1),
    "dps": _unit(Fraction(math.pi / 180.0), s=-1),
    "rev": _unit(2 * Fraction(math.pi)),
    "rps": _unit(2 * Fraction(math.pi), s=-1),
    "Nmm": _unit(Fraction(1, 1000), m=2, kg=1, s=-2),
    "l": _unit(Fraction(1, 1000), m=3),
    "L": _unit(Fraction(1, 1000), m=3),
    "ml": _unit(Fraction(1, 10**6), m=3),
    "mL": _unit(Fraction(1, 10**6), m=3),
    "mbar": _unit(100, m=-1, kg=1, s=-2),
    "psi": _unit(_POUND * _G / Fraction("0.0254") ** 2, m=-1, kg=1, s=-2),
    "counts": _unit(1),
}
_SPOKEN = {  # as people write them out
    "%": "pct percent",
    "s": "sec secs second seconds",
    "ms": "msec millisecond milliseconds",
    "us": "usec microsecond microseconds",
    "min": "minute minutes",
    "h": "hr hour hours",
    "m": "meter meters metre metres",
    "rad": "radian radians",
    "deg": "degree degrees",
    "rev": "revolution revolutions turn turns",
    "N": "newton newtons",
    "V": "volt volts",
    "A": "amp amps ampere amperes",
    "W": "watt watts",
    "Pa": "pascal pascals",
    "K": "kelvin",
    "knots": "knot kts",
    "counts": "count tick ticks lsb",
}
_PREFIXES = {
    "M": Fraction(10**6),
    "k": Fraction(1000),
    "d": Fraction(1, 10),
    "c": Fraction(1, 100),
    "m": Fraction(1, 1000),
    "u": Fraction(1, 10**6),
    "n": Fraction(1, 10**9),
}
_SYMBOLS = {
    prefix + name: Quantity(size * quantity.factor, quantity.powers)
    for prefix, size in _PREFIXES.items()
    for name, quantity in _PREFIXED.items()
}
_SYMBOLS |= _PREFIXED | _ALONE  # "min" is no milli-inch, and "ft" no femto-anything
_SYMBOLS |= {word: _SYMBOLS[unit] for unit, words in _SPOKEN.items() for word in words.split()}
_WORDS = (  # which mean nothing else in other cases, as those of _SPOKEN
    "h", "in", "ft", "lb", "oz", "lbf", "l", "min", "deg", "rev", "rpm", "rps", "dps", "mps",
    "mps2", "kmh", "knots", "step", "steps", "Nmm", "ohm", "kohm", "rad", "bar", "mbar", "psi",
    "counts",
)  # fmt: skip
_IN_ANY_CASE = {name.lower(): name for name in [*_WORDS, *" ".join(_SPOKEN.values()).split()]}
# Symbols that people also write small, in capitals, or with the first letter a capital. Others are
# taken as they are: a small t is no tesla, kv no kilovolt, and mpa may be MPa.
_OFTEN_RECASED = (
    "m", "cm", "dm", "km", "um", "nm", "g", "kg", "s", "us", "ns", "N", "Ns", "Nm", "kNm", "gf",
    "kgf", "Hz", "kHz", "V", "uV", "A", "uA", "W", "kW", "J", "kJ", "Pa", "kPa", "uT", "kt",
)  # fmt: skip
_ONLY_SMALL = ("mV", "mA", "mN", "mNm", "mW")  # with a capital M they are a billion times as much
_ELECTRICAL = {  # where nothing stands beside them: M/H is no metre per henry
    prefix + name: Quantity(size * quantity.factor, quantity.powers)
    for prefix, size in [("", Fraction(1)), *_PREFIXES.items()]
    for name, quantity in {
        "H": _unit(1, m=2, kg=1, s=-2, a=-2),
        "F": _unit(1, m=-2, kg=-1, s=4, a=2),
        "S": _unit(1, m=-2, kg=-1, s=3, a=2),
    }.items()
}
_OTHERS = {"M"}  # alone it is no metre; M/S is one a second
_ANGULAR = re.compile(
    r"(?<![A-Za-z])(m?rad(ian)?s?|deg(ree)?s?|rev(olution)?s?|turns?|rpm|rps|dps)(?![A-Za-z])|°",
    re.I,
)
SHOWN_ALONE = ("°C", "degC")  # one unit, from which no factor leads to any other, as to kelvin
_BROKEN_POWER = re.compile(r"\^\(?-?[0-9]*[./][0-9]+\)?")
_SUPERSCRIPTS = str.maketrans("⁻¹²³⁴", "-1234")
_PART = re.compile(
    r"\s*(?P<sign>[/*·⋅]?)\s*"
    r"(?:\((?P<group>[^()]*)\)|(?P<name>[A-Za-zµμ%°\u2126\u03a9]+|1(?![0-9])|-))(?:\^?(?P<power>-?[0-9]))?"
)


def _recased() -> dict[str, str]:
    """The spellings in other cases that mean one symbol, and the symbol."""
    found = [(name.lower(), name) for name in _ONLY_SMALL] + [("MM", "mm")]
    for name in _OFTEN_RECASED:
        found += [(name.lower(), name), (name.upper(), name)]
        found += [(name.capitalize(), name), (name[0].upper() + name[1:], name)]
    meant: dict[str, set[str]] = {}
    for spelling, name in found:
        meant.setdefault(spelling, set()).add(name)
    del meant["G"]  # gauss, or times gravity
    return {spelling: min(names) for spelling, names in meant.items() if len(names) == 1}


_RECASED = _recased()


def unit_of(name: str) -> str | None:
    """The unit a constant's name ends in (`mass_kg` → "kg"), or None if it carries none."""
    parts = name.split("_")
    # From the whole name on, and to "per": neither steps_per_m nor force_per_m is in metres.
    for start in range(_last_per(parts) + 1 or len(parts)):
        unit = _UNIT_OF_NAME.get("_".join(parts[start:]))
        if unit:
            return unit
    return None


def _last_per(words: list[str]) -> int:
    """Where the last "per" stands among a name's words; -1 without one."""
    return max((i for i, word in enumerate(words) if word == "per"), default=-1)


_ENDS = {  # of any name, after a word: what a unit's end stands for
    "m": "m", "kg": "kg", "s": "s", "n": "N", "v": "V", "w": "W", "ohm": "ohm", "rad": "rad",
    "deg": "deg", "rpm": "rpm", "hz": "Hz", "nm": "N m", "pa": "Pa", "kgm2": "kg m²", "m2": "m²",
    "mps": "m/s", "mps2": "m/s²", "radps": "rad/s", "radps2": "rad/s²", "mm": "mm", "mv": "mV",
    "dps": "deg/s", "ma": "mA", "us": "us", "ms": "ms", "um": "um", "pct": "%", "percent": "%",
    "bar": "bar", "mbar": "mbar", "kpa": "kPa", "psi": "psi", "cm": "cm",
}  # fmt: skip
# Alone, `arm_a` is no current.
_ENDS_ABOVE = _ENDS | {"a": "A", "j": "J", "k": "K", "l": "l", "m3": "m³", "s2": "s²"}
_ENDS_BELOW = _ENDS | {"a": "A", "k": "K", "ms": "m s", "s2": "s²", "min": "min", "m3": "m³"}
# In several words above "per". Others may be a quotient, as m_s, or an axis and a unit, as k_n.
_PRODUCTS = {
    "kg m2": "kg m²", "n m": "N m", "n s": "N s", "n s2": "N s²", "n m s": "N m s",
    "nm s": "N m s", "v s": "V s", "w s": "W s", "pa s": "Pa s",
}  # fmt: skip
_WORD_LETTERS = 3  # of a unit that is written out, as in `steps_per_m`; fewer may be a name's
_NO_UNITS = {"min"}  # above "per": the least of something

_ENDS_BESIDE = {  # that are a unit only beside one of its dimension: `motor_kt` is a constant
    "km": ["km"], "kmh": ["kmh"], "kn": ["kN", "knots"], "kt": ["knots"], "kts": ["knots"],
    "knots": ["knots"],
    "mn": ["mN"], "un": ["uN"], "mnm": ["mN m"], "nmm": ["Nmm"], "ncm": ["N cm"], "g": ["g"],
    "mmps": ["mm/s"], "cmps": ["cm/s"], "ua": ["uA"], "mw": ["mW"], "kw": ["kW"], "khz": ["kHz"],
}  # fmt: skip
_CASED = {"MN": ["MN"], "MW": ["MW"]}  # ends that mean another unit in small letters
_OFTEN_WORDS = {"mn", "un", "g", "ua", "mw"}  # ends that may be a word's, as of a mean: they doubt
_IN_PARTS = {  # ends as they come from a header's brackets: `v [km/h]` becomes v_km_h
    "_km_h": "_kmh", "_m_s": "_mps", "_mm_s": "_mmps", "_cm_s": "_cmps", "_m_s2": "_mps2",
    "_m_s_2": "_mps2", "_rad_s": "_radps", "_rad_s2": "_radps2", "_deg_s": "_dps",
    "_kg_m2": "_kgm2", "_n_m": "_nm", "_mn_m": "_mnm", "_n_mm": "_nmm", "_n_cm": "_ncm",
    "_n_m_s": "_nms",
}  # fmt: skip
# That are a unit beside any other. Not `servo_deg`, whose pulse is in µs, or `load_kg` in newtons.
_PLAIN_ENDS = {"mps", "mps2", "radps", "radps2", "kgm2", "rpm", "kmh", "knots", "kts"}


def unit_at_end(name: str) -> str | None:
    """The unit that any name ends in, or None: `resistance_ohm` → "ohm", `push_n_per_v` → "N/V".

    All that stands below "per" counts, as in `heat_j_per_kg_k`, and above it a unit, which may be a
    product: `kd_nm_s_per_rad` → "N m s/rad". Of a `torque_per_a` nobody knows what is divided. What
    the rig's constants end in is `unit_of`'s.
    """
    name = name.replace("_kg_m2", "_kgm2")
    *words, end = name.split("_")
    at = _last_per(words)
    if at < 0:
        return _ENDS.get(end) if words else None
    below = [_ENDS_BELOW.get(word) for word in (*words[at + 1 :], end)]
    if at == 0 or None in below:
        return None
    above = _above_per(words[:at])
    if above is None and below == ["s²"] and not _is_unit_word(words[at - 1]):
        above = "1"  # as 1/s of the rig's constants: a stiffness by the mass that it moves
    if above is None:
        return None
    per = " ".join(map(str, below))
    return f"{above}/({per})" if set(per) & set(" /") else f"{above}/{per}"


def _above_per(words: list[str]) -> str | None:
    """The unit in the words of a name above "per"; None where there is none, or one in doubt."""
    begin = len(words)
    while begin > 0 and _is_unit_word(words[begin - 1]):
        begin -= 1
    units = words[begin:]
    if len(units) != 1:
        return _PRODUCTS.get(" ".join(units)) if begin > 0 else None
    if units[0] in _ENDS_ABOVE and begin > 0:
        return _ENDS_ABOVE[units[0]]
    return units[0] if len(units[0]) >= _WORD_LETTERS else None


def _is_unit_word(word: str) -> bool:
    """Whether a word above "per" is a unit: a usual end, or one that is written out."""
    is_written_out = len(word) >= _WORD_LETTERS and word not in _NO_UNITS and is_known(word)
    return word in _ENDS_ABOVE or is_written_out


def is_known(text: str) -> bool:
    """Whether a unit is understood; "" and "1" are none, and known.

    One with a broken power, as m^0.5/s of an outflow, is: there is no factor from or to it.
    """
    return _read(_BROKEN_POWER.sub("", text)) is not None


def contradicted(name: str, unit: str, *, surely: bool = False) -> str | None:
    """The unit that a name ends in, where it is another one than `unit`; else None.

    Of another dimension only an end counts that means nothing else: `x_s` may be of the slave, and
    `vx_mps` is a speed. Where the unit is "1" nobody has said one. `surely` leaves out ends that
    are often a word's: `force_mn` may be a mean.
    """
    whole, name = name, _in_one(name)
    end, named = _end_of(name), _named(name)
    if surely and end in _OFTEN_WORDS:
        return None
    alike = [each for each in named if same_dimension(each, unit)]
    if alike:
        return None if any(same_unit(each, unit) for each in alike) else alike[0]
    is_whole = "_per_" not in name.lower()  # the end of push_n_per_mps is not all of its unit
    is_whole &= name == whole  # x_m_s may be a place of the slave
    is_plain = end in _PLAIN_ENDS and is_known(unit) and not same_dimension(unit, "1") and is_whole
    return named[0] if named and is_plain else None


def is_named(name: str, unit: str) -> bool:
    """Whether a name ends in a unit, as `depth_cm` does in cm."""
    named = _named(_in_one(name))
    return any(same_unit(each, unit) for each in named if same_dimension(each, unit))


def _in_one(name: str) -> str:
    """A name whose end has no _ within its unit."""
    ends = sorted((end for end in _IN_PARTS if name.lower().endswith(end)), key=len)
    return f"{name[: -len(ends[-1])]}{_IN_PARTS[ends[-1]]}" if ends else name


def _end_of(name: str) -> str:
    return name.lower().rpartition("_")[2] if "_" in name else ""


def _named(name: str) -> list[str]:
    """The units that the end of a name may mean."""
    if (cased := _CASED.get(name.rpartition("_")[2])) is not None:
        return cased
    by_name = unit_at_end(name.lower())
    return [by_name] if by_name is not None else _ENDS_BESIDE.get(_end_of(name), [])


def same_dimension(first: str, other: str) -> bool:
    """Whether a number in one unit can be put into the other; angles are numbers."""
    try:
        return conversion(first, other) > 0
    except ValueError:
        return False


def same_unit(first: str, other: str) -> bool:
    """Whether two spellings mean one unit: "m/s²" and "m/s^2"."""
    try:
        return first == other or conversion(first, other) == 1
    except ValueError:
        return False


def conversion(given: str, wanted: str) -> Fraction:
    """What a number in the unit `given` is multiplied by to be in `wanted`.

    Raises ValueError with a clause that says what is understood.
    """
    if (given == wanted and is_known(given)) or (given in SHOWN_ALONE and wanted in SHOWN_ALONE):
        return Fraction(1)
    if wanted in SHOWN_ALONE and _read(given) is not None:
        raise ValueError(f'{given!r} has no factor to {wanted}; give unit = "{wanted}", no offset')
    source, target = _read(given), _read(wanted)
    understood = _UNDERSTOOD.get(wanted, f"{wanted}, or the same with other prefixes")
    if source is None or target is None:
        raise ValueError(f"{given!r} is not known{_meant(given) or f'; give {understood}'}")
    if source.powers != target.powers:
        raise ValueError(f"{given!r} is of another dimension; give {understood}")
    return source.factor / target.factor


def _meant(text: str) -> str:
    """What a unit may mean that is known in other cases only, or as another word; "" for none."""
    if text in SHOWN_ALONE:
        return '; give unit = "K" and offset = 273.15'
    folded = text.strip().lower()
    names = [name for name in _SYMBOLS if name.lower() == folded]
    names += ["knots"] if folded == "kn" else []
    if not names:
        return _meant_in_parts(text)
    return f": {' or '.join(sorted(names))} may be meant; give {'which' if names[1:] else 'that'}"


def _meant_in_parts(text: str) -> str:
    """The same of a compound: N m/A for NM/A, if each part that is not known means one unit."""
    parts = re.split(r"([^A-Za-zµμ°]+)", text.strip())
    for i, part in enumerate(parts):
        if part.isalpha() and _read(part) is None:
            names = [name for name in _SYMBOLS if name.lower() == part.lower()]
            if len(names) != 1:
                return ""
            parts[i] = names[0]
    joined = "".join(parts)
    known = joined != text.strip() and _read(joined) is not None
    return f": {joined} may be meant; give that" if known else ""


def si_unit(text: str) -> str:
    """The SI unit of the same dimension: "deg/s" gives "rad/s", "gf" gives "N".

    Raises ValueError with a clause where the unit is not known.
    """
    quantity = _read(text)
    if quantity is None:
        advice = _meant(text) or "; give one such as m, rad, N m, V, A or m/s^2"
        raise ValueError(f"{text!r} is not known{advice}")
    names = [*_SI_ANGLES, *_SI] if is_angular(text) else [*_SI, *_SI_ANGLES]
    same = (name for name in names if _read(name) == Quantity(Fraction(1), quantity.powers))
    return next(same, _composed(quantity))


def is_angular(text: str) -> bool:
    """Whether a unit counts angle: rad/s is another thing than Hz, though both are 1/s."""
    return _ANGULAR.search(text) is not None


def _composed(quantity: Quantity) -> str:
    """A unit of its base units: "kg m^2 s^-4"."""
    bases = ("m", "kg", "s", "step", "A", "K")
    powers = [(b, p) for b, p in zip(bases, quantity.powers, strict=True) if p]
    return " ".join(base if power == 1 else f"{base}^{power}" for base, power in powers)


def converted(value: float, factor: Fraction) -> float:
    """A number times an exact factor, rounded once: 450 times 1/1000 is 0.45. Infinite beyond."""
    try:
        return float(Fraction(repr(value)) * factor) if math.isfinite(value) else value
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _read(text: str) -> Quantity | None:
    """A unit's text as a quantity; None where it is not understood."""
    plain = re.sub("[⁻¹²³⁴]+", lambda power: f"^{power[0].translate(_SUPERSCRIPTS)}", text)
    plain = plain.replace("**", "^").replace(" per ", "/").strip()
    if plain.replace("µ", "u") in _OTHERS:
        return None
    if plain.replace("µ", "u") in _ELECTRICAL:
        return _ELECTRICAL[plain.replace("µ", "u")]
    whole, at = _ALONE.get(plain, _unit(1)), 0
    while plain not in _ALONE and at < len(plain):
        part = _PART.match(plain, at)
        read = None if part is None else _part(part)
        if part is None or read is None:
            return None
        whole, at = whole * (read.raised(-1) if part["sign"] == "/" else read), part.end()
    return whole


def _part(part: "re.Match[str]") -> Quantity | None:
    if part["group"] is not None:
        group = _read(part["group"])
        return None if group is None else group.raised(int(part["power"] or 1))
    name = part["name"].replace("µ", "u").replace("μ", "u")
    name = name.replace("\u2126", "ohm").replace("\u03a9", "ohm")  # the ohm's own sign, and omega
    read = _symbol(name + (part["power"] or ""))  # mps2 is no square of mps
    if read is not None:
        return read
    read = _symbol(name)
    return read.raised(int(part["power"] or 1)) if read is not None else None


def _symbol(name: str) -> Quantity | None:
    """A symbol or a word as a quantity, also where its case is another that nothing else has."""
    recased = _RECASED.get(name) or _IN_ANY_CASE.get(name.lower(), "?")
    return _SYMBOLS.get(name) or _SYMBOLS.get(recased)
