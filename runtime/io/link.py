"""The serial link to the UNO: frames out, statuses in, round trips measured live.

In: a port's name. Out: the newest status and when it came. A thread reads; it only ever waits.
"""

import errno
import os
import select
import threading
import time
from collections.abc import Callable

import serial

from runtime.io.conversation import Conversation
from runtime.io.protocol import BAUD, Frame, Message
from wakedeploy.core.errors import UnusableInput, one_line


class Link(Conversation):
    """An open port with its reader thread; `close` it, or use it as a context manager."""

    def __init__(self, port: str, silence: str = "") -> None:
        super().__init__(port, silence)
        self._serial = _opened(port)
        self._news = threading.Condition()
        self._closing = False
        self._end_of_reading = os.pipe()
        self._reader = threading.Thread(target=self._read, name="link", daemon=True)
        self._reader.start()

    def __enter__(self) -> "Link":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop reading and free the port."""
        self._closing = True
        os.write(self._end_of_reading[1], b"x")
        self._reader.join(timeout=1.0)
        self._serial.close()
        for end in self._end_of_reading:
            os.close(end)

    def _now_s(self) -> float:
        return time.monotonic()

    def _wait(self, until: Callable[[], object], limit_s: float) -> None:
        with self._news:
            self._news.wait_for(until, limit_s)

    # Not pyserial's write and read: its write asks afterwards whether the port is writable, and its
    # in_waiting locks the terminal against writers. Both wait for a kernel thread of ordinary
    # priority, and a real-time loop would wait with them, for up to 18 ms on a busy machine.

    def _transmit(self, data: bytes, message: Message) -> None:
        try:
            if os.write(self._serial.fileno(), data) != len(data):
                raise BlockingIOError("the port takes no more bytes")
        except OSError as error:
            self._fail(error)

    def _read(self) -> None:
        port, end = self._serial.fileno(), self._end_of_reading[0]
        while True:
            ready, _, _ = select.select([port, end], [], [])
            if end in ready:
                return
            try:
                data = os.read(port, 4096)
                if not data:
                    raise OSError("the port is ready but gives nothing")
            except OSError as error:
                self._fail(error)
                return
            self._heard(data, time.monotonic())

    def _take(self, frame: Frame, now_s: float) -> None:
        with self._news:
            super()._take(frame, now_s)
            self._news.notify_all()

    def _fail(self, error: Exception) -> None:
        if self._closing or self._failure is not None:
            return
        with self._news:
            self._failure = (
                f"{self.port}: the connection to the board was lost ({one_line(error)}); "
                "check the USB cable and its power."
            )
            self._news.notify_all()


def _opened(port: str) -> serial.Serial:
    try:
        return serial.Serial(port, BAUD, exclusive=True)
    except (OSError, ValueError, serial.SerialException) as error:
        raise UnusableInput(f"{port}: {_why_not_open(error)}") from error


def _why_not_open(error: Exception) -> str:
    number, text = getattr(error, "errno", None), one_line(error)
    if number in (errno.EACCES, errno.EPERM):
        return "no permission; add yourself to the group dialout and log in again."
    # Another program's lock is refused as a try that would block, its exclusive mode as busy.
    if number in (errno.EAGAIN, errno.EBUSY) or "exclusively lock" in text:
        return "the port is used by another program; close it (a serial monitor, another run)."
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return "no such port; plug the board in, or list the ports with 'wakedeploy doctor'."
    if number == errno.EIO:
        return "the port is there but nothing is behind it; unplug the board and plug it in again."
    return f"cannot be used as a serial port ({text})."
