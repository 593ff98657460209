"""The UNO's end of the wire, played by the compiled sketch on a simulated chip.

What `McuPort` decides in Python is here decided by the firmware: the plant gets the pulse widths
that were measured on the ESC pins, and the steps that were counted on the step pin.
"""

import math
from collections import deque

from runtime.virtual.mcu import Outputs
from runtime.virtual.mcu_port import HOME_SWITCH_M, battery_v
from runtime.virtual.simulated_uno import SOURCE_PIN, SUFFERER_PIN, SimulatedUno
from wakedeploy.core.rig import Rig
from wakedeploy.physics.gantry import GantryPlant

DIVIDER = 4.0  # 30 kΩ over 10 kΩ, as arduino_sketch/pins.h has it
WIRE_S = 0.001  # a command's bytes on the simulated wire, and the main loop's turn
SIGNAL_LOST_S = 0.1  # an ESC without pulses for so long stops its motor


class FirmwarePort:
    """Takes bytes, lets the sketch run, answers with its bytes. Times are the plant's [s].

    `battery_v` is the voltage before the divider, if the rig has one; a test may let it sag.
    Raises UnusableInput when the sketch cannot be compiled or simulated here.
    """

    def __init__(self, rig: Rig, uno: SimulatedUno | None = None) -> None:
        self._uno = SimulatedUno() if uno is None else uno
        self._origin_s = self._uno.t_s
        self._steps_per_m = rig.stepper.steps_per_m
        # The command's half of the round trip, of which the simulated wire is a part.
        self._delay_s = max(0.0, 0.5 * rig.latency.round_trip_s - WIRE_S)
        self._under_way: deque[tuple[float, bytes]] = deque()
        self.battery_v = battery_v(rig)
        self._pulses = {pin: _PulseMeter() for pin in (SOURCE_PIN, SUFFERER_PIN)}

    def opened(self, t_s: float) -> None:
        """The port was opened, which resets an UNO."""
        self._under_way.clear()
        self._uno.open_port()

    def receive(self, t_s: float, data: bytes, *, at_once: bool = False) -> None:
        """Bytes from the host; whatever comes while the bootloader runs is lost.

        They take the command's half of the round trip, or the simulated wire's time alone.
        """
        self._under_way.append((t_s + (0.0 if at_once else self._delay_s), data))

    @property
    def due_s(self) -> float:
        """Nobody knows when the sketch will answer."""
        return math.inf

    def answer(self, t_s: float, plant: GantryPlant) -> bytes:
        """What the sketch has sent by now; the plant moves its home switch."""
        self._uno.set_battery(self.battery_v / DIVIDER)
        self._uno.set_home(abs(plant.x_m) < HOME_SWITCH_M)
        return self._uno.receive()

    def advance(self, t_s: float, dt_s: float) -> Outputs:
        """Let the sketch run over the next step; what its pins did."""
        end_s, steps = t_s + dt_s, self._uno.steps
        while self._under_way and self._under_way[0][0] <= end_s:
            arrives_s, data = self._under_way.popleft()
            self._uno.run_until(self._origin_s + arrives_s)
            self._uno.send(data)
        self._uno.run_until(self._origin_s + end_s)
        seen = self._uno.edges()
        for time_s, pin, rose in zip(seen.time_s, seen.pin, seen.rose, strict=True):
            if pin in self._pulses:
                self._pulses[pin].take(float(time_s) - self._origin_s, rose=bool(rose))
        return Outputs(
            self._pulses[SOURCE_PIN].width_us(end_s),
            self._pulses[SUFFERER_PIN].width_us(end_s),
            (self._uno.steps - steps) / self._steps_per_m / dt_s,
        )


class _PulseMeter:
    """What an ESC makes of its pin: the width of the last whole pulse [µs], 0 without any."""

    def __init__(self) -> None:
        self._rose_s = -SIGNAL_LOST_S
        self._width_us = 0.0

    def take(self, time_s: float, *, rose: bool) -> None:
        """The pin's level changed."""
        if rose:
            self._rose_s = time_s
        else:
            self._width_us = 1e6 * (time_s - self._rose_s)

    def width_us(self, t_s: float) -> float:
        return self._width_us if t_s - self._rose_s < SIGNAL_LOST_S else 0.0
