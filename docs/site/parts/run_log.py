"""The columns of a run log."""

from parts.markdown import table
from wakedeploy.core.runlog_columns import COLUMNS
from wakedeploy.core.runlog_meanings import MEANINGS

_PRESENCE = {"required": "always", "usual": "usual", "extra": "where recorded"}


def markdown() -> str:
    """A row for each column, in the order of a file."""
    rows = (
        [f"`{one.name}`", one.unit or "–", _PRESENCE[one.presence], MEANINGS[one.name]]
        for one in COLUMNS
    )
    return table(["Column", "Unit", "There", "What"], rows)
