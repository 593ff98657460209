"""Frames that come twice, late or from elsewhere, and bytes that are no frame: counted, no more."""

import random

import needs
import pytest
from decisions_library import AT_ONCE, LIMITS, TICKS_PER_S, Board, flying

from runtime.io.protocol import PROTOCOL_VERSION, SEQUENCE_WRAP, Command, Disarm, Fault, Hello

pytestmark = needs.compiler


def test_duplicated_and_overtaken_frames_are_counted():
    board = flying()
    assert board.send(2, Command(1500, 1500, 0, 1000, 1000)) is None
    assert board.send(1, Command(1500, 1500, 0, 1000, 1000)) is None
    assert board.send(2 + SEQUENCE_WRAP // 2, Command(1500, 1500, 0, 1000, 1000)) is None
    assert board.send(1 + SEQUENCE_WRAP // 2, Disarm()).malformed == 3


def test_a_hello_in_flight_is_counted_and_changes_nothing():
    board = flying(AT_ONCE)
    board.send(3, Command(1800, 1700, 10_000, 1000, 1000))
    for sequence in (1, 4, 50):  # the handshake's own again, the next one, one from elsewhere
        assert board.send(sequence, Hello()) is None
        still = board.run(100)
        assert set(still["source_half_us"]) == {3600}
        assert (still["step"] == 1).all()
    status = board.send(4, Command(1800, 1700, 0, 1000, 1000))
    assert (status.armed, status.malformed) == (True, 3)


def test_a_hello_neither_feeds_the_deadman_nor_cuts_its_ramp():
    board = flying()
    board.send(3, Command(1000, 2000, 0, 1000, 1000))
    board.run(1251)
    for _ in range(9):
        assert board.send(1, Hello()) is None
        board.run(1000)
    assert 2000 < board.run(1)["sufferer_half_us"][0] < 2400  # nine tenths of the way down
    board.run(1000)
    assert not board.is_flying
    assert board.send(1, Hello()).version == PROTOCOL_VERSION


@pytest.mark.parametrize("opening", [[], [Hello()]])
def test_a_hundred_thousand_random_bytes_move_nothing(opening):
    board, rng = Board(), random.Random(len(opening))
    for number, message in enumerate(opening):
        board.send(1 + number, message)
    for _ in range(1000):
        board.hear(rng.randbytes(100))
        trace = board.run(40)  # as long as the bytes take on the wire
        assert set(trace["source_half_us"]) == set(trace["sufferer_half_us"]) == {2000}
        assert not trace["step"].any()
    board.hear(b"\0")
    board.send(9, Hello())
    assert board.send(10, LIMITS).malformed > 100


def test_a_hundred_thousand_random_bytes_between_commands_change_no_pulse_and_no_step():
    board, rng, travelled, stepped = flying(AT_ONCE), random.Random(3), 0, 0
    for number in range(1000):
        board.hear(rng.randbytes(50))
        status = board.send_after_noise(3 + number, Command(1400, 1400, 2000, 1000, 1000))
        assert status.armed
        board.hear(rng.randbytes(50))
        trace = board.run(100)
        assert set(trace["source_half_us"]) == set(trace["sufferer_half_us"]) == {2800}
        stepped += int(trace["step"].sum())
        travelled += 2000 * 100
        assert stepped == travelled // TICKS_PER_S
    assert (status.faults, status.missed) == (Fault.NONE, 0)
    assert status.malformed > 300
