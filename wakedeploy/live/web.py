"""What every page's server does: headers, hosts, origins, tokens, and a websocket for each page.

In: an address, a token, files that lie beside this module. Out: answers that a browser takes for
nothing but what they are. Nothing is changed by GET, and nothing but files that anybody may have
is sent without the token.
"""

import asyncio
import contextlib
import errno
import json
import socket
import time
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import tornado.httpserver
import tornado.iostream
import tornado.netutil
import tornado.web
import tornado.websocket

from wakedeploy.core.errors import UnusableInput, why
from wakedeploy.core.pages import page, text_file
from wakedeploy.core.version import VERSION
from wakedeploy.live.address import Address, Allowance, fits, is_our_host, is_our_origin

MOST_PAGES = 64
ASK_S = 0.7  # between two times that pages are asked whether they are there
FLUSH_S = 0.05  # twenty times a second: more is not seen
_WRONG_TOKENS = Allowance(5.0, 10)  # answers to them, so that guessing is slow for all guessers
_ANSWER_S = 1.0  # for a server to answer that may be there
_LATE_S = 5.0  # for a page to say its token
_LAG_BYTES = 64 << 10  # on the way to a page that reads slowly; what is newer waits here
_LOOK = "look.css"  # the colours and type of reports, too
_KINDS = {"html": "text/html", "js": "text/javascript", "css": "text/css", "txt": "text/plain"}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
    "Cache-Control": "no-store",
    "Server": "wakedeploy",
}


class Refused(Exception):
    """A wish of a page that is not carried out; the text says why."""


