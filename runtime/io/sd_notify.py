"""What a run reports to systemd, if systemd started it: ready, alive, what it does, about to end.

The protocol is sd_notify's: datagrams to the socket that the environment names. Without such a
socket nothing is sent. Whoever feeds the watchdog is the loop itself, tick by tick, so that a loop
that hangs in a living process is noticed.
"""

import contextlib
import os
import socket
import time
from collections.abc import Mapping

_BEATS_PER_LIMIT = 4


class ServiceManager:
    """The socket of the service manager; `environment` says where it is, if there is one."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        name = environment.get("NOTIFY_SOCKET", "")
        # A name that begins with @ is in the abstract namespace, which has no files.
        self._address = "\0" + name[1:] if name.startswith("@") else name
        self._socket: socket.socket | None = None
        if name.startswith(("@", "/")):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._beat_s = _watchdog_s(environment) / _BEATS_PER_LIMIT
        self._next_s = 0.0

    def ready(self, status: str) -> None:
        """The service has started."""
        self._send(f"READY=1\nSTATUS={status}")

    def status(self, status: str) -> None:
        """What the service does now, for `systemctl status`."""
        self._send(f"STATUS={status}")

    def stopping(self, status: str) -> None:
        """The service is about to end."""
        self._send(f"STOPPING=1\nSTATUS={status}")

    def beat(self) -> None:
        """Feed the watchdog, four times per limit however often it is called; never waits."""
        now_s = time.monotonic()
        if self._socket is None or self._beat_s == 0.0 or now_s < self._next_s:
            return
        with contextlib.suppress(OSError):  # a full queue: again at the next tick
            self._socket.sendto(b"WATCHDOG=1", socket.MSG_DONTWAIT, self._address)
            self._next_s = now_s + self._beat_s

    def close(self) -> None:
        """Let go of the socket."""
        if self._socket is not None:
            self._socket.close()

    def _send(self, message: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):  # the manager restarts: no reason to end a flight
                self._socket.sendto(message.encode(), self._address)


def _watchdog_s(environment: Mapping[str, str]) -> float:
    """The manager's limit between two beats [s]; 0 where it sets this process none."""
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return 0.0
    microseconds = environment.get("WATCHDOG_USEC", "")
    return int(microseconds) * 1e-6 if microseconds.isdecimal() else 0.0
