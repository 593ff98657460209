"""Range samples without waiting for them: a thread reads, the loop takes the newest.

Two forms: the VL53L0X on the Pi's I²C bus, and a Unix socket behind which a plant process sits.
Sample times are on the system's monotonic clock, which processes share.
"""

import contextlib
import math
import os
import socket
import statistics
import struct
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from runtime.io.realtime import Clock
from wakedeploy.core.errors import UnusableInput, installs, one_line

TIMING_BUDGET_US = 20_000  # the sensor's fastest; its time of a sample is the middle of it
NOTHING_IN_RANGE_MM = 8190  # what the VL53L0X says when no light came back
POLL_S = 0.001
BUS_RETRIES = 10
SENSOR_ANSWER_S = 0.5  # the driver would otherwise wait for ever for a chip that hangs
SILENCE_S = 1.0  # without a measurement, though the bus is well: the sensor lost power or hangs
STATUS_NO_TARGET = 4
FIRST_SAMPLE_S = 3.0
PLANT_HANGS_S = 2.0
REST_SAMPLES, REST_S = 15, 1.0  # the median of these is within 3 mm, strays or not
# range [mm], sensor time [µs, monotonic], status, then what only a simulation knows (else NaN):
# wake's force [N], extra force [N], height [m], and the time that its plant has reached [µs].
SOCKET_LAYOUT = struct.Struct("<dQBdddQ")


@dataclass(frozen=True, slots=True)
class RangeReading:
    """One sample: range [mm], when it was taken [µs, monotonic], 0 for a good one; the truth.

    `plant_time_us` [monotonic] is how far a plant process has come; 0 where the world is real.
    """

    range_mm: float
    sensor_time_us: int
    status: int = 0
    true_wake_force_n: float = math.nan
    true_hook_force_n: float = math.nan
    true_z_m: float = math.nan
    plant_time_us: int = 0

    @property
    def range_m(self) -> float:
        """The range [m], NaN for a sample that is not good."""
        return self.range_mm / 1000.0 if self.status == 0 else math.nan

    @property
    def sensor_time_s(self) -> float:
        """When the sample was taken [s, monotonic]."""
        return self.sensor_time_us * 1e-6

    def behind_s(self, now_s: float) -> float:
        """How far a plant process is behind the present [s]: it has not been let run, nor answer.

        0 for a real world, and for a process that has stood still for so long that it may hang.
        """
        late_s = self.late_s(now_s)
        return late_s if 0.0 < late_s < PLANT_HANGS_S else 0.0

    def late_s(self, now_s: float) -> float:
        """The same, however long it has stood still."""
        return now_s - 1e-6 * self.plant_time_us if self.plant_time_us else 0.0

    def pack(self) -> bytes:
        """The sample as one packet of the socket form."""
        truth = (self.true_wake_force_n, self.true_hook_force_n, self.true_z_m, self.plant_time_us)
        return SOCKET_LAYOUT.pack(self.range_mm, self.sensor_time_us, self.status, *truth)


class RangeSource(Protocol):
    """Where range samples come from."""

    @property
    def newest(self) -> RangeReading | None:
        """The newest sample; None before the first."""

    @property
    def failure(self) -> str | None:
        """Why no more samples will come, as one sentence; None while all is well."""

    def close(self) -> None:
        """Stop reading."""


def wait_for_first(
    source: RangeSource, clock: Clock = time, limit_s: float = FIRST_SAMPLE_S
) -> RangeReading:
    """The first good sample; UnusableInput when none comes."""
    deadline_s = clock.monotonic() + limit_s
    while clock.monotonic() < deadline_s and source.failure is None:
        reading = source.newest
        if reading is not None and reading.status == 0:
            return reading
        clock.sleep(0.01)
    raise UnusableInput(
        failure_sentence(source)
        or f"The range sensor gave no valid reading within {limit_s:g} s; check that it sees the "
        "reflector and that its wires are connected."
    )


def failure_sentence(source: RangeSource) -> str | None:
    """Why no more samples will come, to stand by itself; None while all is well."""
    failure = source.failure
    return failure and failure[0].upper() + failure[1:]


def resting_range_m(source: RangeSource, clock: Clock = time, limit_s: float = REST_S) -> float:
    """The median [m] of the first good sample and those of a short rest, each counted once.

    Raises UnusableInput when no good one comes.
    """
    first = wait_for_first(source, clock)
    seen = {first.sensor_time_us: first.range_m}
    deadline_s = clock.monotonic() + limit_s
    while len(seen) < REST_SAMPLES and clock.monotonic() < deadline_s and source.failure is None:
        reading = source.newest
        if reading is not None and reading.status == 0:
            seen[reading.sensor_time_us] = reading.range_m
        clock.sleep(POLL_S)
    return statistics.median(seen.values())


