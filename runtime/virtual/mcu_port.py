"""The UNO's end of the wire: frames to the MCU's decisions and back, reboot included."""

import math
from collections import deque

from runtime.io.protocol import (
    FIRMWARE,
    PROTOCOL_VERSION,
    SEQUENCE_WRAP,
    TIME_WRAP_US,
    Arm,
    Board,
    Command,
    Disarm,
    Fault,
    Frame,
    FrameDecoder,
    Hello,
    HelloReply,
    Message,
    Status,
    encode_frame,
)
from runtime.virtual.mcu import Mcu, McuStatus, Outputs
from wakedeploy.core.rig import Rig
from wakedeploy.physics.gantry import GantryPlant

BOOT_S = 1.7  # an UNO's bootloader, from opening the port
HOME_SWITCH_M = 1e-3
BATTERY_V = 11.1  # what a rig with a divider measures here: three cells that never sag


class McuPort:
    """Takes bytes, drives the MCU, answers with bytes. Times are the plant's [s]."""

    def __init__(self, rig: Rig, *, boot_s: float = BOOT_S) -> None:
        self._rig, self._boot_s = rig, boot_s
        # The command's half of the round trip; sensing, the other half, is in the plant.
        self._delay_s = 0.5 * rig.latency.round_trip_s
        self._mcu = Mcu(rig)
        self._boots = 0
        self._started_s = 0.0
        self._under_way: deque[tuple[float, Frame]] = deque()
        self._restart()

    def opened(self, t_s: float) -> None:
        """The port was opened, which resets an UNO."""
        self._boots += 1
        self._started_s = t_s + self._boot_s
        self._restart()

    def receive(self, t_s: float, data: bytes, *, at_once: bool = False) -> None:
        """Bytes from the host; whatever comes while the bootloader runs is lost.

        They take the command's half of the round trip, unless they are there `at_once`.
        """
        if t_s < self._started_s:
            return
        for frame in self._decoder.feed(data):
            self._under_way.append((t_s + (0.0 if at_once else self._delay_s), frame))

    @property
    def due_s(self) -> float:
        """When the next frame arrives; infinite while none is under way."""
        return self._under_way[0][0] if self._under_way else math.inf

    def answer(self, t_s: float, plant: GantryPlant) -> bytes:
        """Act on the frames that have arrived by now; the answers to them."""
        answers = b""
        while self._under_way and self._under_way[0][0] <= t_s:
            arrived_s, frame = self._under_way.popleft()
            message = self._act(arrived_s, frame, plant)
            if message is not None:
                answers += encode_frame(Frame(frame.sequence, self._mcu_time(t_s), message))
        return answers

    def advance(self, t_s: float, dt_s: float) -> Outputs:
        """What the pins do over the next step."""
        return self._mcu.advance(t_s, dt_s)

    def _restart(self) -> None:
        self._mcu = Mcu(self._rig)
        self._decoder = FrameDecoder()
        self._under_way.clear()
        self._last_sequence: int | None = None
        self._refused = 0
        self._may_arm = False

    def _act(self, t_s: float, frame: Frame, plant: GantryPlant) -> Message | None:
        message = frame.message
        is_flying = self._mcu.status.armed and not self._mcu.status.latched
        if isinstance(message, Hello) and not is_flying:
            return self._hello(frame.sequence, message)
        # Echoed, duplicated, overtaken, or before a handshake; a HELLO in flight is an old one.
        if isinstance(message, Hello | HelloReply | Status) or not self._is_new(frame.sequence):
            self._refused += 1
            return None
        self._last_sequence = frame.sequence
        if isinstance(message, Command):
            self._command(t_s, message)
        elif isinstance(message, Arm) and self._may_arm and message.is_usable:
            self._arm(t_s, message)
        elif isinstance(message, Disarm):
            self._mcu.disarm()
        return self._status(plant)

    def _command(self, t_s: float, asked: Command) -> None:
        speed_mps = asked.carriage_steps_per_s / self._rig.stepper.steps_per_m
        blind = asked.brake_us, asked.sink_us
        self._mcu.command(t_s, asked.source_us, asked.sufferer_us, speed_mps, *blind)

    def _hello(self, sequence: int, hello: Hello) -> HelloReply:
        fits = hello.oldest <= PROTOCOL_VERSION <= hello.newest
        self._mcu.disarm()
        self._last_sequence = sequence
        self._may_arm = fits
        return HelloReply(PROTOCOL_VERSION if fits else 0, Board.VIRTUAL, self._boots, FIRMWARE)

    def _arm(self, t_s: float, limits: Arm) -> None:
        """Take the wire's limits as they are: the host's bounds need not suit the plant's rig."""
        rig = self._rig
        pulses = {
            "pulse_us": (limits.low_us, limits.high_us),
            "slew_us_per_s": float(limits.slew_us_per_s),
            "source_descent_s": limits.source_descent_ms / 1000.0,
            "sufferer_descent_s": limits.sufferer_descent_ms / 1000.0,
            "brake_s": limits.brake_ms / 1000.0,
            "sink_s": limits.sink_ms / 1000.0,
            "sink_rate_us_per_s": float(limits.sink_rate_us_per_s),
        }
        carriage = {
            "max_speed_mps": limits.max_speed_steps_per_s / rig.stepper.steps_per_m,
            "max_accel_mps2": limits.max_accel_steps_per_s2 / rig.stepper.steps_per_m,
        }
        within = {
            "limits": rig.limits.model_copy(update=pulses),
            "stepper": rig.stepper.model_copy(update=carriage),
        }
        self._mcu = Mcu(rig.model_copy(update=within))
        self._mcu.arm(t_s)
        self._may_arm = False

    def _is_new(self, sequence: int) -> bool:
        if self._last_sequence is None:
            return False
        return 0 < (sequence - self._last_sequence) % SEQUENCE_WRAP < SEQUENCE_WRAP // 2

    def _status(self, plant: GantryPlant) -> Status:
        return status_of(
            self._mcu.status,
            plant,
            sequence=self._last_sequence or 0,
            boot=self._boots,
            battery_v=battery_v(self._rig),
            malformed=self._decoder.malformed + self._refused,
            started_s=self._started_s,
        )

    def _mcu_time(self, t_s: float) -> int:
        return mcu_time_us(t_s, self._started_s)


def status_of(
    mcu: McuStatus,
    plant: GantryPlant,
    *,
    sequence: int,
    boot: int,
    battery_v: float,
    malformed: int = 0,
    started_s: float = 0.0,
) -> Status:
    """What a board says of its MCU and of the plant around it; it started at `started_s`."""
    return Status(
        sequence=sequence,
        boot=boot,
        faults=Fault.DEADMAN if mcu.latched else Fault.NONE,
        armed=mcu.armed and not mcu.latched,
        homed=abs(plant.x_m) < HOME_SWITCH_M,
        source_us=plant.source_applied_us,
        sufferer_us=plant.sufferer_applied_us,
        steps=plant.steps,
        missed=min(mcu.missed_commands, 0xFFFF),
        malformed=min(malformed, 0xFFFF),
        applied_time_us=mcu_time_us(plant.pulse_applied_s, started_s),
        battery_mv=round(1000.0 * battery_v),
    )


def battery_v(rig: Rig) -> float:
    """What a virtual board measures of its flight battery [V]; 0 without a divider."""
    return BATTERY_V if rig.battery.has_divider else 0.0


def mcu_time_us(t_s: float, started_s: float = 0.0) -> int:
    """The MCU's clock [µs] at `t_s`; it wraps as the UNO's does."""
    return int((t_s - started_s) * 1e6) % TIME_WRAP_US
