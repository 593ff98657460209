"""Python's warnings, shown at the line that called into wakedeploy."""

import sys
import warnings
from collections.abc import Callable
from types import FrameType

Warn = Callable[[str], None]  # called with what was noticed and handled, a sentence

_OURS = frozenset({"wakedeploy", "trainers", "runtime", "export"})


def warn_caller(sentence: str, category: type[Warning] = UserWarning) -> None:
    """Warn whoever called, from however deep: the line shown is the first outside these packages.

    In a thread that calls nothing else, the line is the outermost of the thread.
    """
    depth, frame = 2, sys._getframe(1)
    while _is_ours(frame) and frame.f_back is not None:
        depth, frame = depth + 1, frame.f_back
    warnings.warn(sentence, category, stacklevel=depth)


def unsaid(sentence: str) -> None:
    """Warns nobody: for a caller to whom the results say it."""


def _is_ours(frame: FrameType) -> bool:
    return str(frame.f_globals.get("__name__", "")).partition(".")[0] in _OURS
