"""Where a study is kept: Optuna's journal file, or a PostgreSQL database for many machines."""

import contextlib
import fcntl
import hashlib
import importlib
import json
import logging
import os
import threading
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

import optuna
import sqlalchemy.exc
from optuna.storages import BaseStorage, JournalStorage, RDBStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.trial import FrozenTrial
from sqlalchemy.engine import URL, make_url

from wakedeploy.core.errors import UnusableInput, installs, one_line
from wakedeploy.core.files import named
from wakedeploy.core.locks import one_at_a_time

JOURNAL = "study.journal"
OnLost = Callable[[optuna.Study, FrozenTrial], None]

_HEARTBEAT_S, _GRACE_S = 20, 90  # a worker on another machine is given up after the second
_CONNECT_S = 10
# After a minute the server lets go of the turn of a machine that lost its power or its network [s].
_KEEPALIVE = {"tcp_keepalives_idle": 30, "tcp_keepalives_interval": 10, "tcp_keepalives_count": 3}
_LINE_BYTES = 4096  # of most lines of a journal
_BEGINS = b'{"op_code":'  # as Optuna writes them
_PORT = 5432  # where PostgreSQL listens, if nothing else is said
_NO_DRIVER = f"psycopg is not installed; --storage needs: {installs('cluster')}."
_UNREACHABLE = (sqlalchemy.exc.SQLAlchemyError, optuna.exceptions.StorageInternalError)


class Place:
    """Where a study is kept; `name` may be shown, since it never holds a password.

    Raises UnusableInput for an address that is not PostgreSQL's.
    """

    def __init__(self, out: Path, address: str | None) -> None:
        self._url = None if address is None else _postgresql(address)
        self._journal = out.resolve() / JOURNAL
        self.name = str(out / JOURNAL) if self._url is None else _shown(self._url)

    @property
    def portable_name(self) -> str:
        """The same for files that travel: without the path of a folder on this machine."""
        return JOURNAL if self._url is None else self.name

    @property
    def is_journal(self) -> bool:
        """Whether it is a file in the study's own folder."""
        return self._url is None

    def open(self, on_lost: OnLost) -> BaseStorage:
        """Connect; `on_lost` gets the trials of other machines whose heart no longer beats.

        Raises UnusableInput for a database that cannot be reached and for a damaged journal.
        """
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        logging.getLogger("optuna").setLevel(logging.CRITICAL)
        if self._url is None:
            return self._open_journal()
        _require_driver()
        with self.reachable():
            return self._open_database(self._url, on_lost)

    @contextlib.contextmanager
    def turn(self, study: str) -> Iterator[Callable[[], None]]:
        """One process at a time in here, of all that work on the study of this name.

        Those of a journal share its folder, those of a database may be anywhere. A turn ends when
        it is left, when what it was given is called, or with its process or machine. Raises
        UnusableInput for a database that cannot be reached.
        """
        if self._url is None:
            with one_at_a_time(self._journal.parent) as leave:
                yield leave
            return
        _require_driver()
        engine = sqlalchemy.create_engine(
            self._url,
            poolclass=sqlalchemy.NullPool,  # closed is closed: the lock ends with its connection
            isolation_level="AUTOCOMMIT",
            connect_args={"connect_timeout": _CONNECT_S},
        )
        with self.reachable(), engine.connect() as connection:
            for name, value in _KEEPALIVE.items():
                connection.exec_driver_sql(f"SET {name} = {value}")
            waiting = sqlalchemy.text("SELECT pg_advisory_lock(:key)")
            connection.execute(waiting, {"key": _lock_key(study)})
            yield connection.close

    @contextlib.contextmanager
    def reachable(self) -> Iterator[None]:
        """What the database fails with inside becomes UnusableInput, its password left out."""
        hook = threading.excepthook
        threading.excepthook = lambda failed: None if _lost(failed.exc_value) else hook(failed)
        try:
            yield
        except _UNREACHABLE as error:
            raise UnusableInput(
                f"--storage {self.name} cannot be reached ({self._reason(error)}); check address,"
                " user and password, and that the server runs; what is finished is kept there."
            ) from None
        finally:
            threading.excepthook = hook

    def _open_database(self, url: URL, on_lost: OnLost) -> BaseStorage:
        connecting = {"connect_timeout": _CONNECT_S}
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # heartbeats: experimental for years
                return RDBStorage(
                    url.render_as_string(hide_password=False),
                    engine_kwargs={"pool_pre_ping": True, "connect_args": connecting},
                    heartbeat_interval=_HEARTBEAT_S,
                    grace_period=_GRACE_S,
                    heartbeat_stale_trial_callback=on_lost,
                )
        except RuntimeError as error:  # tables of another Optuna
            raise UnusableInput(f"--storage {self.name}: {self._reason(error)}") from None

    def _open_journal(self) -> BaseStorage:
        self._journal.parent.mkdir(parents=True, exist_ok=True)
        try:
            _require_entry_first(self._journal)
            lock = KernelLock(self._journal)
            lock.acquire()  # takes out a broken last line, of which some cannot even be read
            lock.release()
            return JournalStorage(_Journal(self._journal, lock))
        except OSError:
            raise
        except Exception as error:  # a foreign file: replaying it may fail anywhere
            raise UnusableInput(
                f"{self.name} cannot be read as a study ({one_line(error)}); move it away, or"
                " choose another --out."
            ) from error

    def _reason(self, error: Exception) -> str:
        """The last cause's first line, which is the database's own word."""
        cause: BaseException = error
        while isinstance(cause, _UNREACHABLE):
            below = getattr(cause, "orig", None) or cause.__cause__
            if below is None:
                break
            cause = below
        said = one_line(cause).split(" (Background on this error")[0]
        secrets = [] if self._url is None else _secrets(self._url)
        for secret in secrets:
            said = said.replace(secret, "***")
        return said[:200]