class SocketRangeSource:
    """Samples from a plant process, one packet each."""

    def __init__(self, path: Path) -> None:
        self.newest: RangeReading | None = None
        self.failure: str | None = None
        self._is_closing = False
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            # What a link points to: a socket's own path may have some hundred characters only.
            self._socket.connect(str(path.resolve()))
        except OSError as error:
            self._socket.close()
            raise UnusableInput(
                f"{path}: no range samples can be read there ({one_line(error)})."
            ) from error
        self._thread = threading.Thread(target=self._read, name="range", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop reading."""
        self._is_closing = True
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(timeout=1.0)
        self._socket.close()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while packet := self._socket.recv(SOCKET_LAYOUT.size + 1):
                if len(packet) == SOCKET_LAYOUT.size:
                    self.newest = RangeReading(*SOCKET_LAYOUT.unpack(packet))
        if not self._is_closing:
            self.failure = "the plant process stopped sending range samples."


class I2cRangeSource:
    """The VL53L0X in continuous mode on the Pi's I²C bus; needs the `[rig]` extra."""

    def __init__(self, sensor: Any = None) -> None:
        self.newest: RangeReading | None = None
        self.failure: str | None = None
        self._closing = threading.Event()
        self._sensor = sensor if sensor is not None else _connected_sensor()
        try:
            self._sensor.measurement_timing_budget = TIMING_BUDGET_US
            self._sensor.start_continuous()
        except (OSError, RuntimeError) as error:
            raise UnusableInput(
                f"The range sensor did not start to measure ({one_line(error)}); check its wires "
                "and its power."
            ) from error
        self._thread = threading.Thread(target=self._read, name="range", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop reading and the sensor's measuring."""
        self._closing.set()
        self._thread.join(timeout=1.0)
        with contextlib.suppress(OSError, RuntimeError):
            self._sensor.stop_continuous()

    def _read(self) -> None:
        errors = 0
        while not self._closing.is_set():
            try:
                measured = self._read_one(keep=errors == 0)
                errors = 0
            except (OSError, RuntimeError) as error:
                errors += 1
                if errors > BUS_RETRIES:
                    self.failure = (
                        f"the range sensor stopped answering ({one_line(error)}); check its wires."
                    )
                    return
                self._closing.wait(POLL_S)
                continue
            if not measured and not self._closing.is_set():
                self.failure = (
                    f"The range sensor answers but has not measured for {SILENCE_S:g} s; check its "
                    "power."
                )
                return

    def _read_one(self, keep: bool) -> bool:
        """Sleep through most of a measurement, look until it is ready, take it; False if none came.

        After an error of the bus the driver may still hold an older measurement to be ready: its
        age is not known, so it is taken off the sensor and not kept.
        """
        self._closing.wait(0.8e-6 * TIMING_BUDGET_US)
        deadline_s = time.monotonic() + SILENCE_S
        while not self._sensor.data_ready:
            if time.monotonic() > deadline_s or self._closing.wait(POLL_S):
                return False
        taken_us = int(time.monotonic() * 1e6) - TIMING_BUDGET_US // 2
        range_mm = int(self._sensor.range)
        status = STATUS_NO_TARGET if range_mm >= NOTHING_IN_RANGE_MM else 0
        if keep:
            self.newest = RangeReading(float(range_mm), taken_us, status)
        return True


def import_driver() -> tuple[Any, Any]:
    """The driver's module and that of this computer's pins; UnusableInput where one is missing."""
    # Otherwise Blinka asks at a terminal whether it may run pip.
    os.environ.setdefault("BLINKA_SKIP_DEPENDENCY_CHECK", "1")
    try:
        import adafruit_vl53l0x
        import board
    except (ImportError, NotImplementedError, RuntimeError) as error:
        # Blinka raises RuntimeError where a library for this board's pins is missing.
        raise UnusableInput(
            f"The range sensor's driver cannot be loaded here ({one_line(error)}); on the Pi "
            f"install it and what it needs with: {installs('rig')}."
        ) from error
    if not hasattr(board, "I2C"):
        raise UnusableInput(
            "The range sensor's driver knows no I²C pins of this computer; connect the sensor to a "
            "Raspberry Pi, or give --range-socket."
        )
    return adafruit_vl53l0x, board


def _connected_sensor() -> Any:
    driver, board = import_driver()
    try:
        return driver.VL53L0X(board.I2C(), io_timeout_s=SENSOR_ANSWER_S)
    except (OSError, ValueError, RuntimeError) as error:
        raise UnusableInput(
            f"No VL53L0X answers on the I²C bus ({one_line(error)}); check its wiring and that "
            "I²C is switched on (raspi-config)."
        ) from error
