"""Telling a rejected document's first problem in one clause: the place, the value, the bound."""

from typing import Any, get_args

import pydantic

_LONGEST = 100  # letters of a place or a value that a document may put into a sentence
_PLAIN = {
    "a valid integer": "a whole number",
    "a valid number": "a number",
    "a valid string": "text",
    "a valid boolean": "true or false",
    "a valid list": "a list",
    "a valid tuple": "a list",
    "a valid dictionary": "a table",
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
    "greater than": "above",
    "less than": "below",
}


def first_problem(
    error: pydantic.ValidationError, document: type[pydantic.BaseModel] | None = None
) -> str:
    """The first problem of a document that pydantic rejected, as "a.b.0.c = 3: what is wrong".

    With the kind of the document, a name that is not known is answered with those that are.
    """
    problem = error.errors()[0]
    place = _shown(".".join(str(part) for part in problem["loc"]))
    if problem["type"] == "extra_forbidden":
        known = _known_beside(document, problem["loc"]) if document else []
        return f"{place} is not known" + (f"; there are {', '.join(known)}" if known else "")
    if problem["type"] == "missing":
        beside = (e for e in error.errors() if e["type"] == "extra_forbidden")
        near = [e["loc"][-1] for e in beside if e["loc"][:-1] == problem["loc"][:-1]]
        return f"{place} is missing" + (
            f", and {_shown(str(near[0]))} is not known" if near else ""
        )
    given = problem["input"]
    shown = f" = {_shown(repr(given))}" if isinstance(given, int | float | str) and place else ""
    return f"{place}{shown}: {_shown(_in_plain_words(problem['msg']))}".lstrip(": ")


def _in_plain_words(message: str) -> str:
    """What pydantic says of a value, without its words for kinds."""
    own = message.removeprefix("Value error, ")
    wanted = own.removeprefix("Input should be ")
    if wanted == own:
        return own
    for words, plain in _PLAIN.items():
        wanted = wanted.replace(words, plain)
    return f"it has to be {wanted}"


def _known_beside(document: type[pydantic.BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    """The names that a document may have where it has another; none where it is no table."""
    kind: Any = document
    for part in loc[:-1]:
        if isinstance(part, str):  # an entry of a list is of the list's own kind
            field = kind.model_fields.get(part)
            kind = None if field is None else _table_in(field.annotation)
        if kind is None:
            return []
    return [field.alias or name for name, field in kind.model_fields.items() if not field.exclude]


def _table_in(annotation: Any) -> type[pydantic.BaseModel] | None:
    """The kind of table that a field holds, alone or in a list."""
    for kind in (annotation, *get_args(annotation)):
        if isinstance(kind, type) and issubclass(kind, pydantic.BaseModel):
            return kind
    return None


def _shown(text: str) -> str:
    """A document's text as it may stand in a sentence: on one line, and not for ever."""
    plain = text if text.isprintable() else repr(text)[1:-1]
    return plain if len(plain) <= _LONGEST else f"{plain[: _LONGEST - 1]}…"
