"""Four columns of a log that are a quaternion, by their names and their lengths.

In: the columns of a log with their numbers. Out: what each is called and where its parts are.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from wakedeploy.domains.tables.log import Values
from wakedeploy.domains.tables.orientation import is_orientation
from wakedeploy.domains.tables.stamps import as_floats

_BY_LETTER = re.compile(r"(.*)([xyzw])", re.I | re.S)
_BY_NUMBER = re.compile(r"(.*(?:quat|orient|rot|att|\bq).*\[)([0-3])\]", re.I | re.S)
_W_FIRST = "  # ? x, y, z, w: taken as if w stood first, as in PX4 and MuJoCo"


@dataclass(frozen=True)
class Quaternion:
    """What it is called, the addresses of x, y, z and w, and a remark on their order."""

    stem: str
    addresses: tuple[str, ...]
    remark: str


def quaternions_in(values: Mapping[str, Values]) -> Iterator[Quaternion]:
    """The quaternions in a log, in the order of their columns."""
    for form, letters, remark in ((_BY_LETTER, "xyzw", ""), (_BY_NUMBER, "1230", _W_FIRST)):
        for stem, found in _groups(form, values).items():
            addresses = tuple(found.get(letter, "") for letter in letters)
            if len(found) == 4 and is_orientation([as_floats(values[a]) for a in addresses]):
                yield Quaternion(stem.rstrip("._/[ "), addresses, remark)


def _groups(form: re.Pattern[str], values: Mapping[str, Values]) -> dict[str, dict[str, str]]:
    """Columns of numbers whose names differ in one letter only, by that letter."""
    found: dict[str, dict[str, str]] = {}
    for name, numbers in values.items():
        match = form.fullmatch(name)
        if match and numbers.dtype.kind in "fiu" and np.size(numbers):
            found.setdefault(match[1], {})[match[2].lower()] = name
    return found
