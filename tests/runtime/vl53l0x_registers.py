"""A VL53L0X at register level, behind the interface of busio's I2C: what its driver talks to.

Registers are kept by page (0xFF selects one), as the chip keeps them. What the driver waits for
happens in real time: reading the reference SPADs, reference calibration, measurements.
"""

import threading
import time
from collections.abc import Callable

ADDRESS = 0x29
SYSRANGE_START, SEQUENCE_CONFIG, INTERRUPT_CLEAR = 0x00, 0x01, 0x0B
INTERRUPT_STATUS, RANGE_MM, STOP, PAGE = 0x13, 0x1E, 0x91, 0xFF
SPAD_STROBE, SPAD_INFO, SPAD_MAP = 0x83, 0x92, 0xB0
STOP_VARIABLE = 0x3C  # each chip has its own; without it given back, it does not measure
SPADS = 0x80 | 5  # five of the aperture kind
REMOTE_IO = 121


class RegisterSensor:
    """The chip and its bus in one.

    `range_mm(t_s)` is what it would measure at a monotonic time; `period_s` the time of one
    measurement. Faults: `errors` transfers fail, then it answers again; `gone`: nobody
    acknowledges; `frozen`: it answers but measures no more; `fail_on_clear` clears of the interrupt
    get lost on the bus.
    """

    def __init__(self, range_mm: Callable[[float], int], period_s: float = 0.02) -> None:
        self.range_mm, self.period_s = range_mm, period_s
        self.errors = self.fail_on_clear = 0
        self.gone = self.frozen = self.never_calibrates = False
        self.measured: list[tuple[float, int]] = []  # when [s], what [mm]
        self.uncleared: set[int] = set()  # what was read when a clear got lost [mm]
        self._pages: dict[int, dict[int, int]] = {0: {0xC0: 0xEE, 0xC1: 0xAA, 0xC2: 0x10}, 1: {}}
        self._pages[0] |= {SPAD_MAP + i: 0xFF for i in range(6)}
        self._pages[1][STOP] = STOP_VARIABLE
        self._page = self._index = 0
        self._spad_ready_s = 0.0
        self._ready = False
        self._due_s: float | None = None
        self._lock = threading.Lock()

    @property
    def continuous(self) -> bool:
        """Whether it measures back to back."""
        return self._pages[0].get(SYSRANGE_START, 0) == 0x02

    @property
    def enabled_spads(self) -> int:
        """How many reference SPADs the driver has chosen."""
        return sum(self._pages[0][SPAD_MAP + i].bit_count() for i in range(6))

    # What busio.I2C has.

    def try_lock(self) -> bool:
        return self._lock.acquire(blocking=False)

    def unlock(self) -> None:
        self._lock.release()

    def writeto(self, address: int, buffer: bytes, *, start: int = 0, end: int | None = None):
        self._acknowledge(address)
        data = bytes(buffer[start:end])
        if data:
            self._index = data[0]
        for offset, value in enumerate(data[1:]):
            self._write(data[0] + offset, value)

    def readfrom_into(
        self, address: int, buffer: bytearray, *, start: int = 0, end: int | None = None
    ):
        self._acknowledge(address)
        end = len(buffer) if end is None else end
        for place in range(start, end):
            buffer[place] = self._read(self._index)
            self._index += 1

    def writeto_then_readfrom(
        self, address, out_buffer, in_buffer, *, out_start=0, out_end=None, in_start=0, in_end=None
    ):
        self.writeto(address, out_buffer, start=out_start, end=out_end)
        self.readfrom_into(address, in_buffer, start=in_start, end=in_end)

    # The chip.

    def _acknowledge(self, address: int) -> None:
        assert self._lock.locked(), "a transfer without the bus's lock"
        if self.errors > 0:
            self.errors -= 1
            raise OSError(REMOTE_IO, "Remote I/O error")
        if self.gone or address != ADDRESS:
            raise OSError(REMOTE_IO, "Remote I/O error")
        self._measure()

    def _write(self, index: int, value: int) -> None:
        if index == PAGE:
            self._page = value
            return
        if self._page == 0 and index == INTERRUPT_CLEAR and value & 0x01:
            if self.fail_on_clear > 0:
                self.fail_on_clear -= 1
                self.uncleared.add((self._pages[0][RANGE_MM] << 8) | self._pages[0][RANGE_MM + 1])
                raise OSError(REMOTE_IO, "Remote I/O error")
            self._ready = False
        if self._page == 7 and index == SPAD_STROBE and value == 0:
            self._spad_ready_s = time.monotonic() + 0.003
        self._pages.setdefault(self._page, {})[index] = value
        if self._page == 0 and index == SYSRANGE_START:
            self._start(value)

    def _read(self, index: int) -> int:
        if self._page == 0 and index == INTERRUPT_STATUS:
            return 0x44 if self._ready else 0x40  # only the lowest three bits count
        if self._page == 7 and index == SPAD_STROBE:
            return 0x10 if time.monotonic() >= self._spad_ready_s > 0.0 else 0
        if self._page == 7 and index == SPAD_INFO:
            return SPADS
        return self._pages.setdefault(self._page, {}).get(index, 0)

    def _start(self, value: int) -> None:
        now_s, page = time.monotonic(), self._pages[0]
        calibrating = page.get(SEQUENCE_CONFIG, 0) in (0x01, 0x02)
        if calibrating and value & 0x01:
            self._due_s = None if self.never_calibrates else now_s + 0.002
        elif value in (0x01, 0x02):
            # A ranging starts only with the chip's own stop variable put back.
            right = self._pages[1].get(STOP) == STOP_VARIABLE
            self._due_s = now_s + self.period_s if right else None
            page[SYSRANGE_START] = value & 0x02  # the start bit clears itself
        else:
            self._due_s = None

    def _measure(self) -> None:
        """What has been measured by now; results go on while nobody clears the interrupt."""
        now_s = time.monotonic()
        while self._due_s is not None and not self.frozen and now_s >= self._due_s:
            done_s = self._due_s
            value = int(self.range_mm(done_s - 0.5 * self.period_s))
            self._pages[0][RANGE_MM], self._pages[0][RANGE_MM + 1] = value >> 8, value & 0xFF
            self._ready = True
            self._due_s = done_s + self.period_s if self.continuous else None
            if self.continuous:
                self.measured.append((done_s - 0.5 * self.period_s, value))
