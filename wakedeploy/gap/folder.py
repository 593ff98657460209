"""A folder that steps work in: one of them at a time."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from wakedeploy.core.files import remove_unfinished
from wakedeploy.core.locks import alone


@contextlib.contextmanager
def at_work(folder: Path) -> Iterator[None]:
    """Nobody else takes steps in this folder meanwhile; what a killed one was writing is removed.

    UnusableInput where somebody does: artefacts of two would be of different flights.
    """
    with alone(folder, "Another gap command", "gap"):
        for place in (folder, folder / "figures"):
            remove_unfinished(place)
        yield
