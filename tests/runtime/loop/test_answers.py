"""How old and how late the board's answers are, and since when one has been missing."""

from dataclasses import replace

import pytest

from runtime.io.conversation import Answer, Conversation
from runtime.io.protocol import Command, Fault, Frame, Status, encode_frame
from runtime.loop.answers import AnswerDoor
from runtime.loop.safety import LATE_ANSWER_S, LATE_COMMAND_S
from wakedeploy.rig.file import default_rig

RIG = default_rig()
STATUS = Status(1, 7, Fault.NONE, True, True, 1000.0, 1000.0, 0, 0, 0, 0, 0)
COMMAND = Command(1000.0, 1000.0, 0, 1000, 1000)


class Talk(Conversation):
    """A conversation whose wire and clock the test plays."""

    def __init__(self):
        super().__init__("the test")
        self.now_s = 100.0

    def _now_s(self):
        return self.now_s

    def _transmit(self, data, message):
        pass

    def _wait(self, until, limit_s):
        pass

    def sent(self, at_s):
        self.now_s = at_s
        return self.send(COMMAND)

    def answered(self, sequence, at_s):
        message = replace(STATUS, sequence=sequence)
        self._heard(encode_frame(Frame(sequence, 0, message)), at_s)


def test_silence_begins_with_the_oldest_command_that_is_unanswered():
    talk = Talk()
    assert talk.unanswered_since_s is None
    first, second, _ = (talk.sent(at_s) for at_s in (100.0, 100.03, 100.06))
    assert talk.unanswered_since_s == 100.0
    talk.answered(first, 100.07)
    assert talk.unanswered_since_s == 100.03
    talk.answered(second, 100.08)
    assert talk.unanswered_since_s == 100.06


def test_an_answer_to_a_later_command_excuses_those_before_it():
    """The board lives, and hears: what it said in between got lost."""
    talk = Talk()
    _, second, _ = (talk.sent(at_s) for at_s in (100.0, 100.03, 100.06))
    talk.answered(second, 100.08)
    assert talk.unanswered_since_s == 100.06


def test_who_sends_nothing_for_long_waits_for_no_answer():
    """A computer that stood still: the newest answer is old, and nothing is missing."""
    talk = Talk()
    talk.answered(talk.sent(100.0), 100.01)
    talk.now_s = 100.5
    assert talk.unanswered_since_s is None
    talk.sent(100.5)
    assert talk.unanswered_since_s == 100.5


def heard(extras_s):
    """What the door makes of answers that take so much longer than the rig's round trip."""
    door = AnswerDoor(RIG)
    for number, extra_s in enumerate(extras_s):
        trip_s = RIG.latency.round_trip_s + extra_s
        yield door.step(Answer(replace(STATUS, sequence=number), 0, 100.0, trip_s))


@pytest.mark.parametrize(
    ("extra_s", "answers", "commands"),
    [
        (LATE_ANSWER_S - 1e-3, 0, 0),
        (LATE_ANSWER_S + 1e-3, 9, 0),
        (LATE_COMMAND_S - 1e-3, 9, 0),
        (LATE_COMMAND_S + 1e-3, 9, 9),
    ],
)
def test_late_answers_are_counted_in_a_row(extra_s, answers, commands):
    *_, last = heard([extra_s] * 9)
    assert (last.late_answers, last.late_commands) == (answers, commands)
    *_, prompt = heard([extra_s] * 9 + [0.0])
    assert (prompt.late_answers, prompt.late_commands) == (0, 0)


def test_the_same_answer_again_is_old_and_not_late_twice():
    door = AnswerDoor(RIG)
    late = Answer(STATUS, 0, 100.0, RIG.latency.round_trip_s + 0.05)
    looks = [door.step(late) for _ in range(4)]
    assert [look.repeats for look in looks] == [0, 1, 2, 3]
    assert [look.late_answers for look in looks] == [1, 1, 1, 1]
    assert [look.is_new for look in looks] == [True, False, False, False]
