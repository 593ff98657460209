"""The door for the board's answers: which are new, and how late they are.

In: the newest answer. Out: how long it has been the same, and how many in a row took too long.
"""

from dataclasses import dataclass

from runtime.io.conversation import Answer
from runtime.loop.safety import LATE_ANSWER_S, LATE_COMMAND_S
from wakedeploy.core.rig import Rig

OLD_TICKS = 4  # after this many ticks with the same answer nobody knows where the carriage is


@dataclass(frozen=True, slots=True)
class Heard:
    """One tick's look at the newest answer."""

    answer: Answer
    repeats: int  # ticks since it was new
    late_answers: int  # in a row, later than the rig's round trip by LATE_ANSWER_S
    late_commands: int  # the same by LATE_COMMAND_S

    @property
    def is_new(self) -> bool:
        """Whether it came since the tick before."""
        return self.repeats == 0


class AnswerDoor:
    """Remembers from tick to tick the newest sequence number, and late answers."""

    def __init__(self, rig: Rig) -> None:
        self._round_trip_s = rig.latency.round_trip_s
        self._sequence: int | None = None
        self._repeats = self._late_answers = self._late_commands = 0

    def step(self, answer: Answer) -> Heard:
        """Look at the newest answer."""
        is_new = answer.status.sequence != self._sequence
        self._sequence = answer.status.sequence
        self._repeats = 0 if is_new else self._repeats + 1
        if is_new:
            extra_s = answer.round_trip_s - self._round_trip_s
            self._late_answers = self._late_answers + 1 if extra_s > LATE_ANSWER_S else 0
            self._late_commands = self._late_commands + 1 if extra_s > LATE_COMMAND_S else 0
        return Heard(answer, self._repeats, self._late_answers, self._late_commands)