class Answer(tornado.web.RequestHandler):
    """One request, by somebody who names this machine as its host."""

    def set_default_headers(self) -> None:
        """The headers of every answer."""
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Refuse requests meant for another host, and changes from elsewhere."""
        address: Address = self.settings["address"]
        if not is_our_host(self.request.host, address):
            raise tornado.web.HTTPError(421)
        changes = self.request.method not in ("GET", "HEAD")
        if changes and not is_our_origin(self.request.headers.get("Origin"), self.request.host):
            raise tornado.web.HTTPError(403)

    def require_token(self) -> None:
        """Refuse who does not have it."""
        given = self.request.headers.get("Authorization", "").removeprefix("Bearer ")
        if not fits(given, self.settings["token"]):
            raise tornado.web.HTTPError(401 if _WRONG_TOKENS.take(time.monotonic()) else 429)

    def write_error(self, status_code: int, **_: Any) -> None:
        """One line, without a traceback."""
        self.set_header("Content-Type", "text/plain")
        self.finish(f"{status_code}: {_REASONS.get(status_code, 'that is not possible here')}.\n")


_REASONS = {
    401: "the token is missing or wrong; open the address that the program printed",
    403: "this request comes from another page",
    404: "there is nothing of this name",
    405: "this is not changed so",
    421: "this request names another host",
    429: "too many wrong tokens; wait a second",
}


class Static(Answer):
    """The files of the pages, by name; they hold no data."""

    def initialize(self, template: str = "") -> None:
        """`template` is that of the page at /."""
        self._page = template

    def get(self, name: str = "") -> None:
        """Send one."""
        kind = _KINDS.get((name or self._page).rpartition(".")[2])
        text = _file(name) if name else page("wakedeploy.live", self._page)
        if kind is None or text is None:
            raise tornado.web.HTTPError(404)
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.set_header("Cache-Control", "no-cache")
        self.finish(text)


def _file(name: str) -> str | None:
    """The page file of this name; None without one."""
    if name == _LOOK:
        return text_file(name)
    source = files("wakedeploy.live") / "static" / name
    return source.read_text("utf-8") if "/" not in name and source.is_file() else None


class Missing(Answer):
    """What is nowhere."""

    def prepare(self) -> None:
        """Say so."""
        super().prepare()
        raise tornado.web.HTTPError(404)


class Visitor(tornado.websocket.WebSocketHandler):
    """One page. It says its token first; then it is sent what it has not seen, at its own pace.

    One message is on its way at a time: what a slow page does not take is not kept for it.
    """

    def initialize(self, server: "PageServer") -> None:
        """`server` has the rows, and carries out what pages ask for."""
        self._server = server
        self._is_let_in = self._is_busy = False
        self._seen, self._version, self._epoch = -1, -1, ""
        self._wishes = Allowance(20.0, 40)
        self._sending: asyncio.Future[None] | None = None  # asyncio itself keeps no reference

    def set_default_headers(self) -> None:
        """The headers of every answer."""
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Refuse requests meant for another host, and more pages than there is room for."""
        if not is_our_host(self.request.host, self.settings["address"]):
            raise tornado.web.HTTPError(421)
        if len(self._server.visitors) >= MOST_PAGES:
            raise tornado.web.HTTPError(503)

    def check_origin(self, origin: str) -> bool:
        """Only pages of this server."""
        return is_our_origin(origin, self.request.host)

    def open(self, *_: str, **__: str) -> None:
        """A page that does not say its token goes."""
        if self.request.headers.get("Origin") is None:
            self.close(4403, "no origin")
            return
        self._server.visitors.add(self)
        self.set_nodelay(True)
        protocol = self.ws_connection
        assert isinstance(protocol, tornado.websocket.WebSocketProtocol13)
        protocol.stream.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _LAG_BYTES)
        asyncio.get_running_loop().call_later(_LATE_S, self._go_unless_let_in)

    def _go_unless_let_in(self) -> None:
        if not self._is_let_in:
            self.close(4401, "no token")

    def on_message(self, message: str | bytes) -> None:
        """The token, or a wish."""
        now_s = time.monotonic()
        if not self._wishes.take(now_s):
            self.close(4429, "too many messages")
            return
        try:
            said = json.loads(message)
            if not isinstance(said, dict):
                raise ValueError
        except ValueError:
            self.close(4400, "no JSON object")
            return
        if self._is_let_in:
            self._carry_out(said, now_s)
        else:
            self._let_in(said, now_s)

    def _let_in(self, said: dict[str, Any], now_s: float) -> None:
        if not fits(said.get("token"), self.settings["token"]):
            self.close(4401 if _WRONG_TOKENS.take(now_s) else 4429, "wrong token")
            return
        self._is_let_in = True
        seen, epoch = said.get("seen"), said.get("epoch")
        if isinstance(seen, int) and isinstance(epoch, str) and epoch == self._server.hub.epoch:
            self._seen, self._epoch = min(seen, self._server.hub.count), epoch
        self._server.changed()
        self.offer()

    def _carry_out(self, said: dict[str, Any], now_s: float) -> None:
        try:
            answer = self._server.carry_out(said, now_s)
        except Refused as refusal:
            answer = {"refused": str(refusal)}
        if answer:
            self._send(json.dumps({"answer": answer}))
        self._server.flush()

    def offer(self) -> None:
        """Send what this page has not seen, unless something is still on its way."""
        if not self._is_let_in or self._is_busy:
            return
        hub = self._server.hub
        frame = hub.frame(self._seen, self._version, self._epoch)
        if frame is not None:
            self._seen, self._version, self._epoch = hub.count, hub.version, hub.epoch
            self._is_busy = True
            self._sending = asyncio.ensure_future(self._sent(frame))

    def ask_whether_it_is_there(self) -> None:
        """A word that a page answers, and by whose absence it knows that nobody is here."""
        if self._is_let_in and not self._is_busy:
            self._send('{"there":true}')

    async def _sent(self, frame: str) -> None:
        with contextlib.suppress(
            tornado.websocket.WebSocketClosedError, tornado.iostream.StreamClosedError
        ):
            await self.write_message(frame)
        self._is_busy = False

    def _send(self, text: str) -> None:
        with contextlib.suppress(tornado.websocket.WebSocketClosedError):
            self.write_message(text)

    @property
    def is_let_in(self) -> bool:
        """Whether it has said its token."""
        return self._is_let_in

    @property
    def is_up_to_date(self) -> bool:
        """Whether it has been sent everything."""
        hub = self._server.hub
        is_last = (self._seen, self._version) == (hub.count, hub.version)
        return not self._is_let_in or (is_last and not self._is_busy)

    def on_close(self) -> None:
        """It is gone."""
        self._server.visitors.discard(self)
        self._server.changed()


