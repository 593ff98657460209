"""The two kinds of failure a user meets: input that cannot be used, and a check that failed."""

import contextlib
import errno
import functools
import sys
from collections.abc import Callable, Iterator
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_DENIED = (errno.EACCES, errno.EPERM, errno.EROFS)
_UNUSABLE = (
    FileNotFoundError,
    FileExistsError,
    NotADirectoryError,
    IsADirectoryError,
    PermissionError,
)
_CALLERS = "_wakedeploy_callers"  # an attribute of an error that a function of a caller's raised
_HEAD, _TAIL = 600, 250  # letters of a sentence that is too long: where, and what to do


class WakedeployError(Exception):
    """An error that the user reads as one sentence: what is wrong, where, what to do.

    Whatever a file has put into it, it is one line that a terminal can show, and not a long one.
    """

    exit_status = 1

    def __init__(self, sentence: str) -> None:
        super().__init__(shown(sentence))


class UnusableInput(WakedeployError):
    """A file, an argument or a device that cannot be used as it is (exit status 2)."""

    exit_status = 2


class CheckFailed(WakedeployError):
    """A run or a check that was carried out and did not pass (exit status 1)."""


class OutOfRange(UserWarning):
    """Observations are not what a predictor learned from, as in another unit or at another rate.

    `warnings.filterwarnings("error", category=wd.OutOfRange)` makes an error of it.
    """


def installs(what: str) -> str:
    """The command that installs this project's extra `what` ("" for none) where it runs, as advice.

    No index has wakedeploy, and a Pi's own pip is not that of the environment it runs in.
    """
    project = f"'.[{what}]'" if what else "--force-reinstall ."
    pip = f"{sys.executable} -m pip"
    return f"{pip} install --constraint constraints.txt {project} (in wakedeploy's checkout)"


def is_full(error: BaseException) -> bool:
    """Whether what failed is a write for which there is no room."""
    return isinstance(error, OSError) and error.errno in _FULL


def relief(error: BaseException) -> str:
    """What to do about a file that could not be used, as the end of a sentence; "" if unknown."""
    if is_full(error):
        return "; free some space there, then give the same command again"
    if isinstance(error, OSError) and error.errno in _DENIED:
        return "; name another place, or change who may use this one"
    return ""


def is_unusable(error: BaseException) -> bool:
    """Whether a place that was given is not as it has to be, such as a folder for a file."""
    return isinstance(error, _UNUSABLE)


def system_sentence(error: OSError) -> str:
    """What the operating system refused as one sentence: where, what, and what to do if known."""
    nowhere = "a file or the standard output" if is_full(error) else ""
    problem = f"{error.strerror}{relief(error)}."
    return ": ".join(filter(None, (str(error.filename or nowhere), problem)))


@contextlib.contextmanager
def own_errors() -> Iterator[None]:
    """What the operating system refuses in the block is raised as the library's own error.

    A pipe that nobody reads is no matter of a place, and stays what it is. So does what a function
    of the caller's raises, if it is called as `callers` returns it.
    """
    try:
        yield
    except OSError as error:
        if not error.strerror or error.errno == errno.EPIPE or is_callers(error):
            raise
        kind = UnusableInput if is_unusable(error) else WakedeployError
        raise kind(system_sentence(error)) from error


def callers(function: Callable[P, R]) -> Callable[P, R]:
    """A function that a caller gave, whose errors are the caller's own and no matter of ours."""

    @functools.wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return function(*args, **kwargs)
        except Exception as error:
            error.__dict__[_CALLERS] = True  # also where a class of theirs lets nobody set it
            raise

    return called


def is_callers(error: BaseException) -> bool:
    """Whether an error was raised by a function of a caller's, called as `callers` returns it."""
    return hasattr(error, _CALLERS)


def why(error: BaseException) -> str:
    """What failed, as the operating system calls it, else the exception's text on one line."""
    return str(getattr(error, "strerror", None) or one_line(error))


def one_line(error: BaseException) -> str:
    """The text of another library's exception, folded to a single line."""
    return shown(str(error)) or type(error).__name__


def shown(text: str) -> str:
    """A text on one line, without control characters; one that is too long loses its middle."""
    plain = " ".join(text.split())
    for _ in range(2):  # what is not printable gets longer, and what is long takes time to make so
        if len(plain) > _HEAD + _TAIL:
            plain = f"{plain[:_HEAD]} … {plain[-_TAIL:]}"
        plain = printable(plain)
    return plain


def printable(text: str) -> str:
    """A text whose letters a terminal shows, and none of which steers it."""
    return text if text.isprintable() else "".join(map(_letter, text))


def _letter(letter: str) -> str:
    return letter if letter.isprintable() else letter.encode("unicode_escape").decode()
