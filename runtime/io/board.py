"""What a board says of itself before a flight: which one it is, its sketch, its last reset.

In: a link. Out: a `BoardNews` for the log and the screen. A port that is not the virtual gantry's
must have an UNO behind it.
"""

from dataclasses import dataclass

from runtime.io.conversation import Conversation
from runtime.io.protocol import Board, Fault
from wakedeploy.core.errors import UnusableInput

_RESETS = {
    Fault.WATCHDOG: "watchdog (its program hung)",
    Fault.BROWNOUT: "brownout (its supply sagged)",
}


@dataclass(frozen=True)
class BoardNews:
    """One board at its handshake; `faults` are those of its last reset and its last flight."""

    board: int
    firmware: int
    boot: int
    faults: Fault

    @property
    def metadata(self) -> dict[str, str]:
        """For a run's log."""
        known = {board.value: board.name.lower() for board in Board}
        return {
            "board": known.get(self.board, str(self.board)),
            "firmware": str(self.firmware),
            "board_boot": str(self.boot),
            "board_faults": "+".join(fault.name or "" for fault in self.faults).lower(),
        }

    @property
    def warning(self) -> str | None:
        """A sentence about a reset that nobody asked for; None without one."""
        why = last_reset(self.faults)
        return f"The board's last reset: {why}." if why else None


def last_reset(faults: Fault) -> str:
    """Why a board was reset, in words; empty where it does not know of a fault."""
    return " and ".join(words for fault, words in _RESETS.items() if fault in faults)


def met_board(link: Conversation, *, may_be_virtual: bool) -> BoardNews:
    """Greet the board behind a link. It is disarmed afterwards and has yet to be armed.

    Raises UnusableInput for what is no UNO, unless it may be virtual, and what a handshake raises;
    CheckFailed when it falls silent.
    """
    reply = link.handshake()
    if reply.board != Board.UNO and not (may_be_virtual and reply.board == Board.VIRTUAL):
        what = "a virtual board" if reply.board == Board.VIRTUAL else f"board {reply.board}"
        raise UnusableInput(
            f"{link.port}: {what} answers, and only an UNO may fly a rig; name the UNO's port "
            "('wakedeploy doctor' lists them)."
        )
    return BoardNews(reply.board, reply.firmware, reply.boot, link.status().faults)