class PageServer:
    """Visitors of one page, the rows that they are sent, and what they may ask for."""

    def __init__(self) -> None:
        from wakedeploy.live.hub import Hub

        self.hub = Hub()
        self.hub.news(version=VERSION)
        self.visitors: set[Visitor] = set()

    def carry_out(self, said: dict[str, Any], now_s: float) -> dict[str, Any] | None:
        """Do what a page asks for and return the answer. Raises Refused."""
        raise Refused("This page cannot ask for anything.")

    def changed(self) -> None:
        """Pages have come or gone."""
        self.hub.news(pages=sum(visitor.is_let_in for visitor in self.visitors))

    def flush(self) -> None:
        """Offer every page what is new."""
        for visitor in list(self.visitors):
            visitor.offer()

    async def run(self, look: Callable[[], None], is_over: Callable[[], bool]) -> None:
        """Look, offer what is new, and now and then ask pages whether they are there."""
        ask_s = 0.0
        while not is_over():
            look()
            if time.monotonic() >= ask_s:  # before rows are on their way again
                ask_s = time.monotonic() + ASK_S
                for visitor in list(self.visitors):
                    visitor.ask_whether_it_is_there()
            self.flush()
            await asyncio.sleep(FLUSH_S)


def bound(address: Address) -> tuple[list[socket.socket], Address]:
    """Sockets that listen, and the address with the port that was free where it asked for 0.

    UnusableInput where nothing can listen there.
    """
    try:
        if address.path is not None:
            _require_free(address.path)
            return [_unix(address)], address
        sockets = tornado.netutil.bind_sockets(address.port, address.host)
    except OSError as error:
        taken = error.errno == errno.EADDRINUSE
        place = f"{address.path or f'{address.host}:{address.port}'}"
        raise UnusableInput(
            f"{place}: no page can be served there ({why(error)}); "
            + ("end what serves there, or name another port." if taken else "name another address.")
        ) from error
    return sockets, Address(address.host, sockets[0].getsockname()[1])


def _unix(address: Address) -> socket.socket:
    """A socket in the file system that this user alone may reach."""
    return tornado.netutil.bind_unix_socket(str(address.path), mode=0o600)


def _require_free(path: Path) -> None:
    """UnusableInput where somebody answers at a path, or where a file lies that is no socket.

    A socket that a killed server left answers nobody, and is replaced.
    """
    if path.exists() and not path.is_socket():
        raise UnusableInput(f"{path}: is a file, and no socket; name another path.")
    with socket.socket(socket.AF_UNIX) as visitor:
        visitor.settimeout(_ANSWER_S)
        try:
            visitor.connect(str(path))
        except (TimeoutError, BlockingIOError):  # others wait there to be let in
            pass
        except OSError:
            return
    raise UnusableInput(
        f"{path}: no page can be served there (another is); end what serves there, or name another"
        " path."
    )


@contextlib.contextmanager
def listening(address: Address) -> Iterator[tuple[list[socket.socket], Address]]:
    """As `bound`, for as long as the block runs: then nothing listens, and no path is left."""
    sockets, address = bound(address)
    try:
        yield sockets, address
    finally:
        for each in sockets:
            each.close()
        if address.path is not None:
            address.path.unlink(missing_ok=True)


def serve(
    sockets: list[socket.socket],
    application: tornado.web.Application,
) -> tornado.httpserver.HTTPServer:
    """Answer requests from now on."""
    server = tornado.httpserver.HTTPServer(
        application, max_body_size=64 << 10, max_header_size=16 << 10, idle_connection_timeout=60
    )
    server.add_sockets(sockets)
    return server


def application(
    address: Address, token: str, template: str, handlers: list[Any]
) -> tornado.web.Application:
    """The page of a template at /, its files, and `handlers`."""
    return tornado.web.Application(
        [
            (r"/", Static, {"template": template}),
            (r"/static/([A-Za-z0-9._-]+)", Static),
            *handlers,
        ],
        default_handler_class=Missing,
        address=address,
        token=token,
        log_function=lambda handler: None,  # nobody reads it, and addresses are nobody's business
        websocket_ping_interval=5,
        websocket_ping_timeout=5,
        websocket_max_message_size=4096,
    )
