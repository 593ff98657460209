"""What the link says when the other end is not the board it expects, over real pseudo-terminals."""

import os
import threading
import time

import pytest
from far_end import FarEnd

from runtime.io.board import met_board
from runtime.io.link import Link
from runtime.io.protocol import (
    FIRMWARE,
    PROTOCOL_VERSION,
    Board,
    Command,
    Fault,
    Frame,
    FrameDecoder,
    Hello,
    HelloReply,
    Status,
    encode_frame,
)
from wakedeploy.core.errors import UnusableInput

IDLE = Status(1, 7, Fault.NONE, False, True, 1000.0, 1000.0, 0, 0, 0, 0, 0)


@pytest.fixture
def far_end():
    opened = []

    def make(answer):
        opened.append(FarEnd(answer))
        return opened[-1]

    yield make
    for end in opened:
        end.close()


def test_a_board_that_is_gone_answers_at_no_later_port() -> None:
    """The kernel gives the next port the same file number, and a board may just be answering."""
    asked = threading.Event()

    def slowly(_):
        asked.set()
        time.sleep(0.05)
        return b"of the board that is gone"

    first = FarEnd(slowly)
    port = os.open(first.name, os.O_RDWR | os.O_NOCTTY)
    os.write(port, b"?")
    assert asked.wait(10.0)
    os.close(port)
    first.close()
    second = FarEnd(lambda _: b"of the next")
    port = os.open(second.name, os.O_RDWR | os.O_NOCTTY)
    time.sleep(0.1)
    os.write(port, b"?")
    assert os.read(port, 64) == b"of the next"
    os.close(port)
    second.close()


def test_a_silent_port_is_told_apart_from_one_that_answers_garbage(far_end):
    for answer, words in ((b"", "nothing answered"), (b"ok\r\n>", "does not speak")):
        end = far_end(lambda _, answer=answer: answer)
        with Link(end.name) as link, pytest.raises(UnusableInput, match=words):
            link.handshake(limit_s=0.4)


def test_what_is_there_instead_of_the_board_is_told(far_end):
    said = {
        "nothing answered": lambda data: b"",
        "sends back what it is sent": lambda data: data,
        "it says 'AT ERROR": lambda data: b"\r\nAT\r\nERROR\r\n",
        "other bytes, 0xff80fe01 first": lambda data: b"\xff\x80\xfe\x01",
    }
    for words, answer in said.items():
        end = far_end(answer)
        with Link(end.name) as link, pytest.raises(UnusableInput) as caught:
            link.handshake(limit_s=0.3)
        assert words in str(caught.value)
        assert str(caught.value).startswith(end.name)
        assert "the UNO" in str(caught.value)


def test_firmware_of_another_version_is_refused(far_end):
    def answer(data):
        (frame,) = FrameDecoder().feed(data)
        assert isinstance(frame.message, Hello)
        return encode_frame(Frame(frame.sequence, 0, HelloReply(0, 1, 1, 9)))

    with (
        Link(far_end(answer).name) as link,
        pytest.raises(UnusableInput, match="upload the sketch") as caught,
    ):
        link.handshake()
    assert "firmware 9 speaks another version" in str(caught.value)
    assert f"this wakedeploy speaks version {PROTOCOL_VERSION}" in str(caught.value)


def test_a_board_that_answers_in_a_version_not_asked_for_is_refused_by_number(far_end):
    reply = encode_frame(Frame(1, 0, HelloReply(3, 1, 1, 12)))
    with (
        Link(far_end(lambda _: reply).name) as link,
        pytest.raises(
            UnusableInput,
            match=rf"firmware 12 answers in version 3 .* speaks version {PROTOCOL_VERSION}",
        ),
    ):
        link.handshake()


def test_a_sketch_of_another_number_is_refused(far_end):
    reply = encode_frame(Frame(1, 0, HelloReply(PROTOCOL_VERSION, 1, 1, FIRMWARE - 1)))
    words = rf"runs firmware {FIRMWARE - 1}, and firmware {FIRMWARE} belongs .* upload its sketch"
    with Link(far_end(lambda _: reply).name) as link, pytest.raises(UnusableInput, match=words):
        link.handshake()


def test_a_board_that_is_no_uno_flies_no_rig(far_end):
    def answering(board):
        def answer(data):
            said = b""
            for frame in FrameDecoder().feed(data):
                hello = isinstance(frame.message, Hello)
                message = HelloReply(PROTOCOL_VERSION, board, 7, FIRMWARE) if hello else IDLE
                said += encode_frame(Frame(frame.sequence, 0, message))
            return said

        return far_end(answer).name

    with Link(answering(Board.UNO)) as link:
        met = met_board(link, may_be_virtual=False)
        assert met.metadata == {
            "board": "uno",
            "firmware": str(FIRMWARE),
            "board_boot": "7",
            "board_faults": "",
        }
    with Link(answering(Board.VIRTUAL)) as link:
        assert met_board(link, may_be_virtual=True).metadata["board"] == "virtual"
    for board, words in ((Board.VIRTUAL, "a virtual board answers"), (9, "board 9 answers")):
        with (
            Link(answering(board)) as link,
            pytest.raises(UnusableInput, match=words),
        ):
            met_board(link, may_be_virtual=False)
    with Link(answering(9)) as link, pytest.raises(UnusableInput, match="board 9"):
        met_board(link, may_be_virtual=True)


def test_a_port_in_use_a_missing_one_and_a_file_are_refused(far_end, tmp_path):
    end = far_end(lambda _: b"")
    with Link(end.name), pytest.raises(UnusableInput, match="used by another program"):
        Link(end.name)
    with pytest.raises(UnusableInput, match="no such port"):
        Link("/dev/ttyACM97")
    plain = tmp_path / "file"
    plain.write_text("not a port")
    with pytest.raises(UnusableInput, match="cannot be used as a serial port"):
        Link(str(plain))


def test_a_port_that_takes_no_more_bytes_is_a_lost_connection_not_a_hang():
    master, slave = os.openpty()
    try:
        with Link(os.ttyname(slave)) as link:
            for _ in range(100_000):
                link.send(Command(1000.0, 1000.0, 0, 1000, 1000))
                if link.failure:
                    break
            assert "connection to the board was lost" in link.failure
    finally:
        os.close(slave)
        os.close(master)


def test_garbage_is_counted_and_kept_out(far_end):
    end = far_end(lambda _: b"\x05\x01\x02\0\x09abc\0")
    with Link(end.name) as link:
        with pytest.raises(UnusableInput):
            link.handshake(limit_s=0.3)
        assert link.malformed >= 2
        assert link.answer is None
