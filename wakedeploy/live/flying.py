"""The server of a flight as it is flown: a process of its own at the other end of the loop's feed.

In: datagrams from `runtime.io.live_feed`. Out: a page; words to the loop.
"""

import asyncio
import contextlib
import json
import os
import signal
import socket
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.io.realtime import loop_core
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.failsafes import HINTS
from wakedeploy.live.address import Address
from wakedeploy.live.desk import Desk
from wakedeploy.live.events import Events
from wakedeploy.live.rows import page_row
from wakedeploy.live.web import (
    FLUSH_S,
    Answer,
    PageServer,
    Refused,
    Visitor,
    application,
    bound,
    serve,
)

if TYPE_CHECKING:
    from wakedeploy.live.foxglove import FoxgloveView

MOST_BYTES = 64 << 10  # of one datagram
SILENT_S = 1.0  # without a row in flight, 32 ticks
_WAY_DOWN = ("LANDING", "FAILSAFE")
LAST_WORD_S = 1.0  # in which pages get what came last
_NICE = 10


class FlightServer(PageServer):
    """A flight's rows on their way to pages, and the pages' wishes on their way to the loop."""

    def __init__(self, end: socket.socket, foxglove: "FoxgloveView | None" = None) -> None:
        super().__init__()
        self._end, self._foxglove = end, foxglove
        self._events = Events()
        self.is_over = False
        self.desk = Desk(self._say)
        self._row_s: float | None = None  # when the newest row of this flight came
        self.hub.news(kind="flight", phase="starting", hints=HINTS, arm=False, held=False)

    def _say(self, word: bytes) -> None:
        with contextlib.suppress(OSError):
            self._end.send(word)

    def read(self) -> None:
        """Take what the loop has sent."""
        while not self.is_over:
            try:
                data = self._end.recv(MOST_BYTES)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._end_of_run()
                return
            self._take(json.loads(data))

    def _take(self, message: dict[str, Any]) -> None:
        if "row" in message:
            self._see(message["row"])
            self.hub.news(dropped=message["dropped"])
        else:
            self._hear(message["news"])

    def _see(self, row: dict[str, Any]) -> None:
        """One tick."""
        self._row_s = time.monotonic()
        if row["mode"] in _WAY_DOWN or "operator_stop" in row["faults"].split("+"):
            self.desk.acted()
        self.hub.add(page_row(row))
        if self._foxglove is not None:
            self._foxglove.put(row)
        if self._events.see(row["t_s"], row["mode"], row["faults"]):
            self.hub.news(events=self._events.found)

    def _hear(self, news: dict[str, Any]) -> None:
        """The run is at something else."""
        if news["phase"] == "standby":
            self.desk.arm_file = Path(news.pop("arm_file"))
        else:
            self.desk.arm_file = None
        self._row_s = None
        if news["phase"] == "ended":
            self.desk.release()
            self.desk.acted()
        self.hub.news(**news)
        self._tell_desk()

    def _end_of_run(self) -> None:
        self.is_over = True
        self.desk.arm_file = self._row_s = None
        self.desk.acted()
        if self.hub.state["phase"] != "ended":
            self.hub.news(phase="ended", ended="the program ended")
        self._tell_desk()

    def _tell_desk(self) -> None:
        desk = self.desk
        can_arm = desk.arm_file is not None and not desk.stopped
        now_s = time.monotonic()
        self.hub.news(
            arm=can_arm, stopped=desk.stopped, stop=desk.answer(now_s), held=desk.is_held,
            silent=self._row_s is not None and now_s - self._row_s > SILENT_S,
        )  # fmt: skip

    def look(self) -> None:
        """Whether the page that watches is still there, and the loop."""
        self.desk.look(time.monotonic())
        self._tell_desk()

    def carry_out(self, said: dict[str, Any], now_s: float) -> dict[str, Any] | None:
        """STOP, the two steps to a flight, a page's beat."""
        match said.get("do"):
            case "stop":
                self.stop()
            case "arm":
                return self._first_step(now_s)
            case "confirm":
                why = self.desk.confirm(_text(said, "word"), _text(said, "holder"), now_s)
                self._tell_desk()
                if why:
                    raise Refused(why)
                return {"confirmed": True}
            case "beat":
                self.desk.beat(_text(said, "holder"), now_s)
            case _:
                raise Refused("There is no such command.")
        return None

    def _first_step(self, now_s: float) -> dict[str, Any]:
        word = self.desk.ask(now_s)
        if word is None:
            raise Refused("No flight can be begun now; wait a second, or look at the mode.")
        return {"confirm": word}

    def stop(self) -> None:
        """The way down, from a page."""
        self.desk.stop("STOP was pressed on a page", time.monotonic())
        self._tell_desk()


