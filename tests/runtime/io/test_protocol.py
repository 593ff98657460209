"""The wire: published check values, round trips, and that nothing broken is ever accepted."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.io.protocol import (
    MAX_FRAME_BYTES,
    Arm,
    Command,
    Disarm,
    Fault,
    Frame,
    FrameDecoder,
    Hello,
    HelloReply,
    MalformedFrame,
    Status,
    cobs_decode,
    cobs_encode,
    crc16,
    decode_frame,
    encode_frame,
)

U8, U16, U32 = (st.integers(0, 2**n - 1) for n in (8, 16, 32))
PULSE = st.integers(0, 2**16 - 1).map(lambda half: half / 2)
MESSAGES = st.one_of(
    st.builds(Hello, U8, U8),
    st.builds(HelloReply, U8, U8, U16, U16),
    st.builds(Arm, PULSE, PULSE, U32, U16, U16, U16, U32, U16, U16, U16),
    st.builds(Disarm),
    st.builds(Command, PULSE, PULSE, st.integers(-(2**15), 2**15 - 1), PULSE, PULSE),
    st.builds(
        Status,
        sequence=U16,
        boot=U16,
        faults=st.integers(0, 7).map(Fault),
        armed=st.booleans(),
        homed=st.booleans(),
        source_us=PULSE,
        sufferer_us=PULSE,
        steps=st.integers(-(2**31), 2**31 - 1),
        missed=U16,
        malformed=U16,
        applied_time_us=U32,
        battery_mv=U16,
    ),
)
FRAMES = st.builds(Frame, U16, U32, MESSAGES)
COMMAND = Frame(77, 123_456, Command(1500.5, 1712.0, -420, 1650.5, 1590.0))


def test_the_checksum_has_its_published_check_value():
    assert crc16(b"123456789") == 0x29B1  # CRC-16/CCITT-FALSE in the catalogue of CRC algorithms


@given(st.binary(max_size=80))
def test_the_checksum_agrees_with_long_division(data):
    register = 0xFFFF
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1) ^ (0x1021 if register & 0x8000 else 0)
        register &= 0xFFFF
    assert crc16(data) == register


# The examples of Cheshire and Baker's encoding as Wikipedia lists them.
COBS_EXAMPLES = [
    ("00", "0101"),
    ("0000", "010101"),
    ("00110000", "0102110101"),
    ("11220033", "0311220233"),
    ("11223344", "0511223344"),
    ("11000000", "0211010101"),
    (bytes(range(1, 255)).hex(), "ff" + bytes(range(1, 255)).hex()),
    (bytes(range(255)).hex(), "01ff" + bytes(range(1, 255)).hex()),
    (bytes(range(1, 256)).hex(), "ff" + bytes(range(1, 255)).hex() + "02ff"),
    (bytes([*range(2, 256), 0]).hex(), "ff" + bytes(range(2, 256)).hex() + "0101"),
    (bytes([*range(3, 256), 0, 1]).hex(), "fe" + bytes(range(3, 256)).hex() + "0201"),
]


@pytest.mark.parametrize(("plain", "stuffed"), COBS_EXAMPLES)
def test_byte_stuffing_has_its_published_examples(plain, stuffed):
    assert cobs_encode(bytes.fromhex(plain)).hex() == stuffed
    assert cobs_decode(bytes.fromhex(stuffed)).hex() == plain


@given(st.binary(max_size=1200))
def test_byte_stuffing_comes_back_and_holds_no_zero(data):
    stuffed = cobs_encode(data)
    assert 0 not in stuffed
    assert len(stuffed) <= len(data) + len(data) // 254 + 1
    assert cobs_decode(stuffed) == data


@given(FRAMES)
def test_every_frame_comes_back_and_fits_the_receive_buffer(frame):
    encoded = encode_frame(frame)
    assert len(encoded) <= MAX_FRAME_BYTES
    assert decode_frame(encoded[:-1]) == frame


@given(st.lists(FRAMES, max_size=5), st.lists(st.integers(1, 40), min_size=1, max_size=8))
def test_frames_arrive_whole_however_the_bytes_are_cut(frames, cuts):
    wire, decoder, got = b"".join(map(encode_frame, frames)), FrameDecoder(), []
    while wire:
        for cut in cuts:
            got += decoder.feed(wire[:cut])
            wire = wire[cut:]
    assert got == frames
    assert decoder.malformed == 0


@given(st.lists(st.binary(max_size=300), max_size=6))
def test_random_bytes_never_raise_and_a_good_frame_after_them_is_heard(chunks):
    decoder = FrameDecoder()
    for chunk in chunks:
        list(decoder.feed(chunk))
    list(decoder.feed(b"\0"))
    assert list(decoder.feed(encode_frame(COMMAND))) == [COMMAND]


@given(FRAMES, st.data())
def test_a_corrupted_frame_is_never_accepted_as_another(frame, data):
    wire = bytearray(encode_frame(frame))
    position = data.draw(st.integers(0, len(wire) - 2))
    wire[position] ^= data.draw(st.integers(1, 255))
    decoder = FrameDecoder()
    assert list(decoder.feed(bytes(wire))) == []
    assert decoder.malformed >= 1


def test_no_single_or_double_bit_error_passes():
    wire = encode_frame(COMMAND)[:-1]
    bits = range(8 * len(wire))
    for first in bits:
        for second in bits[first:]:
            damaged = bytearray(wire)
            damaged[first // 8] ^= 1 << first % 8
            if second != first:
                damaged[second // 8] ^= 1 << second % 8
            if 0 in damaged:
                continue  # the decoder sees two shorter pieces; the test above covers those
            with pytest.raises(MalformedFrame):
                decode_frame(bytes(damaged))


def test_a_missing_end_costs_one_frame_and_an_endless_one_is_dropped_once():
    decoder = FrameDecoder()
    wire = encode_frame(COMMAND)
    assert list(decoder.feed(wire[:-1] + wire + wire)) == [COMMAND]
    assert decoder.malformed == 1
    assert list(decoder.feed(b"\x41" * 5000 + b"\0" + wire)) == [COMMAND]
    assert decoder.malformed == 2


def test_an_unknown_type_or_a_wrong_length_is_malformed_even_with_a_good_checksum():
    for body in (b"\x7f" + bytes(6), b"\x04" + bytes(6), b"\x04" + bytes(13)):
        with pytest.raises(MalformedFrame):
            decode_frame(cobs_encode(body + crc16(body).to_bytes(2, "little")))


def test_pulse_widths_travel_in_half_microseconds():
    back = decode_frame(
        encode_frame(Frame(1, 2, Command(1500.26, 1499.74, 3, 1400.2, 1399.8)))[:-1]
    )
    assert back.message == Command(1500.5, 1499.5, 3, 1400.0, 1400.0)
