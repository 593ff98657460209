"""The firmware speaks runtime/io/protocol.py's wire, byte for byte, and drops what that drops."""

import needs
import pytest
from decisions_library import (
    Board,
    CFrame,
    Decoder,
    checksum,
    encoded_by_the_firmware,
    fault_bits,
    unhurried,
)
from hypothesis import given
from hypothesis import strategies as st

from runtime.io.protocol import (
    FIRMWARE,
    PROTOCOL_VERSION,
    Arm,
    Command,
    Disarm,
    Fault,
    Frame,
    FrameDecoder,
    Hello,
    HelloReply,
    Status,
    cobs_encode,
    crc16,
    encode_frame,
    to_half_us,
)

pytestmark = needs.compiler

U8, U16, U32 = (st.integers(0, 2**n - 1) for n in (8, 16, 32))
PULSE = U16.map(lambda half: half / 2)
FROM_HOST = st.one_of(
    st.builds(Hello, U8, U8),
    st.builds(Arm, PULSE, PULSE, U32, U16, U16, U16, U32, U16, U16, U16),
    st.builds(Disarm),
    st.builds(Command, PULSE, PULSE, st.integers(-(2**15), 2**15 - 1), PULSE, PULSE),
)
FROM_BOARD = st.one_of(
    st.builds(HelloReply, U8, U8, U16, U16),
    st.builds(
        Status,
        sequence=U16, boot=U16, faults=st.integers(0, 7).map(Fault), armed=st.booleans(),
        homed=st.booleans(), source_us=PULSE, sufferer_us=PULSE,
        steps=st.integers(-(2**31), 2**31 - 1), missed=U16, malformed=U16, applied_time_us=U32,
        battery_mv=U16,
    ),
)  # fmt: skip
HOST_FRAMES = st.builds(Frame, U16, U32, FROM_HOST)
COMMAND = Frame(77, 123_456, Command(1500.5, 1712.0, -420, 1650.5, 1590.0))


def as_python(frame: CFrame) -> Frame:
    """What the firmware's decoder read, in the runtime's words."""
    payload = frame.payload
    if frame.type == Hello.TYPE:
        message = Hello(payload.hello.oldest, payload.hello.newest)
    elif frame.type == Arm.TYPE:
        low, high, *others = (getattr(payload.arm, name) for name, _ in payload.arm._fields_)
        message = Arm(low / 2, high / 2, *others)
    elif frame.type == Command.TYPE:
        asked = payload.command
        message = Command(
            asked.source_half_us / 2,
            asked.sufferer_half_us / 2,
            asked.carriage_steps_per_s,
            asked.brake_half_us / 2,
            asked.sink_half_us / 2,
        )
    else:
        assert frame.type == Disarm.TYPE
        message = Disarm()
    return Frame(frame.sequence, frame.time_us, message)


def from_host(frames):
    """The frames that a host may send; the board's own are malformed to a board."""
    return [frame for frame in frames if not isinstance(frame.message, HelloReply | Status)]


@unhurried
@given(st.binary(max_size=200))
def test_the_checksum_is_the_runtimes(data):
    assert checksum(data) == crc16(data)


@unhurried
@given(st.builds(Frame, U16, U32, FROM_BOARD))
def test_what_a_board_says_has_the_same_bytes(frame):
    assert encoded_by_the_firmware(frame) == encode_frame(frame)


@unhurried
@given(st.lists(HOST_FRAMES, max_size=5))
def test_what_a_host_says_is_read_as_it_was_meant(frames):
    decoder = Decoder()
    heard = decoder.feed(b"".join(map(encode_frame, frames)))
    assert [as_python(frame) for frame in heard] == frames
    assert decoder.dropped == 0


def test_faults_have_the_runtimes_bits():
    assert fault_bits() == [Fault.NONE, Fault.DEADMAN, Fault.WATCHDOG, Fault.BROWNOUT]


PIECES = st.one_of(
    HOST_FRAMES.map(encode_frame),
    st.builds(Frame, U16, U32, FROM_BOARD).map(encode_frame),
    st.binary(max_size=90),
    st.just(b"\0"),
    st.binary(min_size=62, max_size=66).map(lambda data: data.replace(b"\0", b"\1")),
    st.binary(max_size=40).map(lambda body: cobs_encode(body + crc16(body).to_bytes(2, "little"))),
)


@unhurried
@given(st.lists(PIECES, max_size=8), st.data())
def test_both_decoders_take_and_drop_the_same(pieces, data):
    wire = bytearray(b"".join(pieces) + b"\0")
    for _ in range(data.draw(st.integers(0, 3))):
        position = data.draw(st.integers(0, len(wire) - 1))
        wire[position] ^= data.draw(st.integers(0, 255))
    runtimes, firmwares = FrameDecoder(), Decoder()
    theirs = list(runtimes.feed(bytes(wire)))
    ours = firmwares.feed(bytes(wire))
    assert [as_python(frame) for frame in ours] == from_host(theirs)
    assert firmwares.dropped == runtimes.malformed + len(theirs) - len(ours)


@pytest.mark.parametrize("kind", [0x01, 0x02, 0x03, 0x04])
def test_a_payload_of_another_length_is_dropped_even_with_a_good_checksum(kind):
    right = {0x01: 2, 0x02: 24, 0x03: 0, 0x04: 10}[kind]
    for length in range(30):
        body = bytes([kind]) + bytes(6) + bytes(length)
        wire = cobs_encode(body + crc16(body).to_bytes(2, "little")) + b"\0"
        assert len(Decoder().feed(wire)) == (length == right)


def test_no_single_bit_error_passes():
    wire = encode_frame(COMMAND)
    for bit in range(8 * (len(wire) - 1)):
        damaged = bytearray(wire)
        damaged[bit // 8] ^= 1 << bit % 8
        assert Decoder().feed(bytes(damaged)) == []


def test_an_endless_frame_is_dropped_once_and_the_next_is_heard():
    decoder = Decoder()
    heard = decoder.feed(b"\x41" * 5000 + b"\0" + encode_frame(COMMAND))
    assert [as_python(frame) for frame in heard] == [COMMAND]
    assert decoder.dropped == 1


def test_the_count_of_dropped_frames_stays_at_its_end():
    decoder = Decoder()
    decoder.feed(b"\1\0" * 66_000)
    assert decoder.dropped == 0xFFFF


def test_the_runtimes_pulse_widths_are_the_timers_half_microseconds():
    (heard,) = Decoder().feed(encode_frame(COMMAND))
    assert heard.payload.command.source_half_us == to_half_us(1500.5) == 3001


def test_a_board_answers_in_frames_that_a_host_reads():
    (answer,) = Board().hear(encode_frame(Frame(9, 0, Hello())))
    assert answer.sequence == 9
    assert answer.message == HelloReply(
        version=PROTOCOL_VERSION, board=1, boot=1, firmware=FIRMWARE
    )
