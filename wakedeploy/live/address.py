"""Where pages are served, and who may come there: addresses, tokens, hosts and origins."""

import hmac
import ipaddress
import re
import secrets
import shlex
import socket
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from wakedeploy.core.errors import UnusableInput, why

DEFAULT = "127.0.0.1:8032"
LEAST_TOKEN = 16
_TOKEN = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True)
class Address:
    """A host and a port, or the path of a Unix socket."""

    host: str = ""
    port: int = 0
    path: Path | None = None

    @property
    def is_private(self) -> bool:
        """Whether only this machine reaches it."""
        return self.path is not None or _is_loopback(self.host)

    def link(self, token: str) -> str:
        """What a person opens; the token stands behind a #, which browsers never send."""
        if self.path is not None:
            # There the path begins at its root, and a shell reads the line.
            forward = shlex.quote(f"8032:{self.path.absolute()}")
            return (
                f"http://127.0.0.1:8032/#{token}, on a computer that runs: "
                f"ssh -N -L {forward} USER@{socket.gethostname()}"
            )
        host = f"[{self.host}]" if ":" in self.host else self.host
        host = socket.gethostname() if host in ("0.0.0.0", "[::]") else host  # noqa: S104
        return f"http://{host}:{self.port}/#{token}"


def address_of(text: str) -> Address:
    """The address in HOST:PORT or in a path; UnusableInput for what is neither."""
    if "/" in text:
        return Address(path=Path(text))
    host, colon, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not colon or not host or not port.isdecimal() or int(port) > 65535:
        raise UnusableInput(
            f"{text}: is no address to serve a page at; give HOST:PORT, such as {DEFAULT}, or the "
            "path of a socket, such as /run/wakedeploy/live."
        )
    return Address(host, int(port))


def token_for(address: Address, token_file: Path | None) -> str:
    """The token of a page: a new one, or that of a file, which is made where it is missing.

    UnusableInput where others reach the address and no file was named.
    """
    if token_file is not None:
        return _kept_token(token_file)
    if not address.is_private:
        raise UnusableInput(
            f"{address.host}: other computers reach this address; say so with --live-token FILE, "
            "which keeps the token (a new file gets a new one), or serve at 127.0.0.1."
        )
    return secrets.token_urlsafe(24)


def _kept_token(path: Path) -> str:
    try:
        if not path.exists():
            path.touch(mode=0o600)
            path.write_text(secrets.token_urlsafe(24) + "\n", "utf-8")
        text = path.read_text("utf-8").strip()
    except (OSError, UnicodeError) as error:
        raise UnusableInput(f"{path}: no token can be kept there ({why(error)}).") from error
    if len(text) < LEAST_TOKEN or not _TOKEN.fullmatch(text):
        raise UnusableInput(
            f"{path}: a token has {LEAST_TOKEN} letters and digits or more, - and _ among them, "
            "and nothing else; remove the file, and a good one is made."
        )
    return text


def fits(given: object, token: str) -> bool:
    """Whether somebody has the token, in a time that does not tell how much of it was right."""
    return isinstance(given, str) and hmac.compare_digest(given.encode(), token.encode())


def is_our_host(header: str, address: Address) -> bool:
    """Whether a request's Host names this machine.

    A page of elsewhere whose name suddenly means this machine (DNS rebinding) names its own.
    """
    host = urlsplit(f"//{header}").hostname or ""
    if address.is_private:
        return _is_loopback(host)
    mine = socket.gethostname().lower()
    return host in (address.host, mine, f"{mine}.local") or _is_number(host)


def is_our_origin(origin: str | None, header: str) -> bool:
    """Whether a request comes from a page that this server sent: the same host and port."""
    return origin is not None and urlsplit(origin).netloc.lower() == header.lower()


def _is_loopback(host: str) -> bool:
    return host == "localhost" or (_is_number(host) and ipaddress.ip_address(host).is_loopback)


def _is_number(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


class Allowance:
    """So many things a second, and some at once; `take` says whether one more is allowed."""

    def __init__(self, per_s: float, at_once: int) -> None:
        self._per_s, self._most = per_s, float(at_once)
        self._remaining, self._last_s = float(at_once), 0.0

    def take(self, now_s: float) -> bool:
        """Use one up."""
        self._remaining = min(self._most, self._remaining + self._per_s * (now_s - self._last_s))
        self._last_s = now_s
        if self._remaining < 1.0:
            return False
        self._remaining -= 1.0
        return True