def _text(said: dict[str, Any], key: str) -> str:
    value = said.get(key)
    return value if isinstance(value, str) else ""


class Stop(Answer):
    """STOP without a websocket, for a page that has just lost its own."""

    def initialize(self, server: FlightServer) -> None:
        """`server` has the way to the loop."""
        self._server = server

    def post(self) -> None:
        """Stop."""
        self.require_token()
        self._server.stop()
        self.finish("stopping\n")


def main(descriptor: int) -> int:
    """Serve one run until its program ends; the exit status."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all, also to the loop
    end = socket.socket(fileno=descriptor)
    asked = json.loads(end.recv(MOST_BYTES))
    try:
        page = _bound(asked.get("page"))
        _give_way()
        foxglove = _foxglove(asked.get("foxglove"))
    except UnusableInput as error:
        end.send(json.dumps({"unusable": str(error)}).encode())
        return error.exit_status
    asyncio.run(_served(end, page, foxglove))
    if foxglove is not None:
        foxglove.stop()
    if page is not None and page.address.path is not None:
        page.address.path.unlink(missing_ok=True)
    return 0


@dataclass(frozen=True)
class _Page:
    """Where a page is served, and to whom."""

    sockets: list[socket.socket]
    address: Address
    token: str


def _bound(asked: dict[str, Any] | None) -> _Page | None:
    if asked is None:
        return None
    path = Path(asked["path"]) if asked["path"] else None
    return _Page(*bound(Address(asked["host"], asked["port"], path)), asked["token"])


def _foxglove(asked: dict[str, Any] | None) -> "FoxgloveView | None":
    """Its server, whose threads keep off the loop's core as this process does."""
    if asked is None:
        return None
    from wakedeploy.live.foxglove import FoxgloveView

    return FoxgloveView(asked["host"], asked["port"])


def _give_way() -> None:
    """Keep off the loop's core, and let everything else go first."""
    os.nice(_NICE)
    others = os.sched_getaffinity(0) - {loop_core()}
    if others:
        os.sched_setaffinity(0, others)


async def _served(end: socket.socket, page: _Page | None, foxglove: "FoxgloveView | None") -> None:
    server = FlightServer(end, foxglove)
    ports = {}
    if page is not None:
        handlers = [(r"/live", Visitor, {"server": server}), (r"/stop", Stop, {"server": server})]
        serve(page.sockets, application(page.address, page.token, "live.html", handlers))
        ports["page"] = page.address.port
    if foxglove is not None:
        ports["foxglove"] = foxglove.port
    end.send(json.dumps(ports).encode())
    end.setblocking(False)
    asyncio.get_running_loop().add_reader(end, server.read)
    await server.run(server.look, lambda: server.is_over)
    asyncio.get_running_loop().remove_reader(end)
    end_s = time.monotonic() + LAST_WORD_S
    while time.monotonic() < end_s and not all(
        visitor.is_up_to_date for visitor in server.visitors
    ):
        server.flush()
        await asyncio.sleep(FLUSH_S)
    for visitor in list(server.visitors):
        visitor.close(4000, "the run has ended")
    await asyncio.sleep(FLUSH_S)
