"""The columns of a run log."""

from parts.markdown import table
from wakedeploy.core.runlog_columns import COLUMNS, TOPICS
from wakedeploy.core.runlog_meanings import MEANINGS

_PRESENCE = {"required": "always", "usual": "usual", "extra": "where recorded"}
_TOPIC = {name: topic for topic, names in TOPICS.items() for name in names}


def markdown() -> str:
    """A row for each column, in the order of a file."""
    rows = (
        [
            f"`{one.name}`",
            f"`{_TOPIC[one.name]}`",
            one.unit or "–",
            _PRESENCE[one.presence],
            MEANINGS[one.name],
        ]
        for one in COLUMNS
    )
    return table(["Column", "Topic", "Unit", "There", "What"], rows)
