"""What a page may ask of a run: the way down, at any time, and a flight, in two steps.

Pure decisions; time is given, what is decided goes out by `send`. STOP stays: nothing takes it back
in this run. What was sent need not have been heard: only what the loop does shows that. A flight
that a page has begun lasts only while that page is heard.
"""

import contextlib
import secrets
from collections.abc import Callable
from pathlib import Path

from runtime.io.live_feed import FREE, HELD, STOP
from wakedeploy.live.address import Allowance

HOLD_S = 3.0  # without a beat of the page that has begun a flight
ANSWER_S = 1.0  # without a sign that the loop acts on STOP
CONFIRM_S = (0.5, 10.0)  # after the first step; sooner is a slip of the hand
_MOST_OPEN = 8


class Desk:
    """The latch and the two steps of one run; `arm_file` is there while the run stands by."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._open: dict[str, float] = {}  # first steps: by their word, when
        self._holder, self._heard_s = "", 0.0
        self._asks = Allowance(0.5, 3)
        self.arm_file: Path | None = None
        self.stopped = ""  # why, in words; empty until somebody has stopped it
        self._stopped_s = self._sent_s = 0.0
        self._is_acted_on = False

    def stop(self, why: str, now_s: float) -> None:
        """Ask the loop to bring the sufferer down, and begin nothing any more."""
        self._send(STOP)
        self._sent_s = now_s
        if not self.stopped:
            self.stopped, self._stopped_s = why, now_s
        self._open.clear()
        if self.arm_file is not None:
            with contextlib.suppress(OSError):
                self.arm_file.unlink(missing_ok=True)

    def acted(self) -> None:
        """The loop has begun the way down, or has ended."""
        self._is_acted_on = bool(self.stopped)

    def answer(self, now_s: float) -> str:
        """What became of STOP: "" before it, then "sent", and "acted on" or "unanswered"."""
        if not self.stopped:
            return ""
        if self._is_acted_on:
            return "acted on"
        return "unanswered" if now_s - self._stopped_s > ANSWER_S else "sent"

    def ask(self, now_s: float) -> str | None:
        """The first step: a word to confirm with; None where no flight can be begun."""
        if self.arm_file is None or self.stopped or not self._asks.take(now_s):
            return None
        while len(self._open) >= _MOST_OPEN:
            del self._open[next(iter(self._open))]
        word = secrets.token_urlsafe(12)
        self._open[word] = now_s
        return word

    def confirm(self, word: str, holder: str, now_s: float) -> str:
        """The second step: make the arm file. Why not, or "" where it is made.

        `holder` is a secret of the page that asks; it has to be heard from now on.
        """
        asked_s = self._open.pop(word, None)
        if self.arm_file is None or self.stopped:
            return "This run begins no flight any more."
        if asked_s is None or not CONFIRM_S[0] <= now_s - asked_s <= CONFIRM_S[1]:
            return "Too late or too soon: begin again with the first step."
        if not holder:
            return "This page has no name of its own: load it again."
        self._holder, self._heard_s = holder, now_s
        self._send(HELD)
        try:
            self.arm_file.touch()
        except OSError as error:
            self.release()
            return f"{self.arm_file}: cannot be made ({error.strerror})."
        return ""

    @property
    def is_held(self) -> bool:
        """Whether a page has begun the flight."""
        return bool(self._holder)

    def beat(self, holder: str, now_s: float) -> None:
        """A page is there."""
        if holder and holder == self._holder:
            self._heard_s = now_s

    def look(self, now_s: float) -> None:
        """End a flight whose page is gone; say STOP again where it was not answered."""
        if self._holder and not self.stopped and now_s - self._heard_s > HOLD_S:
            self.stop("the page that began the flight was not heard any more", now_s)
        if self.answer(now_s) == "unanswered" and now_s - self._sent_s > ANSWER_S:
            self._send(STOP)  # it may have found no room in the queue
            self._sent_s = now_s

    def release(self) -> None:
        """The flight is over: nobody has to watch over it."""
        self._holder = ""
        self._send(FREE)
