"""Sizes in the words in which people think, where arithmetic needs their inverse.

A limit to a rate is a `slowness` to the search, so that 0 is no limit; people think of the rate.
In: a parameter and its size. Out: what it is called, and the size as it is printed.
"""

from collections.abc import Sequence

from wakedeploy.gap.search.artefacts import Size
from wakedeploy.gap.systems.kinds.library import kinds_of


def as_read(effect: str, parameter: str, size: Size) -> tuple[str, Size]:
    """A parameter of an effect as people have it; one that may be 0 has no inverse, and stays."""
    name = _inverse(effect, parameter)
    if not name or not 0.0 < size.low <= size.value <= size.high:
        return parameter, size
    value, low, high = 1.0 / size.value, 1.0 / size.high, 1.0 / size.low
    return name, Size(value=value, low=low, high=high, unit=inverse_unit(size.unit))


def sizes_as_read(
    effect: str, parameter: str, unit: str, sizes: Sequence[float]
) -> tuple[str, str, list[float]]:
    """Name, unit and sizes as people have them, of sizes that stand alone."""
    name = _inverse(effect, parameter)
    if not name:
        return parameter, unit, list(sizes)
    return name, inverse_unit(unit), [1.0 / each if each else float("inf") for each in sizes]


def inverse_unit(unit: str) -> str:
    """The unit of an inverse: rad/s of s/rad, 1/s of s."""
    top, _, below = unit.partition("/")
    return f"{below.removeprefix('(').removesuffix(')') or '1'}/{top}"


def _inverse(effect: str, parameter: str) -> str:
    """What the inverse of an effect's parameter is called; "" where nobody thinks of it."""
    parameters = (p for kind in kinds_of(effect) for p in kind.parameters)
    return next((p.inverse for p in parameters if p.name == parameter), "")
