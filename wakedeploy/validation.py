"""Telling a rejected document's first problem in one clause: the place, the value, the bound."""

import pydantic


def first_problem(error: pydantic.ValidationError) -> str:
    """The first problem of a document that pydantic rejected, as "a.b.0.c = 3: what is wrong"."""
    problem = error.errors()[0]
    place = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        return f"{place} is not known"
    if problem["type"] == "missing":
        return f"{place} is missing"
    given = problem["input"]
    shown = f" = {given!r}" if isinstance(given, int | float | str) and place else ""
    message = problem["msg"].removeprefix("Value error, ")
    return f"{place}{shown}: {message}".lstrip(": ")
