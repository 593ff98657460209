"""How far a command is, as lines on stderr: for logs and pipes, where no bar can be drawn."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

import click

_SILENT_S = 2.0  # what takes no longer says nothing, and no two lines are nearer
_LINE_S = 60.0
_LOOK_S = 0.5
_AT_ONCE_S = 0.1  # what is done so soon was done before
_KNOWN_S = 10.0  # steps of less in all say nothing of the others; no less is shown as left


class LogLines:
    """How far something is: a line each tenth, and one a minute where a tenth takes longer.

    Nothing is said of what takes less than two seconds. Of `done` steps, done before, nothing is
    learned about the time that the others take; nor of steps that took ten seconds together, as
    what follows may be of another kind. A step that takes longer than those before it leaves the
    estimate out, and so do less than ten seconds: the last step may not be the end of the work.
    `counted` shows steps instead of per cent.
    """

    def __init__(self, what: str, total: int = 0, done: int = 0, *, counted: bool = False) -> None:
        self._what, self._counted = what, counted
        self._total, self._done, self._before = total, done, done
        self._began_s = self._said_s = self._stepped_s = time.monotonic()
        self._tenth, self._spoke = self._tenths, False
        self._lock = threading.Lock()

    def begin(self) -> None:
        """Say at once what begins."""
        with self._lock:
            self._say("")

    def describe(self, what: str) -> None:
        """Begin lines with another text."""
        self._what = what

    def update(self, done: int, total: int) -> None:
        """Note that `done` of `total` steps are done, and say so where a line is due."""
        with self._lock:
            now_s = time.monotonic()
            if done != self._done:
                self._stepped_s = now_s
            self._done, self._total = done, total
            if now_s < self._began_s + _AT_ONCE_S:
                self._before, self._tenth = done, self._tenths
            due_s = _SILENT_S if self._tenths > self._tenth else _LINE_S
            if self._before < done < total and now_s >= self._said_s + due_s:
                self._say(f": {self._standing(now_s)}")

    def tick(self) -> None:
        """Say that it goes on, where nothing has been said for long."""
        with self._lock:
            now_s = time.monotonic()
            if now_s < self._said_s + (_LINE_S if self._spoke else _SILENT_S):
                return
            self._say(f": {self._standing(now_s)}" if self._spoke else " …")

    def end(self) -> None:
        """Say how long it took."""
        took_s = time.monotonic() - self._began_s
        if took_s >= _SILENT_S:
            self._say(f": done in {duration(took_s)}")

    @property
    def _tenths(self) -> int:
        return 10 * self._done // self._total if self._total else 0

    def _standing(self, now_s: float) -> str:
        """How far it is, and how long the rest takes or, unknown, how long it has taken."""
        took_s, steps = now_s - self._began_s, self._done - self._before
        if self._done >= self._total:  # what follows the last step is none, nor is a stage of none
            return f"{duration(took_s)} so far"
        far = f"{100 * self._done / self._total:.0f} %"
        far = f"{self._done} of {self._total}" if self._counted else far
        each_s = (self._stepped_s - self._began_s) / steps if steps > 0 else 0.0
        since_s = now_s - self._stepped_s
        left_s = each_s * (self._total - self._done) - since_s
        if since_s > each_s or steps * each_s < _KNOWN_S or left_s < _KNOWN_S:
            return f"{far}, {duration(took_s)} so far"
        return f"{far}, about {duration(left_s)} left"

    def _say(self, how_far: str) -> None:
        click.echo(f"{self._what}{how_far}", err=True)
        self._said_s, self._tenth, self._spoke = time.monotonic(), self._tenths, True


class Stages:
    """Work of several stages: a line when one begins, and lines on how far it is."""

    def __init__(self) -> None:
        self._stage, self._lines = "", LogLines("")

    def __call__(self, stage: str, done: int = 0, total: int = 0, /) -> None:
        """Say that a stage begins, or note how many of its steps are done."""
        if stage != self._stage:
            self._stage, self._lines = stage, LogLines(f"… {stage}")
            self._lines.begin()
        if total:
            self._lines.update(done, total)

    def tick(self) -> None:
        """Say that the stage goes on, where nothing has been said for long."""
        if self._stage:
            self._lines.tick()


def duration(seconds: float) -> str:
    """A time as people say it: "12 s", "5 min", "2.5 h"."""
    if seconds < 99.5:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5970.0 else f"{seconds / 3600:.1f} h"


@contextlib.contextmanager
def stages() -> Iterator[Stages]:
    """Tells the stages of the block's work on stderr."""
    shown = Stages()
    with ticking(shown.tick):
        yield shown


@contextlib.contextmanager
def ticking(tick: Callable[[], None]) -> Iterator[None]:
    """Call `tick` twice a second while the block runs."""
    ended = threading.Event()

    def look() -> None:
        while not ended.wait(_LOOK_S):
            tick()

    watcher = threading.Thread(target=look, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        ended.set()
        watcher.join()
