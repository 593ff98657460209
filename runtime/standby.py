"""Standing by at the rig: board and sensor watched, motors off, until a person asks for one flight.

A flight is asked for by making a file. It is taken away before anything is armed, and one that is
there when the standby begins is taken away unheeded: whatever crashes and is started again stands
by again, and no motor spins without a new word.
"""

import time
from collections.abc import Callable
from pathlib import Path

from runtime.io.conversation import Conversation
from runtime.io.range_source import RangeSource, failure_sentence
from wakedeploy.core.errors import CheckFailed, UnusableInput

LOOK_S = 0.1
GREETING_S = 1.0  # between two handshakes, which also keep the board disarmed
SILENCE_LIMIT_S = 1.0


def begin_standby(arm_file: Path) -> bool:
    """Forget an old word; whether there was one. UnusableInput where no new one could be given."""
    if not arm_file.parent.is_dir():
        raise UnusableInput(
            f"{arm_file}: there is no folder for this file; make it, or name another --arm-file."
        )
    return _taken(arm_file)


def stand_by(
    arm_file: Path, link: Conversation, ranges: RangeSource, beat: Callable[[], None]
) -> None:
    """Return once the file has appeared and been taken away.

    Raises UnusableInput when board or sensor fall silent meanwhile.
    """
    greeted_s = time.monotonic()
    while not _taken(arm_file):
        now_s = time.monotonic()
        if now_s - greeted_s > GREETING_S:
            link.handshake()
            greeted_s = now_s
        _require_samples(ranges)
        beat()
        time.sleep(LOOK_S)


def _taken(arm_file: Path) -> bool:
    """Take the file away; whether it was there. CheckFailed when it cannot be taken."""
    try:
        arm_file.unlink()
    except FileNotFoundError:
        return False
    except OSError as error:
        raise CheckFailed(
            f"{arm_file}: cannot be taken away ({error.strerror}), so it could ask for a flight "
            "again and again; give this user the folder."
        ) from error
    return True


def _require_samples(ranges: RangeSource) -> None:
    newest = ranges.newest
    silent = newest is None or time.monotonic() - newest.sensor_time_s > SILENCE_LIMIT_S
    if silent or ranges.failure is not None:
        raise UnusableInput(
            failure_sentence(ranges)
            or "The range sensor fell silent while standing by; check its wires and its power."
        )
