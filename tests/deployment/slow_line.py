"""A line to the rig that lets a number of bytes through and then no more: ssh's ProxyCommand."""

import os
import socket
import sys
import threading
import time

port, most = int(sys.argv[1]), int(sys.argv[2])
line = socket.create_connection(("127.0.0.1", port))


def back() -> None:
    while data := line.recv(65536):
        os.write(1, data)


threading.Thread(target=back, daemon=True).start()
passed = 0
while passed < most and (data := os.read(0, min(4096, most - passed))):
    line.sendall(data)
    passed += len(data)
while os.getppid() != 1:  # until the ssh that asked for this line is gone
    time.sleep(0.02)
