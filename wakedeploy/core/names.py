"""Names that people choose: architectures, domains; how they may be spelled, and what was meant.

In: what somebody typed. Out: the name as the project spells it. Loads nothing heavy, for the
command line completes these names at each press of Tab.
"""

import difflib
from collections.abc import Iterable

from wakedeploy.core.discovery import ARCHITECTURE, DOMAIN, offers

ALL = "all"


def architectures() -> tuple[str, ...]:
    """The names of all architectures, the paper's first, in the order of its Table I."""
    return tuple(offers(ARCHITECTURE))


def domains() -> tuple[str, ...]:
    """The names of all domains."""
    return tuple(offers(DOMAIN))


def one_of(names: Iterable[str]) -> str:
    """Names as a sentence has them: a, b or c."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last


def meant(given: str, names: Iterable[str]) -> str | None:
    """The one of `names` that is meant, in whatever case, hyphens or underscores; None for none."""
    folded = {_folded(name): name for name in names}
    return folded.get(_folded(given))


def near(given: str, names: Iterable[str]) -> list[str]:
    """Up to three of `names` that begin like what was given, or are spelled much like it."""
    folded = {_folded(name): name for name in names}
    asked = _folded(given)
    begun = [name for name in folded if len(asked) > 1 and name.startswith(asked)]
    close = difflib.get_close_matches(asked, folded)
    return [folded[name] for name in dict.fromkeys([*begun, *close])][:3]


def unknown(given: str, what: str, names: Iterable[str]) -> str:
    """A clause on a name that is none of these: what it is not, what is near, what there is."""
    names = list(names)
    close = near(given, names)
    hint = f"did you mean {' or '.join(close)}? Choose" if close else "choose"
    return f"'{given}' is no {what}; {hint} {', '.join(names)}"


def _folded(name: object) -> str:
    return str(name).strip().lower().replace("_", "-").replace(" ", "-")
