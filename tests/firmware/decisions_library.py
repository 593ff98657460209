"""The firmware's decision code on this machine, through ctypes."""

import ctypes
import functools
import os
from ctypes import c_int, c_uint8, c_uint16, c_uint32, c_void_p
from pathlib import Path

import hypothesis
import numpy as np

from runtime.io.protocol import (
    Arm,
    Frame,
    FrameDecoder,
    Hello,
    HelloReply,
    Status,
    encode_frame,
    to_half_us,
)
from runtime.virtual.firmware_build import host_library

TICKS_PER_S = 10_000
FRAME_TICKS = 200  # 50 Hz
LIMITS = Arm(1000, 2000, 20_000, 250, 1000, 2100, 8400, 0, 0, 0)
SHORT_LADDER = Arm(1000, 2000, 2**32 - 1, 50, 100, 2100, 8400, 20, 40, 625)
AT_ONCE = Arm(1000, 2000, 2**32 - 1, 1, 1, 2**16 - 1, 2**32 - 1, 0, 0, 0)

if "WAKEDEPLOY_DECISIONS" in os.environ:  # that a mutant fails is enough, no example need be small
    hypothesis.settings.register_profile(
        "mutant", phases=[hypothesis.Phase.explicit, hypothesis.Phase.generate], derandomize=True
    )
    hypothesis.settings.load_profile("mutant")

unhurried = hypothesis.settings(deadline=None)  # the first example may have to compile

TRACE = np.dtype([("source_half_us", "u2"), ("sufferer_half_us", "u2"), ("step", "i1")], align=True)

_POINTERS = {
    "board_new": [c_uint8],
    "loop_watch_new": [],
    "decoder_new": [],
}
_OTHERS = {
    "board_delete": (None, [c_void_p]),
    "board_place": (None, [c_void_p, c_uint16, c_int, c_uint16]),
    "board_hear": (c_int, [c_void_p, c_void_p, c_int, c_uint32, c_void_p]),
    "board_run": (None, [c_void_p, c_uint32, c_uint32, c_void_p]),
    "board_is_flying": (c_int, [c_void_p]),
    "loop_watch_delete": (None, [c_void_p]),
    "loop_watch_turned": (None, [c_void_p]),
    "loop_watch_may_feed": (c_int, [c_void_p, c_int]),
    "decoder_delete": (None, [c_void_p]),
    "decoder_dropped": (c_uint16, [c_void_p]),
    "decoder_take": (c_int, [c_void_p, c_uint8, c_void_p]),
    "fault_bits": (None, [c_void_p]),
    "crc16_of": (c_uint16, [c_void_p, c_int]),
    "encode_hello_reply": (c_int, [c_uint16, c_uint32, c_void_p, c_void_p]),
    "encode_status": (c_int, [c_uint16, c_uint32, c_void_p, c_void_p]),
    "unbalanced_interrupts": (c_int, []),
}


class CHello(ctypes.Structure):
    _fields_ = [("oldest", c_uint8), ("newest", c_uint8)]


class CArm(ctypes.Structure):
    _fields_ = [
        ("low_half_us", c_uint16),
        ("high_half_us", c_uint16),
        ("slew_us_per_s", c_uint32),
        ("source_descent_ms", c_uint16),
        ("sufferer_descent_ms", c_uint16),
        ("max_speed_steps_per_s", c_uint16),
        ("max_accel_steps_per_s2", c_uint32),
        ("brake_ms", c_uint16),
        ("sink_ms", c_uint16),
        ("sink_rate_us_per_s", c_uint16),
    ]


class CCommand(ctypes.Structure):
    _fields_ = [
        ("source_half_us", c_uint16),
        ("sufferer_half_us", c_uint16),
        ("carriage_steps_per_s", ctypes.c_int16),
        ("brake_half_us", c_uint16),
        ("sink_half_us", c_uint16),
    ]


class CPayload(ctypes.Union):
    _fields_ = [("hello", CHello), ("arm", CArm), ("command", CCommand)]


class CFrame(ctypes.Structure):
    _fields_ = [
        ("type", c_uint8),
        ("sequence", c_uint16),
        ("time_us", c_uint32),
        ("payload", CPayload),
    ]


class CHelloReply(ctypes.Structure):
    _fields_ = [
        ("version", c_uint8),
        ("board", c_uint8),
        ("boot", c_uint16),
        ("firmware", c_uint16),
    ]


class CStatus(ctypes.Structure):
    _fields_ = [
        ("sequence", c_uint16),
        ("boot", c_uint16),
        ("faults", c_uint8),
        ("armed", ctypes.c_bool),
        ("homed", ctypes.c_bool),
        ("source_half_us", c_uint16),
        ("sufferer_half_us", c_uint16),
        ("steps", ctypes.c_int32),
        ("missed", c_uint16),
        ("malformed", c_uint16),
        ("applied_time_us", c_uint32),
        ("battery_mv", c_uint16),
    ]


