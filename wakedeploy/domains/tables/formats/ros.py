"""Messages of ROS, decoded by rosbags from the definitions that a recording carries.

rosbags writes Python from a definition and runs it. So a type's name has to be one, and constants
are taken out of definitions before they come there: nothing else of a file reaches the program.
"""

import functools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.domains.tables.formats.messages import Decode
from wakedeploy.domains.tables.log import library

_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,99}(/[A-Za-z][A-Za-z0-9_]{0,99}){1,2}")
_FIELD = re.compile(r"[A-Za-z0-9_/<=\[\] \t]+")
_HEAD = re.compile(r"=+|MSG: [A-Za-z0-9_/]+")
_MOST_TEXT = 1 << 18
_MOST_LINES = 2000


def decoder(path: Path, name: str, definition: str, is_cdr: bool) -> Decode:
    """What decodes the messages of a type; UnusableInput for a definition that is none."""
    typesys = library(path, "rosbags.typesys", "rosbags", "rosbag")
    try:
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        known = _plain(definition)
        types = typesys.get_types_from_msg(known, _name(name))
        for type_name in types:
            _name(type_name)
        store.register(types)
    except Exception as error:  # the parser's errors share no base class
        raise UnusableInput(
            f"{path}: the definition of {name[:80]!r} cannot be read ({one_line(error)}); record it"
            " again."
        ) from error
    read: Any = store.deserialize_cdr if is_cdr else store.deserialize_ros1
    return lambda content: read(content, _long(name))


def when_needed(make: Callable[..., Decode], *of: Any) -> Decode:
    """A decoder that is made with the first message: topics that nobody asks for may be odd."""
    made = functools.cache(lambda: make(*of))
    return lambda content: made()(content)


def _name(name: str) -> str:
    if not _TYPE.fullmatch(name):
        raise ValueError(f"{name[:40]!r} is no name of a type")
    return _long(name)


def _long(name: str) -> str:
    """A type's name with the folder that ROS 1 leaves away: pkg/msg/Type."""
    package, *_, last = name.split("/")
    return f"{package}/msg/{last}"


def _plain(definition: str) -> str:
    """A definition without comments, constants and values to begin with."""
    if len(definition) > _MOST_TEXT:
        raise ValueError("it is longer than a definition is")
    lines = [line.partition("#")[0].strip() for line in definition.splitlines()]
    kept = [_field(line) for line in lines if line and not _is_constant(line)]
    if len(kept) > _MOST_LINES:
        raise ValueError("it has more fields than a message has")
    return "\n".join(kept) + "\n"


def _is_constant(line: str) -> bool:
    return re.match(r"\S+\s+\w+\s*=", line) is not None


def _field(line: str) -> str:
    """The type and the name of a field; a heading stays as it is."""
    if _HEAD.fullmatch(line):
        return line
    parts = " ".join(line.split()[:2])
    if not _FIELD.fullmatch(parts):
        raise ValueError(f"{line[:40]!r} is no field")
    return parts
