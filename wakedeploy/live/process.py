"""Starts the process that serves a flight's page, and ends it.

This alone is imported where the loop flies; tornado is loaded by the other process.
"""

import contextlib
import importlib.util
import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from runtime.io.live_feed import LiveFeed
from wakedeploy.core.errors import UnusableInput, installs
from wakedeploy.core.processes import deaf_to_ctrl_c
from wakedeploy.live.address import Address, address_of, token_for

START_S = 30.0  # on a busy Pi
END_S = 5.0


@dataclass(frozen=True)
class Served:
    """A page that is being served: what a person opens, and where the loop's rows go."""

    url: str
    feed: LiveFeed


def require_tornado() -> None:
    """UnusableInput with what to install where the library is missing."""
    if importlib.util.find_spec("tornado") is None:
        raise UnusableInput(f"Live pages need tornado, which is not installed: {installs('live')}.")


@contextlib.contextmanager
def live_page(address_text: str, token_file: Path | None = None) -> Iterator[Served]:
    """A page that is served while the block runs; UnusableInput where none can be."""
    require_tornado()
    address = address_of(address_text)
    token = token_for(address, token_file)
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with deaf_to_ctrl_c():
        process = subprocess.Popen(  # noqa: S603
            [sys.executable, "-m", "wakedeploy.live", str(its.fileno())],
            pass_fds=[its.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )
    its.close()
    try:
        port = _ask(ours, address, token)
        yield Served(replace(address, port=port).told(token), LiveFeed(ours))
    finally:
        ours.close()  # which ends the other process
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _ask(ours: socket.socket, address: Address, token: str) -> int:
    """The port at which the page is served."""
    asked = {"host": address.host, "port": address.port, "token": token}
    asked["path"] = "" if address.path is None else str(address.path)
    ours.settimeout(START_S)
    try:
        ours.send(json.dumps(asked).encode())
        answer = json.loads(ours.recv(4096))
    except (OSError, ValueError) as error:
        raise UnusableInput(
            "The live page's process did not start; see its message above, or leave --live out."
        ) from error
    if "unusable" in answer:
        raise UnusableInput(answer["unusable"])
    port: int = answer["port"]
    return port
