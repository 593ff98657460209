"""What is at the other end of a port: a pseudo-terminal with something behind it."""

import os
import select
import threading
import tty


class FarEnd:
    """A pseudo-terminal whose board answers with what a function makes of each read."""

    def __init__(self, answer):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.name = os.ttyname(self.slave)
        self.answer = answer
        self._ended, self._end = os.pipe()
        self._board = threading.Thread(target=self._serve, daemon=True)
        self._board.start()

    def _serve(self):
        try:
            while self._ended not in select.select([self.master, self._ended], [], [])[0]:
                os.write(self.master, self.answer(os.read(self.master, 4096)))
        except OSError:
            return

    def close(self):
        """The board is gone before its port is: the next one to open may get the same number."""
        os.close(self._end)
        self._board.join()
        for end in (self.slave, self.master, self._ended):
            os.close(end)
