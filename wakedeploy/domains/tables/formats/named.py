"""Names of what stands in the lists of a message: joints, models, frames.

In: a list of a message, and the messages that it is within, outermost first. Out: the name of an
element, or the place of a name. Senders list what they have in an order of their own, and several
send on one topic: `position[0]` is one joint now and another a message later.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

_LISTS = ("name", "names", "joint_names")  # beside a list of numbers, or of messages
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
    """The names of a list's elements, by a list of texts as long; none where there is none."""
    for message in reversed(above):
        for names in _texts(message, _LISTS):
            is_of_it = isinstance(names, list) and names is not listed
            if is_of_it and len(names) == len(listed) and all(isinstance(n, str) for n in names):
                return list(names)
    return []


def _own_name(element: Any) -> str:
    if isinstance(element, int | float | np.number):
        return ""
    return next((t for t in _texts(element, _OWN) if isinstance(t, str) and t), "")


def _texts(message: Any, keys: Sequence[str]) -> Iterator[Any]:
    """The fields of a message that may hold names."""
    fields = message if isinstance(message, Mapping) else getattr(message, "__dict__", {})
    yield from (fields[key] for key in keys if key in fields)
