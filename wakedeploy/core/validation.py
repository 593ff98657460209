"""Telling a rejected document's first problem in one clause: the place, the value, the bound."""

import pydantic

_LONGEST = 100  # letters of a place or a value that a document may put into a sentence


def first_problem(error: pydantic.ValidationError) -> str:
    """The first problem of a document that pydantic rejected, as "a.b.0.c = 3: what is wrong"."""
    problem = error.errors()[0]
    place = _shown(".".join(str(part) for part in problem["loc"]))
    if problem["type"] == "extra_forbidden":
        return f"{place} is not known"
    if problem["type"] == "missing":
        beside = (e for e in error.errors() if e["type"] == "extra_forbidden")
        near = [e["loc"][-1] for e in beside if e["loc"][:-1] == problem["loc"][:-1]]
        return f"{place} is missing" + (
            f", and {_shown(str(near[0]))} is not known" if near else ""
        )
    given = problem["input"]
    shown = f" = {_shown(repr(given))}" if isinstance(given, int | float | str) and place else ""
    message = _shown(problem["msg"].removeprefix("Value error, "))
    return f"{place}{shown}: {message}".lstrip(": ")


def _shown(text: str) -> str:
    """A document's text as it may stand in a sentence: on one line, and not for ever."""
    plain = text if text.isprintable() else repr(text)[1:-1]
    return plain if len(plain) <= _LONGEST else f"{plain[: _LONGEST - 1]}…"
