"""What is at the other end of a port: a pseudo-terminal with something behind it."""

import os
import threading
import tty


class FarEnd:
    """A pseudo-terminal whose board answers with what a function makes of each read."""

    def __init__(self, answer):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.name = os.ttyname(self.slave)
        self.answer = answer
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self):
        try:
            while data := os.read(self.master, 4096):
                os.write(self.master, self.answer(data))
        except OSError:
            return

    def close(self):
        for end in (self.slave, self.master):
            os.close(end)
