"""What a reader made of a damaged file: read, refused in a sentence, or a failure, and which.

A failure is any other exception, a warning, a sentence that does not hold, more processor time than
the kind allows, or memory that ran out below the worker's limit, even where that was caught.
"""

import io
import logging
import os
import shutil
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from benchmarks.fuzz.kind import Files, Kind, put
from wakedeploy.core.errors import CheckFailed, UnusableInput

RAN_OUT = "memory ran out, and was caught"
_LONGEST = 1000  # letters of a sentence; a folder's path is one part of it
_AGAIN_S = 0.5  # between two tries to end a reader that hangs


class Hang(BaseException):
    """A reader took too long; no `except Exception` may swallow it."""


@dataclass(frozen=True)
class Verdict:
    """`outcome` is "read", "refused" or "failed"; `trouble` and `where` describe a failure.

    `said` is the refusal's sentence or the failure's traceback; `seconds` are the processor's.
    """

    outcome: str
    said: str = ""
    trouble: str = ""
    where: str = ""
    seconds: float = 0.0

    @property
    def signature(self) -> tuple[str, str]:
        """By which failures count as the same."""
        return self.trouble, self.where


class Judge:
    """Reads folders of one kind after the other in a place of its own, and judges the reader.

    Each may take `patience` times the processor time that its kind allows.
    """

    def __init__(self, folder: Path, patience: float = 1.0) -> None:
        self._place, self._patience = folder, patience
        self._damaged: dict[tuple[str, int], list[str]] = {}
        self._folder = folder
        self._written: list[str] = []
        self._heard: list[str] = []

    def judged(self, kind: Kind, sound: Files, damaged: Files) -> Verdict:
        """What the kind's reader makes of a sound folder with some of its files damaged."""
        self._lay(kind, sound, damaged)
        self._heard.clear()
        began_s = time.process_time()
        verdict = self._read(kind)
        seconds = time.process_time() - began_s
        if verdict.outcome != "failed" and self._heard:
            verdict = Verdict("failed", self._heard[0], _short(self._heard[0]), "heard")
        return Verdict(verdict.outcome, verdict.said, verdict.trouble, verdict.where, seconds)

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Note every warning and whatever is logged, printed or written to either stream."""
        handler = _Ear(self._heard)
        logging.getLogger().addHandler(handler)
        before = signal.signal(signal.SIGPROF, _hang)
        with warnings.catch_warnings(), _streams(self._heard) as look:
            warnings.simplefilter("always")
            warnings.showwarning = self._warned
            self._look = look
            try:
                yield
            finally:
                logging.getLogger().removeHandler(handler)
                signal.signal(signal.SIGPROF, before)

    def _warned(self, message: Warning | str, category: type[Warning], *where: object) -> None:
        self._heard.append(f"{category.__name__}: {message}")

    def _read(self, kind: Kind) -> Verdict:
        signal.setitimer(signal.ITIMER_PROF, self._patience * kind.slowest_s, _AGAIN_S)
        try:
            try:
                kind.read(self._folder)
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
            verdict = Verdict("read")
        except (UnusableInput, CheckFailed) as error:
            verdict = _refusal(error, self._names(kind))
        except (Exception, Hang, SystemExit) as error:
            verdict = _failure(error, type(error).__name__)
        self._look()
        return verdict

    def _names(self, kind: Kind) -> tuple[str, ...]:
        """What a refusal may call what it refuses: one of these."""
        files = (Path(name).name for name in self._written)
        return (str(self._folder), *kind.names, *files)

    def _lay(self, kind: Kind, sound: Files, damaged: Files) -> None:
        """Put a folder in place; where the same sound one lies already, its damage is undone."""
        place = (kind.name, id(sound))
        self._folder = self._place / f"{kind.name}-{id(sound):x}"
        if place not in self._damaged or kind.writes:
            shutil.rmtree(self._folder, ignore_errors=True)
            put(self._folder, sound)
        for name in self._damaged.get(place, ()) if not kind.writes else ():
            if name in sound:
                (self._folder / name).write_bytes(sound[name])
            else:
                (self._folder / name).unlink()
        put(self._folder, damaged)
        self._damaged[place] = self._written = list(damaged)


class _Ear(logging.Handler):
    """Notes what is logged as a warning or worse."""

    def __init__(self, heard: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._list = heard

    def emit(self, record: logging.LogRecord) -> None:
        """Note it."""
        self._list.append(f"logged: {record.getMessage()}")


@contextmanager
def _streams(heard: list[str]) -> Iterator[Callable[[], None]]:
    """Both streams of the process, those of libraries in C included; gives what looks at them."""
    kept = os.dup(1), os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        python = io.TextIOWrapper(io.FileIO(os.dup(file.fileno()), "w"), write_through=True)

        def look() -> None:
            if not os.fstat(file.fileno()).st_size:
                return
            os.lseek(file.fileno(), 0, os.SEEK_SET)
            heard.append(f"written: {os.read(file.fileno(), 2000).decode('utf-8', 'replace')}")
            os.lseek(file.fileno(), 0, os.SEEK_SET)
            os.ftruncate(file.fileno(), 0)

        try:
            with redirect_stdout(python), redirect_stderr(python):
                yield look
        finally:
            for number, before in zip((1, 2), kept, strict=True):
                os.dup2(before, number)
                os.close(before)


def _hang(number: int, frame: FrameType | None) -> None:
    raise Hang("too much processor time")


def _refusal(error: Exception, names: tuple[str, ...]) -> Verdict:
    """A sentence that holds, or what is wrong with it."""
    text, memory = str(error), _ran_out(error)
    if memory is not None:
        return _failure(memory, RAN_OUT)
    for wrong, trouble in (
        (not text.isprintable(), "sentence of several lines or with control characters"),
        (len(text) > _LONGEST, "sentence without an end"),
        (len(text) < 20, "sentence that says nothing"),
        (not any(name in text for name in names), "sentence without the file"),
    ):
        if wrong:
            return Verdict("failed", text, trouble, _place(error))
    return Verdict("refused", text)


def _ran_out(error: BaseException) -> BaseException | None:
    """The lack of memory that an error came of."""
    below: BaseException | None = error
    while below is not None:
        if isinstance(below, MemoryError):
            return below
        below = below.__cause__ or below.__context__
    return None


def _failure(error: BaseException, trouble: str) -> Verdict:
    trace_text = "".join(traceback.format_exception(error, limit=-12, chain=False))
    return Verdict("failed", trace_text[-4000:], trouble, _place(error))


def _place(error: BaseException) -> str:
    """The innermost line of this project that an error came through."""
    frames = traceback.extract_tb(error.__traceback__)
    root = str(Path(__file__).parents[2])
    own_frames = [f for f in frames if f.filename.startswith(root) and "/.venv/" not in f.filename]
    own_frames = [f for f in own_frames if "/benchmarks/fuzz/" not in f.filename] or own_frames
    if not own_frames:
        return "?"
    innermost = own_frames[-1]
    return f"{Path(innermost.filename).relative_to(root)}:{innermost.lineno} {innermost.name}"


def _short(text: str) -> str:
    return " ".join(text.split())[:150]