class _Journal(JournalFileBackend):
    """Optuna's, whose full disk says which file it is about."""

    def __init__(self, journal: Path, lock: "KernelLock") -> None:
        super().__init__(str(journal), lock_obj=lock)
        self._journal = journal

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Write entries behind those that are there."""
        with named(self._journal):
            super().append_logs(logs)


class KernelLock(JournalFileOpenLock):
    """One writer of the journal at a time; the kernel lets go of the lock of a killed process.

    Optuna's own lock is a file that outlives its owner: everyone then waits for half a minute.
    A last line that is no entry, which a killed writer or a crash left, is taken out by the next.
    """

    def __init__(self, journal: Path) -> None:
        super().__init__(str(journal))
        self._journal = journal
        self._path = journal.with_name(f".{journal.name}.lock")
        self._held: int | None = None

    def acquire(self) -> bool:
        """Wait for the lock.

        An interruption may come before the caller knows that it has to let go again; this process
        would then wait for itself.
        """
        self.release()
        self._held = os.open(self._path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(self._held, fcntl.LOCK_EX)
            _drop_broken_line(self._journal)
        except BaseException:
            self.release()
            raise
        return True

    def release(self) -> None:
        """Let the next one write."""
        held, self._held = self._held, None
        if held is not None:
            os.close(held)


def _require_entry_first(journal: Path) -> None:
    """ValueError for a file that begins with something else: it is somebody's, and stays."""
    if not journal.exists():
        return
    with journal.open("rb") as file:
        first = file.readline()
    if not (first.startswith(_BEGINS) or _BEGINS.startswith(first)):  # the latter: cut there
        raise ValueError("its first line is none of a journal's")
    if first.endswith(b"\n"):
        json.loads(first)


def _drop_broken_line(journal: Path) -> None:
    """Readers pass over most such last lines, but none behind which another was written."""
    if not journal.exists():
        return
    with journal.open("rb+") as file:
        size = file.seek(0, os.SEEK_END)
        last = _last_line(file, size)
        if last and not _is_entry(last):
            file.truncate(size - len(last))


def _last_line(file: BinaryIO, size: int) -> bytes:
    """With its end, if it has one. Every writer does this: no more is read than it takes."""
    length = _LINE_BYTES
    while True:
        file.seek(max(0, size - length))
        tail = file.read()
        before = tail.rfind(b"\n", 0, -1)
        if before >= 0 or length >= size:
            return tail[before + 1 :]
        length *= 2


def _is_entry(line: bytes) -> bool:
    try:
        json.loads(line)
    except ValueError:
        return False
    return line.endswith(b"\n")


def _require_driver() -> None:
    try:
        importlib.import_module("psycopg")
    except ImportError as error:  # or the C library that it needs
        raise UnusableInput(_NO_DRIVER) from error


def _lock_key(study: str) -> int:
    """The number that PostgreSQL knows the lock by, of 64 bits with a sign."""
    digest = hashlib.sha256(f"wakedeploy tune {study}".encode()).digest()
    return int.from_bytes(digest[:8], "big", signed=True)


def _postgresql(address: str) -> URL:
    try:
        url = make_url(address)
    except (sqlalchemy.exc.ArgumentError, ValueError):
        url = None
    if url is None or url.get_backend_name() != "postgresql" or not url.database:
        kind = address.partition(":")[0] if "://" in address else "…"
        raise UnusableInput(
            f"--storage {kind}://…: give a database as postgresql://USER@HOST/DATABASE, or leave"
            " --storage out for a journal file in --out."
        )
    return url.set(drivername="postgresql+psycopg")


def _shown(url: URL) -> str:
    """Without a password, and the same for spellings of the same server."""
    hidden = dict.fromkeys(_hidden(url), "***")
    plain = url.set(drivername="postgresql").update_query_dict(hidden)
    host, port = url.host and url.host.lower(), None if url.port == _PORT else url.port
    plain = plain._replace(host=host, port=port)  # set() cannot take a port away
    return plain.render_as_string(hide_password=True).replace(quote("***", safe=""), "***")


def _hidden(url: URL) -> list[str]:
    return [name for name in url.query if "pass" in name.lower()]


def _secrets(url: URL) -> list[str]:
    """Every spelling of the password that a message might repeat."""
    found: list[Any] = [url.password, *(url.query[name] for name in _hidden(url))]
    plain = [str(secret) for secret in found if secret]
    return sorted({*plain, *map(quote, plain)}, key=len, reverse=True)


def _lost(error: BaseException | None) -> bool:
    """Whether a heartbeat failed; the trial's own thread meets the same failure and reports it."""
    return isinstance(error, _UNREACHABLE)
