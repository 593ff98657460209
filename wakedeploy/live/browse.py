"""A folder of flights in the browser: a list, one or two flights drawn, reports, a page to send.

Nothing is changed by it: what it writes is the user's cache.
"""

import asyncio
import contextlib
import hashlib
import hmac
import json
import threading
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import tornado.web

from wakedeploy.core.errors import UnusableInput, WakedeployError
from wakedeploy.live.address import address_of, token_for
from wakedeploy.live.export import page_of
from wakedeploy.live.flight_data import flight_data
from wakedeploy.live.flights import Index, reports_in
from wakedeploy.live.web import Answer, application, listening, serve

MOST_FLIGHTS = 2  # drawn over one another
# Requests whose flights are read: behind a long one that nobody wants any more, another.
_AT_ONCE = 2
_KINDS = {".html": "text/html; charset=utf-8", ".png": "image/png", ".svg": "image/svg+xml"}
# Reports were made by somebody: they may draw themselves, and reach nothing of this server.
_REPORT_POLICY = (
    "sandbox allow-scripts allow-popups; default-src 'none'; img-src 'self' data:; "
    "style-src 'unsafe-inline'; script-src 'unsafe-inline'; frame-ancestors 'none'"
)


class Flights:
    """What the pages of a folder get."""

    def __init__(self, folder: Path, token: str) -> None:
        self.folder = folder
        self.index = Index(folder)
        self.reading = (0, 0)
        self.way = hmac.new(token.encode(), b"reports", hashlib.sha256).hexdigest()[:32]
        self.turns = asyncio.Semaphore(_AT_ONCE)
        self._data: dict[tuple[str, int], Future[dict[str, Any]]] = {}
        self._lock = threading.Lock()

    def read_on(self) -> None:
        """Read what is new, in a thread of its own."""
        threading.Thread(target=self._refresh, daemon=True).start()

    def _refresh(self) -> None:
        self.index.refresh(self._note)
        self.reading = (0, 0)

    def _note(self, done: int, total: int) -> None:
        self.reading = (done, total)

    def listed(self) -> dict[str, Any]:
        """The list, how far reading is, and the reports beside."""
        if self.index.look():
            self.read_on()
        done, total = self.reading
        return {
            "folder": str(self.folder),
            "flights": self.index.rows(),
            "reading": {"done": done, "total": total},
            "reports": reports_in(self.folder),
            "way": f"/report/{self.way}/",
        }

    def known(self, name: str) -> dict[str, Any] | None:
        """One flight that is in memory, None for others."""
        if name not in self.index:
            return None
        with contextlib.suppress(OSError):
            read = self._data.get((name, (self.folder / name).stat().st_mtime_ns))
            if read is not None and read.done() and not read.exception():
                return read.result()
        return None

    def data(self, name: str) -> dict[str, Any]:
        """One flight, read once however many ask at a time; the last few stay in memory.

        Raises UnusableInput for what is not listed.
        """
        if name not in self.index:
            raise UnusableInput(f"{name}: there is no such flight in this folder.")
        path = self.folder / name
        key = (name, path.stat().st_mtime_ns)
        with self._lock:
            known = self._data.get(key)
            read = known or Future[dict[str, Any]]()
            if known is None:
                while len(self._data) >= 2 * MOST_FLIGHTS:
                    del self._data[next(iter(self._data))]
                self._data[key] = read
        if known is None:
            self._read(path, key, read)
        return read.result()

    def _read(self, path: Path, key: tuple[str, int], read: Future[dict[str, Any]]) -> None:
        """Carry a reading out; one that failed is not kept."""
        try:
            read.set_result(flight_data(path, key[0]))
        except Exception as error:
            with self._lock:
                self._data.pop(key, None)
            read.set_exception(error)

    def report(self, name: str) -> Path | None:
        """A report's or picture's file, if it lies in the folder."""
        path = (self.folder / name).resolve()
        inside = path.is_relative_to(self.folder.resolve()) and path.suffix in _KINDS
        return path if inside and path.is_file() else None


class _Told(Answer):
    """Answers as JSON, to who has the token."""

    def initialize(self, flights: Flights) -> None:
        """`flights` knows the folder."""
        self.flights, self._is_gone = flights, False

    def on_connection_close(self) -> None:
        """Whoever asked has chosen something else."""
        self._is_gone = True

    def prepare(self) -> None:
        """Only with the token."""
        super().prepare()
        self.require_token()

    def tell(self, document: object) -> None:
        """Send JSON."""
        self.set_header("Content-Type", "application/json")
        self.finish(json.dumps(document, separators=(",", ":")))

    async def chosen(self) -> list[dict[str, Any]]:
        """The flights that a request names; 404 for one that cannot be read.

        Who walks through a list by its keys asks for many in a second and waits for the last alone:
        what nobody waits for when its turn comes is not read.
        """
        names = self.get_arguments("name")
        if not 1 <= len(names) <= MOST_FLIGHTS:
            raise tornado.web.HTTPError(400)
        return [await self._one(name) for name in names]

    async def _one(self, name: str) -> dict[str, Any]:
        known = self.flights.known(name)
        if known is not None:
            return known
        async with self.flights.turns:
            if self._is_gone:
                raise tornado.web.Finish
            try:
                return await asyncio.to_thread(self.flights.data, name)
            except (WakedeployError, OSError) as error:
                raise tornado.web.HTTPError(404) from error


class List(_Told):
    """The list."""

    def get(self) -> None:
        """Send it."""
        self.tell(self.flights.listed())


class Chosen(_Told):
    """One flight, or two."""

    async def get(self) -> None:
        """Send their columns."""
        self.tell(await self.chosen())


class Export(_Told):
    """The same as a page that needs nothing else."""

    async def get(self) -> None:
        """Send it as a file to keep."""
        page = page_of(await self.chosen())
        self.set_header("Content-Type", "application/octet-stream")
        self.set_header("Content-Disposition", 'attachment; filename="flight.html"')
        self.finish(page)


class Report(Answer):
    """A report that lies beside the flights, at an address that nobody can guess."""

    def initialize(self, flights: Flights) -> None:
        """`flights` knows the folder."""
        self._flights = flights

    def get(self, way: str, name: str) -> None:
        """Send one."""
        path = self._flights.report(name)
        if not hmac.compare_digest(way, self._flights.way) or path is None:
            raise tornado.web.HTTPError(404)
        self.set_header("Content-Type", _KINDS[path.suffix])
        self.set_header("Content-Security-Policy", _REPORT_POLICY)
        self.set_header("Cross-Origin-Resource-Policy", "cross-origin")
        self.finish(path.read_bytes())


def handlers(flights: Flights) -> list[Any]:
    """What is served beside the page and its files."""
    known = {"flights": flights}
    return [
        (r"/api/flights", List, known),
        (r"/api/flight", Chosen, known),
        (r"/api/export", Export, known),
        (r"/report/([0-9a-f]+)/(.+)", Report, known),
    ]


def browse(folder: Path, listen: str, token_file: Path | None, tell: Callable[[str], None]) -> None:
    """Serve a folder until the program is interrupted; `tell` gets the address."""
    if not folder.is_dir():
        raise UnusableInput(f"{folder}: there is no such folder; name one that holds run logs.")
    address = address_of(listen)
    token = token_for(address, token_file)
    flights = Flights(folder.resolve(), token)  # "." would not say which
    with listening(address) as (sockets, there):

        async def run() -> None:
            serve(sockets, application(there, token, "browse.html", handlers(flights)))
            flights.read_on()
            tell(there.link(token))
            await asyncio.Event().wait()

        asyncio.run(run())
