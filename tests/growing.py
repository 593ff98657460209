"""A log that a run in another process is still writing."""

from pathlib import Path

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.runlog import RunLog, read_run_log


def written_so_far(log: Path | str) -> RunLog | None:
    """What can be read of it by now; None before its first bytes are on the disk."""
    try:
        return read_run_log(log)
    except UnusableInput:
        return None
