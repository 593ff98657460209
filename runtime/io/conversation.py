"""The host's half of the protocol: greet a board, ask it, command it, hear its statuses.

In: messages, and the bytes that a board sends. Out: frames, and the newest status. What carries the
bytes and how time passes is the wire's business: a serial port (`runtime.io.link`) or a simulation
(`runtime.simulated`).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from runtime.io.protocol import (
    FIRMWARE,
    PROTOCOL_VERSION,
    SEQUENCE_WRAP,
    Arm,
    Command,
    Disarm,
    Frame,
    FrameDecoder,
    Hello,
    HelloReply,
    Message,
    Status,
    encode_frame,
)
from wakedeploy.core.errors import CheckFailed, UnusableInput

HANDSHAKE_LIMIT_S = 5.0  # opening the port reboots an UNO, which takes about 1.7 s
REBOOT_LIMIT_S = 3.0  # for a board that fell silent: its watchdog's wait and its bootloader
HELLO_PERIOD_S = 0.1
ANSWER_LIMIT_S = 0.5
SKETCH = "arduino_sketch/arduino_sketch.ino"
_REMEMBERED = 256  # commands whose sending times are kept
_FIRST_BYTES = 200  # of what comes in, kept to tell what is there if it is not the board
_QUOTED = 40


@dataclass(frozen=True, slots=True)
class Answer:
    """A status, when it arrived [s, monotonic] and how long after its question [s]."""

    status: Status
    mcu_time_us: int
    received_s: float
    round_trip_s: float


class Conversation(ABC):
    """One host and one board; a subclass sends bytes, waits, and says what time it is.

    Bytes that arrive go to `_heard`; a wire that breaks sets `_failure` to a sentence.
    """

    def __init__(self, port: str, silence: str = "") -> None:
        """`silence` is the sentence for who gets no answer, where no cable can be to blame."""
        self.port = port
        self._said_of_silence = silence
        self._decoder = FrameDecoder()
        self._sequence = 0
        self._sent_s: dict[int, float] = {}  # by sequence, oldest first
        self._reply: HelloReply | None = None
        self._first_bytes = b""
        self._echoes = 0
        self._answer: Answer | None = None
        self._last_answered: int | None = None
        self._failure: str | None = None

    @abstractmethod
    def _now_s(self) -> float:
        """The present [s]."""

    @abstractmethod
    def _transmit(self, data: bytes, message: Message) -> None:
        """Put a message's bytes on the wire without waiting."""

    def _leaves_s(self, message: Message) -> float:
        """When a message that is sent now leaves [s]."""
        return self._now_s()

    @abstractmethod
    def _wait(self, until: Callable[[], object], limit_s: float) -> None:
        """Let time pass until something is true, or for `limit_s`."""

    @property
    def failure(self) -> str | None:
        """Why nothing can be sent or received any more, as one sentence; None while all is well."""
        return self._failure

    @property
    def unanswered_since_s(self) -> float | None:
        """When the oldest frame left that neither it nor a later one was answered; None: none."""
        times_s = tuple(self._sent_s.values())  # at once: a link's thread takes answers meanwhile
        return times_s[0] if times_s else None

    @property
    def malformed(self) -> int:
        """Frames from the MCU that were dropped."""
        return self._decoder.malformed

    @property
    def answer(self) -> Answer | None:
        """The newest status."""
        return self._answer

    def handshake(self, limit_s: float = HANDSHAKE_LIMIT_S) -> HelloReply:
        """Agree on a protocol version; waits for the board to boot.

        Raises UnusableInput when nobody, something else, or another version answers.
        """
        reply = self._greeted(limit_s)
        self._require_alive(UnusableInput)
        if reply is None:
            raise UnusableInput(self._silence(limit_s))
        return _agreed(reply, self.port)

    def status(self) -> Status:
        """What the board says of itself, motors idle; CheckFailed when it stops answering."""
        return self._ask(Disarm())

    def greet_again(self, limit_s: float = REBOOT_LIMIT_S) -> Status | None:
        """The status of a board that fell silent in flight, motors idle; None if it stays silent.

        One that has restarted knows of no handshake, so that it answers nothing but a greeting.
        """
        if self._greeted(limit_s) is None:
            return None
        try:
            return self.status()
        except CheckFailed:
            return None

    def arm(self, limits: Arm) -> Status:
        """Switch the MCU's outputs on; CheckFailed when it refuses."""
        status = self._ask(limits)
        if not status.armed:
            raise CheckFailed(
                f"{self.port}: the board refused to arm (fault {status.faults!r}); unplug and "
                "replug it, then start again."
            )
        return status

    def disarm(self) -> None:
        """Motors to idle at once; quiet when the port is gone, for then the deadman does it."""
        if self._failure is None:
            try:
                self._ask(Disarm())
            except CheckFailed:
                return

    def send(self, command: Command) -> int:
        """Send a command and return its sequence number; a port that is gone shows in `failure`."""
        return self._send(command)

    def wait_for(self, sequence: int, limit_s: float) -> Answer | None:
        """The answer to a frame, or None when it does not come within `limit_s`."""
        self._wait(lambda: self._last_answered == sequence or self._failure, limit_s)
        return self._answer if self._last_answered == sequence else None

    def _greeted(self, limit_s: float) -> HelloReply | None:
        """The reply to one of the greetings sent until then; None without any."""
        deadline_s = self._now_s() + limit_s
        self._reply = None
        while self._now_s() < deadline_s and not (self._reply or self._failure):
            self._send(Hello())
            self._wait(lambda: self._reply or self._failure, HELLO_PERIOD_S)
        return self._reply

    def _ask(self, message: Message) -> Status:
        answer = self.wait_for(self._send(message), ANSWER_LIMIT_S)
        self._require_alive(CheckFailed)
        if answer is None:
            raise CheckFailed(
                self._said_of_silence
                or f"{self.port}: the board stopped answering; check the cable."
            )
        return answer.status

    def _send(self, message: Message) -> int:
        self._sequence = (self._sequence + 1) % SEQUENCE_WRAP
        leaves_s = self._leaves_s(message)
        self._sent_s[self._sequence] = leaves_s  # before the answer can be there
        if len(self._sent_s) > _REMEMBERED:
            del self._sent_s[next(iter(self._sent_s))]
        if self._failure is None:
            frame = Frame(self._sequence, int(leaves_s * 1e6), message)
            self._transmit(encode_frame(frame), message)
        return self._sequence

    def _heard(self, data: bytes, now_s: float) -> None:
        """Bytes that came from the board."""
        if len(self._first_bytes) < _FIRST_BYTES:
            self._first_bytes += data[:_FIRST_BYTES]
        for frame in self._decoder.feed(data):
            self._take(frame, now_s)

    def _take(self, frame: Frame, now_s: float) -> None:
        if isinstance(frame.message, HelloReply):
            self._reply = frame.message
        elif isinstance(frame.message, Status):
            if not self._is_overtaken(frame.sequence):
                trip_s = now_s - self._answered(frame.sequence)
                self._answer = Answer(frame.message, frame.time_us, now_s, trip_s)
                self._last_answered = frame.sequence
        else:
            self._echoes += 1  # no board says what only a host does

    def _is_overtaken(self, sequence: int) -> bool:
        """Whether a later frame has been answered already."""
        if self._last_answered is None:
            return False
        return (sequence - self._last_answered) % SEQUENCE_WRAP > SEQUENCE_WRAP // 2

    def _answered(self, sequence: int) -> float:
        """When the frame left [s], NaN where that is not known; it and older ones are done with."""
        sent_s = self._sent_s.get(sequence, float("nan"))
        for older in tuple(self._sent_s):
            if (sequence - older) % SEQUENCE_WRAP < SEQUENCE_WRAP // 2:
                del self._sent_s[older]
        return sent_s

    def _require_alive(self, kind: type[CheckFailed] | type[UnusableInput]) -> None:
        if self._failure is not None:
            raise kind(self._failure)

    def _silence(self, limit_s: float) -> str:
        """What is there instead of the board, and what to do about it."""
        if self._echoes:
            return (
                f"{self.port}: what is there sends back what it is sent, as a modem does, and does "
                "not speak wakedeploy's protocol; name the UNO's port ('wakedeploy doctor' lists "
                "them)."
            )
        if self._decoder.bytes_seen:
            return (
                f"{self.port}: what answers does not speak wakedeploy's protocol "
                f"({_quoted(self._first_bytes)}, no valid frame in {limit_s:g} s); check that it "
                f"is the UNO, and upload {SKETCH} to it."
            )
        return self._said_of_silence or (
            f"{self.port}: nothing answered within {limit_s:g} s; check the cable and that it is "
            f"the UNO, and upload {SKETCH} to it."
        )


def _quoted(data: bytes) -> str:
    """What was heard, as a person can read it: text where it is text, else its size."""
    text = " ".join(data.decode("ascii", "replace").split())
    if text and text.isprintable() and "\ufffd" not in text:
        return f"it says '{text[:_QUOTED]}'" + ("…" if len(text) > _QUOTED else "")
    return f"it sends other bytes, 0x{data[:4].hex()} first"


def _agreed(reply: HelloReply, port: str) -> HelloReply:
    if reply.version != PROTOCOL_VERSION:
        said = f"answers in version {reply.version}" if reply.version else "speaks another version"
        raise UnusableInput(
            f"{port}: the board's firmware {reply.firmware} {said} of the protocol, and this "
            f"wakedeploy speaks version {PROTOCOL_VERSION}; upload the sketch that belongs to it, "
            f"{SKETCH}."
        )
    if reply.firmware != FIRMWARE:
        raise UnusableInput(
            f"{port}: the board runs firmware {reply.firmware}, and firmware {FIRMWARE} belongs to "
            f"this wakedeploy; upload its sketch, {SKETCH}."
        )
    return reply
