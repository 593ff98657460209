"""Starts the process that serves a flight to browsers and to Foxglove, and ends it.

This alone is imported where the loop flies; tornado and Foxglove's library are loaded by the other
process.
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
from typing import Any

from runtime.io.live_feed import LiveFeed
from wakedeploy.core.errors import UnusableInput, installs
from wakedeploy.core.processes import deaf_to_ctrl_c
from wakedeploy.live.address import address_of, token_for

START_S = 30.0  # on a busy Pi
END_S = 5.0


FOXGLOVE = "127.0.0.1:8765"


@dataclass(frozen=True)
class Served:
    """What is being served: what a person opens, and where the loop's rows go."""

    url: str | None  # of the page
    foxglove: str | None
    feed: LiveFeed


def require_tornado() -> None:
    """UnusableInput with what to install where the library is missing."""
    if importlib.util.find_spec("tornado") is None:
        raise UnusableInput(f"Live pages need tornado, which is not installed: {installs('live')}.")


def require_foxglove() -> None:
    """UnusableInput with what to install where a library is missing."""
    if any(importlib.util.find_spec(name) is None for name in ("foxglove", "tornado")):
        raise UnusableInput(
            f"--foxglove needs foxglove-sdk, which is not installed: {installs('foxglove')}."
        )


@contextlib.contextmanager
def live_views(
    page: str | None, foxglove: str | None = None, token_file: Path | None = None
) -> Iterator[Served]:
    """What is served while the block runs: a page, a server for Foxglove, or both, at addresses.

    UnusableInput where one cannot be served.
    """
    asked: dict[str, Any] = {}
    if page is not None:
        require_tornado()
        address = address_of(page)
        token = token_for(address, token_file)
        path = "" if address.path is None else str(address.path)
        asked["page"] = {"host": address.host, "port": address.port, "path": path}
        asked["page"]["token"] = token
    if foxglove is not None:
        require_foxglove()
        asked["foxglove"] = _private(foxglove)
    with _process(asked) as (ours, answer):
        yield Served(
            None if page is None else replace(address, port=answer["page"]).link(token),
            f"ws://{_shown(asked['foxglove']['host'])}:{answer['foxglove']}" if foxglove else None,
            LiveFeed(ours),
        )


def _private(text: str) -> dict[str, Any]:
    """Host and port for Foxglove, which this computer alone reaches."""
    address = address_of(text)
    if address.path is not None or not address.is_private:
        raise UnusableInput(
            f"{text}: Foxglove is served without a token, to this computer alone; give "
            f"{FOXGLOVE}, and reach it from another one by ssh -L 8765:{FOXGLOVE} USER@HOST."
        )
    host = "127.0.0.1" if address.host == "localhost" else address.host
    return {"host": host, "port": address.port}


def _shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host


@contextlib.contextmanager
def _process(asked: dict[str, Any]) -> Iterator[tuple[socket.socket, dict[str, int]]]:
    """The process, while the block runs: the loop's end of its socket, and the ports it has."""
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
        yield ours, _ask(ours, asked)
    finally:
        ours.close()  # which ends the other process
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _ask(ours: socket.socket, asked: dict[str, Any]) -> dict[str, int]:
    """The ports at which things are served."""
    ours.settimeout(START_S)
    try:
        ours.send(json.dumps(asked).encode())
        answer = json.loads(ours.recv(4096))
    except (OSError, ValueError) as error:
        raise UnusableInput(
            "The process that serves the flight did not start; see its message above, or leave "
            "--live and --foxglove out."
        ) from error
    if "unusable" in answer:
        raise UnusableInput(answer["unusable"])
    ports: dict[str, int] = answer
    return ports
