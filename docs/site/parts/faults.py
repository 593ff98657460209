"""The faults that end a flight, as the program itself explains them."""

from parts.markdown import plain, table
from wakedeploy.core.failsafes import HINTS


def markdown() -> str:
    """A row for each fault: its name in the log, what happened, what to do."""
    rows = ([f"`{name}`", *_halves(hint)] for name, hint in HINTS.items())
    return table(["Name", "What happened", "What to do"], rows)


def _halves(hint: str) -> list[str]:
    happened, _, advice = hint.partition(": ")
    return [plain(happened), plain(advice) or "–"]
