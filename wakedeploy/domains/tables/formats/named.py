"""Names of what stands in the lists of a message: joints, models, frames.

In: a list of a message, and the messages that it is within, outermost first. Out: the name of an
element, or the place of a name. Senders list what they have in an order of their own, and several
send on one topic: `position[0]` is one joint now and another a message later.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

LISTS = ("name", "names", "joint_names", "interface_names", "interface_groups")
# A list beside names is theirs only if such messages have it: a `gravity` of three numbers is not
# that of three joints, however many there are.
BESIDE = {
    "position", "positions", "velocity", "velocities", "acceleration", "accelerations",
    "effort", "efforts", "torque", "torques", "displacements", "current", "currents",
    "voltage", "voltages", "temperature", "temperatures", "values", "transforms", "pose", "poses",
    "twist", "wrench", "interface_values",
}  # fmt: skip
# Of these the names may stand further out, as beside the `points` of a trajectory.
_WITHIN = {"positions", "velocities", "accelerations", "effort", "transforms"}
_OWN = ("child_frame_id", "name")  # within an element


class Lacking(LookupError):
    """A message does not have an element of that name; `there` are the names that it has."""

    def __init__(self, there: Sequence[str]) -> None:
        super().__init__(*there)
        self.there = tuple(there)


class Names:
    """What the lists of one message call their elements: each list is looked at once."""

    def __init__(self) -> None:
        self._known: dict[int, list[str]] = {}  # by the list

    def at(self, above: Sequence[Any], listed: Any, index: int) -> str:
        """What the element at an index is called, "" where nothing says so.

        Raises IndexError where the list is shorter.
        """
        names = self._of(above, listed)
        return names[index] if names else _own_name(listed[index])

    def index_of(self, above: Sequence[Any], listed: Any, name: str) -> int:
        """Where the element of a name stands; Lacking where the list has none."""
        names = self._of(above, listed) or [_own_name(element) for element in listed]
        if name not in names:
            raise Lacking([n for n in names if n])
        return names.index(name)

    def _of(self, above: Sequence[Any], listed: Any) -> list[str]:
        key = id(listed)
        if key not in self._known:
            self._known[key] = _names(above, listed)
        return self._known[key]


def _names(above: Sequence[Any], listed: Any) -> list[str]:
    """The names of a list's elements, by a list of texts as long; none where there is none.

    The innermost message that has names decides. Its names are of one list on the way, the
    outermost: what is within one joint is no joint.
    """
    way = [*above, listed]
    key = _key(way[-2], listed) if above else ""
    for depth in range(len(above) - 1, -1, -1):
        lists = list(_lists_of_names(way[depth]))
        if not lists:
            continue
        is_beside = depth == len(above) - 1
        if key not in (BESIDE if is_beside else _WITHIN):
            return []
        free = [names for names in lists if is_beside or not _is_of(names, way[depth : depth + 2])]
        return next((names for names in free if len(names) == len(listed)), [])
    return []


def _is_of(names: Sequence[str], way: Sequence[Any]) -> bool:
    """Whether the names of a message are those of the next list on a way, which stands in it."""
    message, part = way
    has_length = isinstance(part, list | tuple | np.ndarray)
    return has_length and len(part) == len(names) and _key(message, part) in BESIDE


def _lists_of_names(message: Any) -> Iterator[list[str]]:
    """The lists of a message that name something; it may have none."""
    for names in _texts(message, LISTS):
        if isinstance(names, list) and names and all(isinstance(n, str) for n in names):
            yield names


def _key(message: Any, part: Any) -> str:
    """What a message calls one of its parts; "" where it is none that has fields."""
    return next((str(key) for key, value in _parts(message).items() if value is part), "")


def _own_name(element: Any) -> str:
    if isinstance(element, int | float | np.number):
        return ""
    return next((t for t in _texts(element, _OWN) if isinstance(t, str) and t), "")


def _texts(message: Any, keys: Sequence[str]) -> Iterator[Any]:
    """The fields of a message that may hold names."""
    fields = _parts(message)
    yield from (fields[key] for key in keys if key in fields)


def _parts(message: Any) -> Mapping[Any, Any]:
    """The fields of a message by their names; none of what has no fields."""
    fields: Mapping[Any, Any] = getattr(message, "__dict__", {})
    return message if isinstance(message, Mapping) else fields
