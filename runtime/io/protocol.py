"""The wire between Pi and UNO: COBS frames with a type, a sequence, a time, a payload and a CRC.

A frame before COBS, little-endian: type u8, sequence u16, sender's time u32 [µs], payload,
CRC-16/CCITT u16 over everything before it. After COBS a zero byte ends it. Pulse widths travel in
half microseconds, the resolution of Timer1 on the UNO.
"""

import binascii
import enum
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

PROTOCOL_VERSION = 2
FIRMWARE = 4  # of the sketch that belongs to this wakedeploy, arduino_sketch/session.h
BAUD = 250_000  # exact on a 16 MHz UNO (115,200 is off by 2 %), 40 µs a byte
MAX_FRAME_BYTES = 64  # with its ending zero; the UNO's receive buffer holds this many
SHORTEST_PULSE_US, LONGEST_PULSE_US = 500.0, 2500.0  # beyond these no ESC understands a pulse
TIME_WRAP_US = 1 << 32
SEQUENCE_WRAP = 1 << 16

_HEADER = struct.Struct("<BHI")
_CRC = struct.Struct("<H")


class FrameType(enum.IntEnum):
    """What a frame says; the UNO's answers have the high bit set."""

    HELLO = 0x01
    ARM = 0x02
    DISARM = 0x03
    COMMAND = 0x04
    HELLO_REPLY = 0x81
    STATUS = 0x84


class Fault(enum.IntFlag):
    """The MCU's fault latch; only arming clears it."""

    NONE = 0
    DEADMAN = 1
    WATCHDOG = 2
    BROWNOUT = 4


class Board(enum.IntEnum):
    """Who answers at the other end."""

    VIRTUAL = 0
    UNO = 1


class MalformedFrame(Exception):
    """Bytes that are no valid frame; the decoder drops and counts them."""


