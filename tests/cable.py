"""A USB cable between a run and a plant process: it passes bytes, until it is pulled."""

import os
import select
import threading
import time
import tty

from runtime.io.protocol import Frame, FrameDecoder, Status, encode_frame


class Cable:
    """`port` is the run's end; the board's stays open when the cable is pulled.

    The board goes on, for it has a supply of its own; docs/how-to/rig.md asks for one.

    `tamper` makes what the run hears of what the board says.
    """

    def __init__(self, board, tamper=lambda message: message):
        self._board = os.open(board, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._board)
        self._mine, slave = os.openpty()
        tty.setraw(slave)
        self.port = os.ttyname(slave)
        self._slave = slave  # open, so that the run can open it later
        self._tamper, self._sequence = tamper, 0
        self._statuses, self._is_pulled, self._writing = [], False, threading.Lock()
        self._hearing = threading.Thread(target=self._down, daemon=True)
        self._hearing.start()
        threading.Thread(target=self._up, daemon=True).start()

    def pull(self):
        """The run's port is gone from now on."""
        self._is_pulled = True
        self._hearing.join()  # the kernel keeps a port open for as long as someone reads from it
        with self._writing:
            os.close(self._slave)
            os.close(self._mine)

    def ask(self, message, limit_s=20.0):
        """Say something to the board, past the run; the status that it answers."""
        self._sequence += 1
        before, end_s = len(self._statuses), time.monotonic() + limit_s
        os.write(self._board, encode_frame(Frame(self._sequence, 0, message)))
        while len(self._statuses) == before:
            assert time.monotonic() < end_s, "the board does not answer"
            time.sleep(0.01)
        return self._statuses[-1]

    def close(self):
        if not self._is_pulled:
            self.pull()
        os.close(self._board)

    def _down(self):
        decoder = FrameDecoder()
        try:
            while not self._is_pulled:
                if not select.select([self._mine], [], [], 0.02)[0]:
                    continue
                data = os.read(self._mine, 4096)
                self._sequence = max(
                    [self._sequence, *(frame.sequence for frame in decoder.feed(data))]
                )
                os.write(self._board, data)
        except OSError:
            return

    def _up(self):
        decoder = FrameDecoder()
        try:
            while data := os.read(self._board, 4096):
                for frame in decoder.feed(data):
                    if isinstance(frame.message, Status):
                        self._statuses.append(frame.message)
                    told = Frame(frame.sequence, frame.time_us, self._tamper(frame.message))
                    with self._writing:
                        if not self._is_pulled:
                            os.write(self._mine, encode_frame(told))
        except OSError:
            return
