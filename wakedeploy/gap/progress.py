"""How the workflow reports what it is doing: a stage in words, and how far it is."""

from collections.abc import Callable
from typing import Protocol

StepsDone = Callable[[int, int], None]  # called with the steps done and how many there are


class Progress(Protocol):
    """Called with a stage's words when it begins, and again with the steps done and their number.

    Both are 0 if a stage does not know them.
    """

    def __call__(self, stage: str, done: int = 0, total: int = 0, /) -> None:
        """Tell."""


def quiet(stage: str, done: int = 0, total: int = 0, /) -> None:
    """Tells nobody."""


def uncounted(done: int, total: int) -> None:
    """Tells nobody, either."""