@dataclass(frozen=True)
class Hello:
    """Host → MCU: the protocol versions that the host speaks."""

    TYPE: ClassVar[FrameType] = FrameType.HELLO
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BB")
    oldest: int = PROTOCOL_VERSION
    newest: int = PROTOCOL_VERSION

    def pack(self) -> bytes:
        """The payload's bytes."""
        return self.LAYOUT.pack(self.oldest, self.newest)

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Read from a payload of the right length."""
        return cls(*cls.LAYOUT.unpack(payload))


@dataclass(frozen=True)
class HelloReply:
    """MCU → host: the version chosen (0: none fits), the board, its boot counter and firmware."""

    TYPE: ClassVar[FrameType] = FrameType.HELLO_REPLY
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBHH")
    version: int
    board: int
    boot: int
    firmware: int

    def pack(self) -> bytes:
        """The payload's bytes."""
        return self.LAYOUT.pack(self.version, self.board, self.boot, self.firmware)

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Read from a payload of the right length."""
        return cls(*cls.LAYOUT.unpack(payload))


@dataclass(frozen=True)
class Arm:
    """Host → MCU: switch the outputs on, within these limits; valid once after a handshake.

    The period is not among them: the deadman counts the MCU's own, which no host can stretch. Of
    16 bits each, the times of a descent without commands can make no MCU's arithmetic overflow.
    """

    TYPE: ClassVar[FrameType] = FrameType.ARM
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<HHIHHHIHHH")
    low_us: float
    high_us: float
    slew_us_per_s: int
    source_descent_ms: int
    sufferer_descent_ms: int
    max_speed_steps_per_s: int
    max_accel_steps_per_s2: int
    brake_ms: int  # how long a descent without commands brakes, then sinks
    sink_ms: int
    sink_rate_us_per_s: int  # how fast the sink pulse is taken back

    def pack(self) -> bytes:
        """The payload's bytes."""
        return self.LAYOUT.pack(
            to_half_us(self.low_us),
            to_half_us(self.high_us),
            self.slew_us_per_s,
            self.source_descent_ms,
            self.sufferer_descent_ms,
            self.max_speed_steps_per_s,
            self.max_accel_steps_per_s2,
            self.brake_ms,
            self.sink_ms,
            self.sink_rate_us_per_s,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Read from a payload of the right length."""
        low, high, *others = cls.LAYOUT.unpack(payload)
        return cls(low / 2, high / 2, *others)

    @property
    def is_usable(self) -> bool:
        """Whether an MCU may arm with them: pulses for an ESC, and descents that take time."""
        descents_ms = (self.source_descent_ms, self.sufferer_descent_ms)
        is_range = SHORTEST_PULSE_US <= self.low_us < self.high_us <= LONGEST_PULSE_US
        return is_range and min(descents_ms) > 0


@dataclass(frozen=True)
class Disarm:
    """Host → MCU: both motors to idle at once, carriage stopped."""

    TYPE: ClassVar[FrameType] = FrameType.DISARM
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def pack(self) -> bytes:
        """The payload's bytes: none."""
        return b""

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Read from an empty payload."""
        cls.LAYOUT.unpack(payload)
        return cls()


@dataclass(frozen=True)
class Command:
    """Host → MCU: pulse widths [µs] and carriage speed [steps/s] for the next period.

    The last two are the sufferer's, for a descent should no other command come.
    """

    TYPE: ClassVar[FrameType] = FrameType.COMMAND
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<HHhHH")
    source_us: float
    sufferer_us: float
    carriage_steps_per_s: int
    brake_us: float
    sink_us: float

    def pack(self) -> bytes:
        """The payload's bytes."""
        return self.LAYOUT.pack(
            to_half_us(self.source_us),
            to_half_us(self.sufferer_us),
            self.carriage_steps_per_s,
            to_half_us(self.brake_us),
            to_half_us(self.sink_us),
        )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Read from a payload of the right length."""
        source, sufferer, steps, brake, sink = cls.LAYOUT.unpack(payload)
        return cls(source / 2, sufferer / 2, steps, brake / 2, sink / 2)


@dataclass(frozen=True)
class Status:
    """MCU → host, after every frame it accepted: what it did and what it knows."""

    TYPE: ClassVar[FrameType] = FrameType.STATUS
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<HHBBHHiHHIH")
    sequence: int  # of the last command accepted
    boot: int
    faults: Fault
    armed: bool
    homed: bool
    source_us: float  # pulse widths now on the pins
    sufferer_us: float
    steps: int
    missed: int  # command periods that passed without a command
    malformed: int  # frames dropped by the MCU
    applied_time_us: int  # MCU time at which the newest pulse widths reached the pins
    battery_mv: int  # 0: not measured

    def pack(self) -> bytes:
        """The payload's bytes."""
        return self.LAYOUT.pack(
            self.sequence,
            self.boot,
            int(self.faults),
            int(self.armed) | int(self.homed) << 1,
            to_half_us(self.source_us),
            to_half_us(self.sufferer_us),
            self.steps,
            self.missed,
            self.malformed,
            self.applied_time_us,
            self.battery_mv,
        )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        """Read from a payload of the right length."""
        sequence, boot, faults, flags, source, sufferer, *others = cls.LAYOUT.unpack(payload)
        armed, homed = bool(flags & 1), bool(flags & 2)
        return cls(sequence, boot, Fault(faults), armed, homed, source / 2, sufferer / 2, *others)


Message = Hello | HelloReply | Arm | Disarm | Command | Status
_MESSAGES: dict[int, type[Message]] = {
    kind.TYPE: kind for kind in (Hello, HelloReply, Arm, Disarm, Command, Status)
}


@dataclass(frozen=True)
class Frame:
    """One message with its sequence number and its sender's time [µs, modulo 2³²]."""

    sequence: int
    time_us: int
    message: Message


def to_half_us(pulse_us: float) -> int:
    """A pulse width [µs] in the wire's unit of half microseconds, rounded."""
    return round(2 * pulse_us)


def crc16(data: bytes) -> int:
    """CRC-16/CCITT: polynomial 0x1021, start 0xFFFF, not reflected (check value 0x29B1)."""
    return binascii.crc_hqx(data, 0xFFFF)


def cobs_encode(data: bytes) -> bytes:
    """Consistent overhead byte stuffing (Cheshire and Baker 1999), without the ending zero."""
    encoded = bytearray()
    blocks = data.split(b"\0")
    for index, block in enumerate(blocks):
        while len(block) >= 254:
            encoded += b"\xff" + block[:254]
            block = block[254:]
            if not block and index == len(blocks) - 1:
                return bytes(encoded)
        encoded.append(len(block) + 1)
        encoded += block
    return bytes(encoded)


def cobs_decode(encoded: bytes) -> bytes:
    """The bytes that `cobs_encode` was given; MalformedFrame when there are none."""
    data = bytearray()
    position = 0
    while position < len(encoded):
        code = encoded[position]
        end = position + code
        if code == 0 or end > len(encoded) or 0 in encoded[position + 1 : end]:
            raise MalformedFrame("not a COBS block")
        data += encoded[position + 1 : end]
        if code < 0xFF and end < len(encoded):
            data.append(0)
        position = end
    return bytes(data)


def encode_frame(frame: Frame) -> bytes:
    """The bytes of a frame on the wire, ending zero included."""
    header = _HEADER.pack(
        frame.message.TYPE, frame.sequence % SEQUENCE_WRAP, frame.time_us % TIME_WRAP_US
    )
    body = header + frame.message.pack()
    return cobs_encode(body + _CRC.pack(crc16(body))) + b"\0"


def decode_frame(encoded: bytes) -> Frame:
    """The frame in the bytes between two zeros; MalformedFrame for anything else."""
    body = cobs_decode(encoded)
    if len(body) < _HEADER.size + _CRC.size:
        raise MalformedFrame("too short")
    if crc16(body[:-2]) != _CRC.unpack(body[-2:])[0]:
        raise MalformedFrame("checksum")
    kind, sequence, time_us = _HEADER.unpack_from(body)
    message = _MESSAGES.get(kind)
    payload = body[_HEADER.size : -_CRC.size]
    if message is None or len(payload) != message.LAYOUT.size:
        raise MalformedFrame("unknown type or length")
    return Frame(sequence, time_us, message.unpack(payload))


class FrameDecoder:
    """Takes bytes as they arrive, gives whole frames, drops and counts everything else."""

    def __init__(self) -> None:
        self.malformed = 0
        self.bytes_seen = 0
        self._pending = bytearray()
        self._oversized = False

    def feed(self, data: bytes) -> Iterator[Frame]:
        """Frames completed by these bytes, in order; what follows the last zero is kept."""
        self.bytes_seen += len(data)
        *whole, rest = data.split(b"\0")
        for piece in whole:
            yield from self._complete(piece)
        self._keep(rest)

    def _complete(self, piece: bytes) -> Iterator[Frame]:
        self._keep(piece)
        encoded, oversized = bytes(self._pending), self._oversized
        self._pending.clear()
        self._oversized = False
        if not encoded and not oversized:
            return  # zeros in a row separate nothing
        try:
            if oversized:
                raise MalformedFrame("too long")
            yield decode_frame(encoded)
        except MalformedFrame:
            self.malformed += 1

    def _keep(self, piece: bytes) -> None:
        if len(self._pending) + len(piece) >= MAX_FRAME_BYTES:
            self._oversized = True
            self._pending.clear()
        elif not self._oversized:
            self._pending += piece
