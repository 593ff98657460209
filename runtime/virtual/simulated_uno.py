"""An UNO that runs the compiled sketch in virtual time: bytes and pins, nothing else.

In: bytes for its serial port, the home switch, the battery. Out: bytes, pulses, steps. A process
can have one, for the simulator keeps its state in global variables.
"""

import ctypes
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from runtime.virtual.firmware_build import firmware, simulator_library

CYCLES_PER_S = 16_000_000
BOOT_S = 1.7  # an UNO's bootloader, from opening the port
SOURCE_PIN, SUFFERER_PIN, STEP_PIN, DIRECTION_PIN = 9, 10, 2, 3

_FOR_EVER = 1 << 60  # cycles
_MOST_EDGES = 1 << 16
_MOST_BYTES = 1 << 16
_EDGE = np.dtype([("cycle", "u8"), ("pin", "u1"), ("level", "u1")], align=True)


@dataclass(frozen=True)
class Edges:
    """Changes of the pins' levels in order: when [s], which pin, and whether it rose."""

    time_s: npt.NDArray[np.float64]
    pin: npt.NDArray[np.uint8]
    rose: npt.NDArray[np.bool_]

    def changes(self, pin: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
        """When a pin changed [s], and whether it rose."""
        mine = self.pin == pin
        return self.time_s[mine], self.rose[mine]

    def pulses(self, pin: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Whole pulses of a pin: when each began [s], how long each was [µs]."""
        time_s, rose = self.changes(pin)
        whole = np.flatnonzero(rose[:-1] & ~rose[1:])
        return time_s[whole], 1e6 * (time_s[whole + 1] - time_s[whole])


class SimulatedUno:
    """The board; its time stands except in `run_until`. Raises UnusableInput without the tools."""

    def __init__(self) -> None:
        elf = firmware().elf
        self._simulator = _loaded(str(simulator_library()))
        if self._simulator.sim_start(str(elf).encode()) != 0:
            raise RuntimeError("this process already has a simulated UNO")

    @property
    def t_s(self) -> float:
        """Time since power-on [s]."""
        return float(self._simulator.sim_cycle()) / CYCLES_PER_S

    @property
    def bytes_under_way(self) -> int:
        """Bytes sent that have not reached the chip."""
        return int(self._simulator.sim_pending())

    @property
    def steps(self) -> int:
        """Step pulses since power-on, each counted with its direction."""
        return int(self._simulator.sim_steps())

    def run_until(self, t_s: float) -> None:
        """Let the chip run; RuntimeError when its program crashes."""
        if self._simulator.sim_run(round(t_s * CYCLES_PER_S)) != 0:
            raise RuntimeError(f"the sketch crashed at {self.t_s:.6f} s")

    def open_port(self, boot_s: float = BOOT_S, *, reset_flags: int = 0) -> None:
        """What a host's opening does: a reset, then the bootloader for `boot_s`.

        `reset_flags` is what the chip's register of resets then says (ATmega328P data sheet,
        MCUSR); an UNO's own bootloader clears it.
        """
        self._simulator.sim_open_port(round(boot_s * CYCLES_PER_S), reset_flags)

    def switch_off(self) -> None:
        """Its supply is gone, until a host opens the port again; every pin falls."""
        self._simulator.sim_open_port(_FOR_EVER, 0)

    def send(self, data: bytes) -> None:
        """Put bytes on the wire; lost while the bootloader runs."""
        if self._simulator.sim_send(data, len(data)) != len(data):
            raise RuntimeError("more bytes than the simulator's wire holds")

    def receive(self) -> bytes:
        """What the board has sent since the last call."""
        room = ctypes.create_string_buffer(_MOST_BYTES)
        length = self._simulator.sim_receive(room, _MOST_BYTES)
        return room.raw[:length]

    def edges(self) -> Edges:
        """What the pins have done since the last call; RuntimeError when that is too much."""
        into = np.zeros(_MOST_EDGES, dtype=_EDGE)
        count = self._simulator.sim_edges(into.ctypes.data, _MOST_EDGES)
        if count < 0:
            raise RuntimeError("more edges on the pins than the simulator keeps; look more often")
        seen = into[:count]
        return Edges(seen["cycle"] / CYCLES_PER_S, seen["pin"], seen["level"] == 1)

    def longest_tick_us(self) -> float:
        """The longest run of the 10 kHz interrupt since the last call [µs]."""
        return 1e6 * float(self._simulator.sim_longest_tick()) / CYCLES_PER_S

    def set_home(self, is_closed: bool) -> None:
        """The home switch."""
        self._simulator.sim_set_home(is_closed)

    def set_battery(self, pin_v: float) -> None:
        """The voltage [V] behind the battery's divider, at the pin."""
        self._simulator.sim_set_battery_pin(round(1000 * pin_v))

    def hang(self, *, with_interrupts_off: bool = False) -> None:
        """Let the main loop hang from now on, or let it lose its interrupts; `mend` ends it."""
        self._replace_sleep(0x94F8 if with_interrupts_off else 0xCFFF)  # cli, or a jump to itself

    def mend(self, *, sleeps: bool = True) -> None:
        """As the sketch was compiled; the simulator ends where a chip sleeps for ever."""
        self._replace_sleep(0x9588 if sleeps else 0x0000)

    def _replace_sleep(self, instruction: int) -> None:
        if self._simulator.sim_replace_sleep(instruction) != 0:
            raise RuntimeError("the sketch sleeps at no place, or at several")


def _loaded(path: str) -> ctypes.CDLL:
    library = ctypes.CDLL(path)
    library.sim_start.argtypes = [ctypes.c_char_p]
    library.sim_cycle.restype = ctypes.c_uint64
    library.sim_longest_tick.restype = ctypes.c_uint64
    library.sim_steps.restype = ctypes.c_int64
    library.sim_run.argtypes = [ctypes.c_uint64]
    library.sim_open_port.argtypes = [ctypes.c_uint64, ctypes.c_uint8]
    library.sim_open_port.restype = None
    library.sim_send.argtypes = [ctypes.c_char_p, ctypes.c_int]
    library.sim_receive.argtypes = [ctypes.c_char_p, ctypes.c_int]
    library.sim_edges.argtypes = [ctypes.c_void_p, ctypes.c_int]
    library.sim_replace_sleep.argtypes = [ctypes.c_uint16]
    library.sim_set_home.argtypes = [ctypes.c_int]
    library.sim_set_home.restype = None
    library.sim_set_battery_pin.argtypes = [ctypes.c_uint32]
    library.sim_set_battery_pin.restype = None
    return library
