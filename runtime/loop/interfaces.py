"""What the loop stands between: the board's end of the wire, and where its rows go."""

from collections.abc import Mapping
from typing import Protocol

from runtime.io.conversation import Answer
from runtime.io.protocol import Arm, Command, Status
from runtime.loop.pilot import LogValue


class RowSink(Protocol):
    """Where rows go: `runtime.io.recorder.Recorder`."""

    @property
    def error(self) -> str | None:
        """Why no more rows can be taken; None while all is well."""

    def put(self, row: Mapping[str, LogValue]) -> None:
        """Take one row without blocking."""


class Onlooker(Protocol):
    """Who looks on, and may ask for the way down: `runtime.io.live_feed.LiveFeed`."""

    def put(self, row: Mapping[str, LogValue]) -> None:
        """Take one row without blocking and without an error."""

    def stop_asked(self) -> bool:
        """Whether the way down was ever asked for."""


class Wire(Protocol):
    """The other end of the wire: `runtime.io.link.Link`, or a simulation of it."""

    @property
    def answer(self) -> Answer | None:
        """The newest status; None before the first."""

    @property
    def failure(self) -> str | None:
        """Why no more statuses will come; None while all is well."""

    @property
    def unanswered_since_s(self) -> float | None:
        """When the oldest frame left that is unanswered, like all after it; None without one."""

    def arm(self, limits: Arm) -> Status:
        """Arm with these limits; the board's answer."""

    def disarm(self) -> None:
        """Motors off."""

    def send(self, message: Command) -> int:
        """Send a command without waiting; its sequence number."""

    def greet_again(self) -> Status | None:
        """The status of a board that fell silent, after a new greeting; None if it stays so."""
