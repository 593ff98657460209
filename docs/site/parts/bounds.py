"""What a field of a pydantic model takes, in words."""

from typing import Any

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

_SIGNS = {"gt": "above ", "ge": "from ", "lt": "below ", "le": "to "}


def bounds(field: FieldInfo) -> str:
    """The bounds of a number, or of each number of a pair."""
    metadata = [*field.metadata]
    for argument in getattr(field.annotation, "__args__", ()):
        metadata += [*getattr(argument, "__metadata__", ())]
    return " ".join(dict.fromkeys(_words(metadata)))


def _words(metadata: list[Any]) -> list[str]:
    flat = [inner for one in metadata for inner in getattr(one, "metadata", [one])]
    return [
        f"{words}{getattr(one, sign):g}"
        for one in flat
        for sign, words in _SIGNS.items()
        if getattr(one, sign, None) is not None
    ]


def default(field: FieldInfo) -> Any:
    """The default value; None where a file has to state the field."""
    return None if field.default is PydanticUndefined else field.default
