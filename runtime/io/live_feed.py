"""What a live page gets from the loop: one datagram a tick, to a process of its own.

The queue between the two is the kernel's, and bounded: where the other process does not keep up,
a row is dropped and counted. The loop neither waits nor has a thread for it.
"""

import contextlib
import json
import socket
from collections.abc import Mapping

from wakedeploy.core.runlog_columns import Value

QUEUE_BYTES = 128 << 10  # some four seconds of rows, as the kernel counts them
_MOST_BYTES = 512  # of one word from the other process
STOP, HELD, FREE = b"stop", b"held", b"free"


class LiveFeed:
    """The loop's end of the socket to the process that serves the page; it never raises.

    `offered` and `dropped` count rows. `is_gone` says that the other process has ended: the
    flight goes on without it, unless a page has begun it.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, QUEUE_BYTES)
        end.setblocking(False)
        self._end = end
        self._stop_asked = self._is_held = False
        self.is_gone = False
        self.offered = self.dropped = 0

    def put(self, row: Mapping[str, Value]) -> None:
        """Hand over one tick, or drop it."""
        self.offered += 1
        if not self._sent({"row": row, "dropped": self.dropped}):
            self.dropped += 1

    def tell(self, news: Mapping[str, object]) -> None:
        """Say what else a page shows: the rig, what the run is at, how it ended."""
        self._sent({"news": news})

    def stop_asked(self) -> bool:
        """Whether a page has ever asked for the way down; the answer stays."""
        while (word := self._heard()) is not None:
            self._stop_asked |= word == STOP
            self._is_held = word == HELD or (self._is_held and word != FREE)
        return self._stop_asked

    def close(self) -> None:
        """Nothing more will come."""
        self._end.close()

    def _heard(self) -> bytes | None:
        """The next word; None for none, and a word for a process that is gone for ever.

        A page that has begun a flight watches over it; when nothing can come from it any more, the
        flight ends as if it had asked.
        """
        if self.is_gone:
            return None
        try:
            word = self._end.recv(_MOST_BYTES)
        except BlockingIOError:
            return None
        except OSError:
            word = b""
        if word == b"":
            self.is_gone = True
            return STOP if self._is_held else FREE
        return word

    def _sent(self, message: Mapping[str, object]) -> bool:
        with contextlib.suppress(OSError, ValueError, TypeError):
            self._end.send(json.dumps(message, separators=(",", ":")).encode())
            return True
        return False
