"""Lists in the cells of a table of text, and whose numbers they are by a list of names beside.

In: cells as texts, and the names of a header. Out: numbers as texts, names, and where they stand.
Exports of ROS have such tables: `name` with the joints, `position` with a number of each.
"""

import re
from collections.abc import Sequence

from wakedeploy.domains.tables.formats.named import BESIDE, LISTS

_OF_PYTHON = re.compile(r"array\((?:'\w',)?\s*(?P<list>[\[(].*[\])])\s*(?:,.*)?\)", re.DOTALL)
_QUOTED = re.compile(r"""'([^']*)'|"([^"]*)\"""")
_NAMED = re.compile(r"(?P<column>.+)\[(?P<name>[^\[\]]+)\]")


def list_in(text: str) -> str | None:
    """The list that a cell holds: "[1, 2]", "(1, 2)" or "array('d', [1, 2])"; None for none."""
    plain = text.strip()
    if plain.startswith("array(") and (match := _OF_PYTHON.fullmatch(plain)) is not None:
        plain = match["list"]
    is_list = plain.startswith("[") or (plain.startswith("(") and "," in plain)
    return plain if is_list else None


def numbers_in(text: str) -> list[str]:
    """The numbers of a vector in a cell: of a list, or of "(1 2)" or "1;2"."""
    inner = (list_in(text) or text.strip()).strip("[](), \t\r\n")
    return re.split(r"[\s,;]+", inner) if inner else []


def texts_in(text: str) -> list[str]:
    """The texts of a list in a cell: "['hip', 'knee']"."""
    return [single or double for single, double in _QUOTED.findall(list_in(text) or "")]


def names_beside(column: str, columns: Sequence[str]) -> str | None:
    """The column with the names of what a column has a list of numbers of; None where none is.

    Both stand in one message: `/joint_states.name` beside `/joint_states.position`.
    """
    stem, key = _parted(column)
    if key not in BESIDE:
        return None
    alike = (other for other in columns if _parted(other)[0] == stem)
    return next((other for other in alike if _parted(other)[1] in LISTS), None)


def by_name(address: str) -> tuple[str, str] | None:
    """The column of an address, and the name of an element: "position[knee]"; None for another."""
    match = _NAMED.fullmatch(address)
    return None if match is None or match["name"].isdigit() else (match["column"], match["name"])


def _parted(column: str) -> tuple[str, str]:
    """What a column's message is called, and which of its fields it is."""
    match = re.fullmatch(r"(.*[./])?([^./]*)", column, re.DOTALL)
    return (match[1] or "", match[2].lower()) if match else ("", column)