@functools.cache
def library() -> ctypes.CDLL:
    """The compiled decisions; a mutant of them, or the build that counts lines, when asked for."""
    shim = Path(__file__).with_name("decisions.cpp")
    path = os.environ.get("WAKEDEPLOY_DECISIONS") or host_library(
        shim, coverage="WAKEDEPLOY_COUNT_LINES" in os.environ
    )
    compiled = ctypes.CDLL(str(path))
    for name, arguments in _POINTERS.items():
        getattr(compiled, name).restype = c_void_p
        getattr(compiled, name).argtypes = arguments
    for name, (result, arguments) in _OTHERS.items():
        getattr(compiled, name).restype = result
        getattr(compiled, name).argtypes = arguments
    return compiled


class Board:
    """The whole board but its pins: bytes in, answers out, time in ticks of 100 µs."""

    def __init__(self, *, reset_faults: int = 0, frame_ticks: int = FRAME_TICKS) -> None:
        self._library = library()
        self._board = self._library.board_new(reset_faults)
        self._frame_ticks = frame_ticks
        self._decoder = FrameDecoder()
        self.tick = 0

    def __del__(self) -> None:
        self._library.board_delete(self._board)

    def place(self, *, boot: int = 1, homed: bool = True, battery_mv: int = 0) -> None:
        self._library.board_place(self._board, boot, homed, battery_mv)

    def hear(self, data: bytes) -> list[Frame]:
        """The board's answers to these bytes."""
        answers = ctypes.create_string_buffer(len(data) * 5 + 64)
        written = self._library.board_hear(
            self._board, data, len(data), self.tick * 100 % 2**32, answers
        )
        return list(self._decoder.feed(answers.raw[:written]))

    def send(self, sequence: int, message) -> HelloReply | Status | None:
        answers = self.hear(encode_frame(Frame(sequence, 0, message)))
        return answers[0].message if answers else None

    def send_after_noise(self, sequence: int, message) -> HelloReply | Status | None:
        """As `send`, after a zero that ends whatever came before."""
        self.hear(b"\0")
        return self.send(sequence, message)

    def run(self, ticks: int) -> np.ndarray:
        """Let time pass; pulse widths offered and steps taken, one row a tick."""
        trace = np.zeros(ticks, dtype=TRACE)
        assert TRACE.itemsize == 6
        self._library.board_run(self._board, ticks, self._frame_ticks, trace.ctypes.data)
        self.tick += ticks
        return trace

    @property
    def is_flying(self) -> bool:
        return bool(self._library.board_is_flying(self._board))


def flying(limits: Arm = LIMITS, **board) -> Board:
    board = Board(**board)
    board.send(1, Hello())
    assert board.send(2, limits).armed
    return board


class Decoder:
    """The firmware's frame decoder alone."""

    def __init__(self) -> None:
        self._library = library()
        self._decoder = self._library.decoder_new()

    def __del__(self) -> None:
        self._library.decoder_delete(self._decoder)

    def feed(self, data: bytes) -> list[CFrame]:
        frames = []
        for byte in data:
            frame = CFrame()
            if self._library.decoder_take(self._decoder, byte, ctypes.byref(frame)):
                frames.append(frame)
        return frames

    @property
    def dropped(self) -> int:
        return self._library.decoder_dropped(self._decoder)


class LoopWatch:
    """Decides whether the chip's watchdog may be fed."""

    def __init__(self) -> None:
        self._library = library()
        self._watch = self._library.loop_watch_new()

    def __del__(self) -> None:
        self._library.loop_watch_delete(self._watch)

    def turned(self) -> None:
        self._library.loop_watch_turned(self._watch)

    def may_feed(self, *, is_flying: bool) -> bool:
        return bool(self._library.loop_watch_may_feed(self._watch, is_flying))


def encoded_by_the_firmware(frame: Frame) -> bytes:
    """A board's message, encoded by the firmware."""
    wire, message = ctypes.create_string_buffer(64), frame.message
    if isinstance(message, HelloReply):
        reply = CHelloReply(message.version, message.board, message.boot, message.firmware)
        written = library().encode_hello_reply(
            frame.sequence, frame.time_us, ctypes.byref(reply), wire
        )
    else:
        status = CStatus(
            message.sequence,
            message.boot,
            int(message.faults),
            message.armed,
            message.homed,
            to_half_us(message.source_us),
            to_half_us(message.sufferer_us),
            *(message.steps, message.missed, message.malformed),
            *(message.applied_time_us, message.battery_mv),
        )
        written = library().encode_status(frame.sequence, frame.time_us, ctypes.byref(status), wire)
    return wire.raw[:written]


def checksum(data: bytes) -> int:
    """CRC-16 as the firmware computes it."""
    return int(library().crc16_of(data, len(data)))


def fault_bits() -> list[int]:
    """None, deadman, watchdog and brownout as the firmware numbers them."""
    into = (c_uint8 * 4)()
    library().fault_bits(into)
    return list(into)
