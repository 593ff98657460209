"""Units: the one that a constant's name ends in, and whether two spellings mean the same."""

import re

_UNIT_OF_SUFFIX = {
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
}


def unit_of(name: str) -> str | None:
    """The unit a constant's name ends in (`mass_kg` → "kg"), or None if it carries none."""
    parts = name.split("_")
    for start in range(len(parts)):  # from the whole name on: steps_per_m is not in metres
        unit = _UNIT_OF_SUFFIX.get("_".join(parts[start:]))
        if unit:
            return unit
    return None


def same_unit(one: str, other: str) -> bool:
    """Whether two spellings mean one unit: "m/s²" and "m/s^2"."""
    return _folded(one) == _folded(other)


def _folded(unit: str) -> str:
    """A unit with the usual spellings folded together."""
    plain = unit.replace("²", "^2").replace("µ", "u").replace("·", " ").replace("**", "^")
    return re.sub(r"\s+", "", plain).lower()
